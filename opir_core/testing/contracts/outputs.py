"""The contracts of what lets events out: encoders and sinks."""

import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any, ClassVar

import numpy as np
from attrs import evolve, fields_dict

from opir_core.interfaces.contexts import EncoderContext
from opir_core.interfaces.optional import BufferingSink, MonitoredSink
from opir_core.interfaces.protocols import Delivery, Encoder, Sink
from opir_core.interfaces.records import Tracks, Window
from opir_core.output.delivery import opened_sink
from opir_core.output.events import SCHEMA_VERSION, detection_schema
from opir_core.output.events.encoder_input import only_encodable
from opir_core.planning.plan import Plan
from opir_core.plugin.components import Component, EventEncoder, SinkModel
from opir_core.scene.scene import Choice
from opir_core.simulation.run import plan_windows
from opir_core.testing.bench import bench_scene, encoder_of, planned
from opir_core.testing.contracts.comparisons import insist_complete, insist_pickles
from opir_core.testing.contracts.contract import Broken, Contract, insist
from opir_core.testing.doubles import stub_estimates, stub_window
from opir_core.testing.json_schema import faults_in
from opir_core.testing.watching import asked_of_the_world


def awkward_windows() -> Mapping[str, Window]:
    """Return windows that encoders have trouble with, by what they are; all of sensor 0."""
    pole, edge, zero = [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], np.zeros(3)
    known = stub_estimates(
        2,
        state=[6.5e6, 1.0, 2.0, 10.0, 20.0, 30.0],
        launch=[np.pi / 2, np.pi, 1.0],
        launch_covariance=[[4.0, 1.0, 0.0], [1.0, 9.0, 0.0], [0.0, 0.0, 0.25]],
        impact=[-np.pi / 2, -np.pi, 2.0],
        impact_covariance=[[1e6, 0.0, 0.0], [0.0, 1e6, 0.0], [0.0, 0.0, 4.0]],
    )
    return {
        "one detection": stub_window(1),
        "many detections": stub_window(300),
        "over the pole": stub_window(3, line_of_sight_ecef=pole, sensor_ecef_m=[0.0, 0.0, 4.2e7]),
        "at the antimeridian": stub_window(3, sensor_ecef_m=[-4.2e7, -1e-3, 0.0], line_of_sight_ecef=edge),
        "with an estimate": stub_window(2, track=0, estimate=0, estimates=known),
        "with unknown estimates": stub_window(2, track=7, estimate=1, estimates=stub_estimates(2)),
        "with nothing known": stub_window(2, snr=np.nan, confidence=0.0, bands=0),
        "sure of everything": stub_window(2, snr=1e6, confidence=1.0, line_of_sight_sigma_rad=zero[0]),
    }


class EncoderContract(Contract):
    """What an event encoder promises."""

    kind: ClassVar[type[Component]] = EventEncoder

    @classmethod
    @cache
    def encoder(cls) -> Encoder:
        """Return the built encoder, for the bench's sensors."""
        plan = planned(bench_scene(), cls.host())
        context = EncoderContext(sensors=plan.sensors, epoch_us=plan.scene.epoch_us)
        made: Encoder = cls.component().build(cls.config(), context)
        return made

    @classmethod
    @cache
    def windows(cls) -> tuple[Window, ...]:
        """Return the windows of the bench's scene."""
        return tuple(plan_windows(planned(bench_scene(), cls.host()), 10.0))

    def test_says_what_it_writes(self) -> None:
        """It has a media type and a version of its schema."""
        encoder: Any = self.encoder()
        kept = encoder.content_type.count("/") == 1 and encoder.schema_version.strip()
        insist(kept, "content_type or schema_version says nothing", "Give a media type, type/subtype, and a version.")

    def test_each_detection_is_one_line(self) -> None:
        """Each detection with a message is one, ended by a newline and containing none; no detections are no bytes."""
        encoder = self.encoder()
        for name, window in {**awkward_windows(), "empty": stub_window(0)}.items():
            text: Any = encoder.encode(window)
            expected = len(only_encodable(window, encoder).detections)
            insist(
                isinstance(text, bytes) and text.count(b"\n") == expected and text[-1:] in (b"", b"\n"),
                f"a window of {expected} detections ({name}) gives {text.count(bytes([10]))} lines",
                "Return bytes: one line a detection, each ended by a newline, escaped inside.",
            )

    def test_windows_encode_alone_as_together(self) -> None:
        """Windows cut in two give the same bytes, and so does the same window twice."""
        encoder = self.encoder()
        for window in self.windows():
            middle = len(window.detections) // 2
            halves = (_part(window, slice(0, middle)), _part(window, slice(middle, None)))
            same = encoder.encode(window) == b"".join(map(encoder.encode, halves))
            insist(same, "a window cut in two gives other bytes", "Encode each row from its own columns alone.")

    def test_no_truth_is_written(self) -> None:
        """What was really there changes no byte."""
        encoder = self.encoder()
        for window in self.windows():
            if len(window.truth):
                lie = evolve(window.truth, range_m=window.truth.range_m + 1e6, target=window.truth.target[::-1])
                same = encoder.encode(window) == encoder.encode(evolve(window, truth=lie))
                insist(same, "the truth shows in the bytes", "Read window.detections and window.estimates alone.")

    def test_json_follows_the_schema(self) -> None:
        """What calls itself JSON is JSON, without NaN; of the core's schema version, it follows the core's schema."""
        encoder, schema = self.encoder(), detection_schema()
        if "json" not in encoder.content_type:
            return
        for name, window in awkward_windows().items():
            for line in encoder.encode(window).splitlines():
                event = _json_of(line, name)
                faults = faults_in(event, schema) if encoder.schema_version == SCHEMA_VERSION else []
                insist(not faults, f"{name}: {'; '.join(faults[:3])}", "See opir schema detection.")

    def test_clock_network_and_global_random_numbers_are_not_asked(self) -> None:
        """Neither the clock, nor entropy, nor the network, nor random numbers that all share, are asked."""
        asked = asked_of_the_world(lambda: [self.encoder().encode(window) for window in self.windows()])
        change = "An event says when it was detected, in scene time; its id is that of the detection."
        insist(not asked, f"it asks {'; '.join(asked[:3])}", change)

    def test_a_built_encoder_pickles(self) -> None:
        """The built encoder can be pickled, and its copy writes the same."""
        window = self.windows()[2]
        same = insist_pickles(self.encoder()).encode(window) == self.encoder().encode(window)
        insist(same, "a pickled copy writes other bytes", "Keep all state in fields that pickle.")


class SinkContract(Contract):
    """What a sink promises. It is run in an empty folder; a setting named `path` is given a file there."""

    kind: ClassVar[type[Component]] = SinkModel

    @classmethod
    def block(cls) -> Mapping[str, Any]:
        """Return the settings, with a file for sinks that write one."""
        needs_path = "path" in fields_dict(cls.component().config) and "path" not in cls.settings
        return {**cls.settings, **({"path": "events.out"} if needs_path else {})}

    @classmethod
    @cache
    def windows(cls) -> tuple[Window, ...]:
        """Return the windows of the bench's scene, empty ones among them."""
        return tuple(plan_windows(cls.plan(), 10.0))

    @classmethod
    @cache
    def plan(cls) -> Plan:
        """Return the plan of the bench's scene."""
        return planned(bench_scene(), cls.host())

    @contextmanager
    def opened(self) -> Iterator[Sink]:
        """Give the built sink, in a folder of its own."""
        with _empty_folder():
            yield opened_sink(self.plan(), Choice(SinkModel.hook, self.name, self.config(), "outputs[0]"))

    def test_every_event_is_accounted_for(self) -> None:
        """What was delivered, spooled and dropped adds up to what was written."""
        with self.opened() as sink:
            for window in self.windows():
                sink.write(window)
            events = sum(len(window.detections) for window in self.windows())
            if isinstance(sink, MonitoredSink):
                _insist_accounts(sink.delivery_so_far(), events)
            _insist_accounts(sink.close(), events)

    def test_optional_abilities_are_complete(self) -> None:
        """An optional protocol is implemented with all its members, or not at all."""
        with self.opened() as sink:
            insist_complete(sink, (BufferingSink,))
            sink.close()

    def test_nothing_written_is_nothing_delivered(self) -> None:
        """A sink that is closed at once has delivered nothing."""
        with self.opened() as sink:
            _insist_accounts(sink.close(), 0)

    def test_windows_without_events_are_taken(self) -> None:
        """Windows without events are no error and no event."""
        with self.opened() as sink:
            for count in (0, 3, 0):
                sink.write(stub_window(count))
            _insist_accounts(sink.close(), 3)

    def test_windows_are_left_as_they_are(self) -> None:
        """A sink changes nothing in the windows it is given: other sinks get the same ones."""
        before = [encoder_of(self.plan()).encode(window) for window in self.windows()]
        with self.opened() as sink:
            for window in self.windows():
                sink.write(window)
            sink.close()
        after = [encoder_of(self.plan()).encode(window) for window in self.windows()]
        insist(before == after, "a window is different after it was written", "Copy columns before changing them.")

    def test_awkward_windows_are_taken(self) -> None:
        """Detections over the pole, at the antimeridian, with and without estimates, are taken like any other."""
        with self.opened() as sink:
            for window in awkward_windows().values():
                sink.write(window)
            _insist_accounts(sink.close(), sum(len(window.detections) for window in awkward_windows().values()))


def _insist_accounts(delivery: Delivery, events: int) -> None:
    insist(isinstance(delivery, Delivery), f"close returns {delivery!r}", "Return a Delivery.")
    told = (delivery.delivered, delivery.spooled, delivery.dropped, delivery.withheld)
    insist(
        min(told) >= 0 and sum(told) == events + delivery.recovered,
        f"of {events} events {told[0]} are delivered, {told[1]} spooled, {told[2]} dropped and {told[3]} withheld",
        "Count in write; close waits for what is under way, and returns a Delivery of all events written.",
    )


def _part(window: Window, rows: slice) -> Window:
    return evolve(window, detections=window.detections.take(rows), truth=window.truth.take(rows), tracks=Tracks.empty())


def _json_of(line: bytes, name: str) -> Any:
    def refuse(word: str) -> None:
        raise ValueError(f"{word} is not JSON")

    try:
        return json.loads(line, parse_constant=refuse)
    except ValueError as error:
        raise Broken(f"{name}: a line is not JSON: {error}", "Write null for what is unknown, never NaN.") from error


@contextmanager
def _empty_folder() -> Iterator[None]:
    here = os.getcwd()  # noqa: PTH109 - to come back to
    with tempfile.TemporaryDirectory(prefix="opir-check-") as folder:
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(here)
