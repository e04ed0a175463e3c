"""Base classes of contracts: their examples run, and parts of other classes have the defaults of
what they lack.
"""

import pickle
from typing import Any

import numpy as np
import pytest

import opir_core
from opir_core.errors import ModelError
from opir_core.interfaces import has_own
from opir_core.interfaces.outputs import sink_or_transport
from opir_core.output import deliver
from opir_core.plugin import (
    EMITTER_TYPES,
    Background,
    Classifier,
    Delivery,
    DetectionProbability,
    Encoder,
    Sink,
    SinkModel,
    Trajectories,
    Transmittance,
    Transport,
    hookimpl,
)

SCENE = {
    "scene": "adopted",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 60,
    "sensors": [{"model": "generic-scanner", "id": "S-1", "orbital_slot_deg": -160.0}],
    "targets": [
        {
            "id": "T1",
            "type": "SRBM",
            "launch": {"lat_deg": 11.0, "lon_deg": 171.0},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
        }
    ],
}


class Bare:
    """A sink with the required methods alone."""

    taken = 0

    def write(self, window: Any) -> None:
        self.taken += len(window.detections)

    def close(self) -> Delivery:
        return Delivery(delivered=self.taken)


class Lines:
    content_type = "text/plain"
    schema_version = "1"

    def encode(self, window: Any) -> bytes:
        return b"x\n" * len(window.detections)


class Faulty(Bare):
    @property
    def waits(self) -> int:
        return self.nothing  # type: ignore[attr-defined, no-any-return]


def test_a_foreign_component_has_the_defaults() -> None:
    sink = Sink.adopt(Bare())
    assert (sink.delivery_so_far(), sink.waits, sink.outlives_the_process, sink.parked) == (
        None,
        0,
        None,
        None,
    )
    assert not sink.retry()
    sink.close_by(0.0)
    assert sink.close() == Delivery(delivered=0)
    assert Sink.adopt(sink) is sink


def test_own_members_replace_defaults() -> None:
    class Waiting(Bare):
        waits = 7

    class Derived(Waiting, Sink):
        pass

    for sink in (Sink.adopt(Waiting()), Derived()):
        assert sink.waits == 7
        assert has_own(Sink, sink, "waits")
        assert not has_own(Sink, sink, "parked")


def test_a_failing_property_is_not_missing() -> None:
    with pytest.raises(AttributeError, match="nothing"):
        _ = Sink.adopt(Faulty()).waits


def test_an_adopted_part_pickles() -> None:
    encoder = pickle.loads(pickle.dumps(Encoder.adopt(Lines())))
    assert (encoder.content_type, encoder.encodes_tracks) == ("text/plain", False)


def test_what_sends_is_a_transport_and_what_writes_a_sink() -> None:
    class Sending:
        trouble = None
        send = print
        close = send

    assert isinstance(sink_or_transport(Sending()), Transport)
    assert isinstance(sink_or_transport(Bare()), Sink)


@pytest.mark.parametrize(
    ("made", "seen"), [(None, "None without close, write"), (Lines(), "a Lines without close")]
)
def test_an_invalid_sink_is_refused_with_its_owner(made: Any, seen: str) -> None:
    with pytest.raises(
        ModelError, match=f"outputs\\[0\\]: .*'own' of plugin .*build made {seen}.*plugin.Sink"
    ):
        run_into(made)


def test_a_sink_of_another_class_takes_all_events_of_a_run() -> None:
    sink = Bare()
    report = run_into(sink).report
    assert (
        [sink_report.delivered for sink_report in report.sinks] == [report.events] == [sink.taken]
    )
    assert sink.taken > 0


def run_into(sink: Any) -> Any:
    class Plugin:
        @hookimpl
        def opir_sinks(self) -> Any:
            yield SinkModel(
                name="own", summary="for this test", build=lambda _config, _context: sink
            )

    host = opir_core.Host.of(Plugin())
    plan = opir_core.compile_plan(
        opir_core.scene_from_mapping({**SCENE, "outputs": ["own"]}, host=host), host
    )
    return deliver(plan)


def test_instance_attributes_replace_defaults() -> None:
    class Broker(Transport):
        def __init__(self) -> None:
            self.trouble = "no connection yet"  # type: ignore[misc]

        send = print
        close = send  # type: ignore[assignment]

    assert Transport.adopt(Broker()).trouble == "no connection yet"


def test_a_derived_part_without_a_required_attribute_is_refused() -> None:
    class Unnamed(Encoder):
        content_type = "text/plain"

        def encode(self, window: Any) -> bytes:
            return b""

    with pytest.raises(
        ModelError, match=r"an Unnamed without schema_version; .* opir_core.plugin.Encoder"
    ):
        Encoder.adopt(Unnamed())


class Half:
    """Has one method of each pair: `log_posterior`, `response`, `rate_per_scan` and `structures`."""

    log_posterior = reported_type = probability = measure = response = print
    rate_per_scan = structures = clutter_w_m2_sr = radiance_w_m2_sr = print


@pytest.mark.parametrize(
    ("base", "pair"),
    [
        (Classifier, "log_posterior and defines no reported"),
        (Classifier, "log_posterior and defines no revised"),
        (DetectionProbability, "response and defines no measure_response"),
        (DetectionProbability, "rate_per_scan and defines no measure_noise"),
        (Background, "structures and defines no structured_radiances_w_m2_sr"),
    ],
)
def test_half_of_a_pair_is_refused(base: Any, pair: str) -> None:
    for kind in (Half, type("Half", (Half, base), {})):
        method = getattr(base.adopt(kind()), pair.split()[-1])
        with pytest.raises(ModelError, match=f"Half has {pair}; .*plugin.{base.__name__} says"):
            method(*range(1, method.__code__.co_argcount))


def test_foreign_trajectories_burn_once_and_end_at_burnout() -> None:
    class Still:
        type_code = np.array([2, 0], dtype=np.uint8)
        ignition_s = np.array([1.0, 2.0])
        burnout_s = np.array([61.0, 92.0])
        position_ecef_m = print
        truth = position_ecef_m

    targets = Trajectories.adopt(Still())
    assert targets.end_s.tolist() == [61.0, 92.0]
    assert targets.burns_s.tolist() == [[[1.0, 61.0]], [[2.0, 92.0]]]
    assert list(targets.class_names) == [EMITTER_TYPES[2], EMITTER_TYPES[0]]
    assert (targets.course_breakpoints_s, list(targets.files)) == (None, [])


def test_foreign_models_of_light_work_band_by_band() -> None:
    class Air:
        def transmittance(self, band: int, path: Any) -> Any:
            return np.full(len(path), 0.5 + 0.1 * band)

    class Sky:
        def radiance_w_m2_sr(self, band: int, view: Any) -> Any:
            return np.full(len(view), 1.0 + band)

        clutter_w_m2_sr = radiance_w_m2_sr

    air = Transmittance.adopt(Air())
    sky = Background.adopt(Sky())
    rows: Any = range(2)
    assert air.transmittances([0, 1], rows).tolist() == [[0.5, 0.5], [0.6, 0.6]]
    assert air.cloud_top_m(np.zeros((1, 3))).tolist() == [-np.inf]
    assert (air.clear, len(air.altitude_breakpoints_m), list(sky.structures)) == (air, 0, [])
    assert sky.radiances_and_clutter_w_m2_sr([1], rows)[1].tolist() == [[2.0, 2.0]]
