"""Conformance tests of event encoders, and what they share with those of sinks."""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from attrs import evolve

from opir_core import Plan, plan_windows
from opir_core.output import event_counter, framed_messages, only_encodable
from opir_core.plugin import (
    Encoder,
    EncoderContext,
    EventEncoder,
    Hypothesis,
    Tracks,
    Window,
)
from opir_testing.bench import bench_scene, planned
from opir_testing.contracts.contract import (
    ConformanceError,
    Contract,
    require,
    require_equal,
    require_no_outside_inputs,
    require_pickling,
)
from opir_testing.doubles import stub_estimates, stub_regions, stub_window
from opir_testing.json_schema import schema_errors


def edge_case_windows(hypotheses: Sequence[Hypothesis] = ()) -> Mapping[str, Window]:
    """Return windows of edge cases of sensor 0, by description.

    With `hypotheses` there is one more, whose tracks weigh them.
    """
    pole = [0.0, 0.0, -1.0]
    edge = [-1.0, 0.0, 0.0]
    estimates = _estimates_at_poles()
    with_regions = evolve(
        estimates,
        impact_regions=stub_estimates(
            2, impact_regions=[stub_regions(89.5, 0.0), stub_regions(9.0, 180.0)]
        ).impact_regions,
        impact_method=np.array([0, 1], dtype=np.uint8),
    )
    return {
        "one detection": stub_window(1),
        "many detections": stub_window(300),
        "over the pole": stub_window(3, line_of_sight_ecef=pole, sensor_ecef_m=[0.0, 0.0, 4.2e7]),
        "at the antimeridian": stub_window(
            3, sensor_ecef_m=[-4.2e7, -1e-3, 0.0], line_of_sight_ecef=edge
        ),
        "with an estimate": stub_window(2, track=0, estimate=0, estimates=estimates),
        "with unknown estimates": stub_window(2, track=7, estimate=1, estimates=stub_estimates(2)),
        "with unknown values": stub_window(2, snr=np.nan, confidence=0.0, bands=0),
        "with tracks": evolve(
            stub_window(2, track=0, estimate=0, estimates=estimates),
            tracks=Tracks.concatenate([with_regions, stub_estimates(2, tick_s=[1.0, 2.0])]),
        ),
        "with tracks alone": evolve(stub_window(0), tracks=with_regions),
        "with full confidence": stub_window(
            2, snr=1e6, confidence=1.0, line_of_sight_sigma_rad=0.0
        ),
        **({"with hypotheses": _weighed_window(hypotheses)} if hypotheses else {}),
    }


def _estimates_at_poles() -> Tracks:
    """Return estimates with a launch and an impact at the poles."""
    return stub_estimates(
        2,
        state=[6.5e6, 1.0, 2.0, 10.0, 20.0, 30.0],
        launch=[np.pi / 2, np.pi, 1.0],
        launch_covariance=[[4.0, 1.0, 0.0], [1.0, 9.0, 0.0], [0.0, 0.0, 0.25]],
        impact=[-np.pi / 2, -np.pi, 2.0],
        impact_covariance=[[1e6, 0.0, 0.0], [0.0, 1e6, 0.0], [0.0, 0.0, 4.0]],
    )


def _weighed_window(hypotheses: Sequence[Hypothesis]) -> Window:
    """Return a window of a track that is certain of the last hypothesis, and one without any."""
    chances = np.zeros((2, len(hypotheses)))
    chances[0, -1] = 1.0
    chances[1] = np.nan
    region = stub_regions(9.0, 180.0, condition="relights", probability=0.1, effective_samples=12.0)
    estimates = stub_estimates(
        2,
        hypotheses,
        track=[0, 1],
        hypothesis_probability=chances,
        end=[1, 0],
        impact=0.1,
        impact_regions=[region, ()],
    )
    return evolve(
        stub_window(2, track=[0, 1], estimate=[0, 1], estimates=estimates), tracks=estimates
    )


class OutputContract(Contract):
    """What conformance tests of encoders and sinks share: the plan and the windows of the test
    scene.
    """

    @classmethod
    @cache
    def plan(cls) -> Plan:
        """Return the plan of the test scene."""
        return planned(bench_scene(), cls.host())

    @classmethod
    @cache
    def windows(cls) -> tuple[Window, ...]:
        """Return the windows of the test scene, some of them empty."""
        return tuple(plan_windows(cls.plan(), 10.0))


class EncoderContract(OutputContract):
    """Conformance tests of an event encoder."""

    kind = EventEncoder

    @classmethod
    @cache
    def encoder(cls) -> Encoder:
        """Return the built encoder, for the sensors of the test scene."""
        plan = cls.plan()
        context = EncoderContext(
            sensors=plan.sensors, epoch_us=plan.scene.epoch_us, hypotheses=plan.hypothesis_names
        )
        return cls.built(Encoder, cls.config(), context)

    @classmethod
    def part(cls) -> Any:
        """Return the built encoder."""
        return cls.encoder()

    def test_media_type_and_schema_version_are_stated(self) -> None:
        """The encoder states a media type and a schema version."""
        encoder: Any = self.encoder()
        valid = encoder.content_type.count("/") == 1 and encoder.schema_version.strip()
        require(
            valid,
            "content_type or schema_version is invalid",
            "Set a media type, type/subtype, and a version.",
        )

    def test_each_detection_is_one_line(self) -> None:
        """Each encodable detection, or track, is one line, ended by its only newline, or one binary
        message after its length; none of them give no bytes.
        """
        encoder = self.encoder()
        rows = "tracks" if encoder.encodes_tracks else "detections"
        for name, window in {
            **edge_case_windows(self.plan().hypotheses),
            "empty": stub_window(0),
        }.items():
            text: Any = encoder.encode(window)
            expected = event_counter(encoder)(only_encodable(window, encoder))
            messages = framed_messages(text) if isinstance(text, bytes) else []
            require(
                b"".join(messages) == text and len(messages) == expected,
                f"a window of {expected} {rows} ({name}) gives {len(messages)} lines",
                f"Return bytes: one line for each of the {rows}, ended by a newline, with escapes"
                f" inside; or opir_core.output.binary_body(messages).",
            )

    def test_encoders_of_tracks_are_marked(self) -> None:
        """The component states `encodes_tracks` if, and only if, its encoder does."""
        states = self.component().encodes_tracks
        is_one = self.encoder().encodes_tracks
        require(
            states == is_one,
            f"the component states encodes_tracks={states}, its encoder {is_one}",
            "Set encodes_tracks in EventEncoder(...) and in the encoder.",
        )

    def test_windows_encode_alone_as_together(self) -> None:
        """Windows cut in two give the same bytes, and so does the same window twice."""
        encoder = self.encoder()
        for window in self.windows():
            part_of = _part_of_tracks if encoder.encodes_tracks else _part
            middle = event_counter(encoder)(window) // 2
            halves = (part_of(window, slice(0, middle)), part_of(window, slice(middle, None)))
            is_equal = encoder.encode(window) == b"".join(map(encoder.encode, halves))
            require_equal(
                is_equal,
                "a window cut in two gives other bytes",
                "Encode each row from its own columns alone.",
            )

    def test_no_truth_is_written(self) -> None:
        """The truth changes no byte."""
        encoder = self.encoder()
        for window in self.windows():
            if len(window.truth):
                changed = evolve(
                    window.truth,
                    range_m=window.truth.range_m + 1e6,
                    target=window.truth.target[::-1],
                )
                is_equal = encoder.encode(window) == encoder.encode(evolve(window, truth=changed))
                require_equal(
                    is_equal,
                    "the bytes depend on the truth",
                    "Use window.detections and window.estimates only.",
                )

    def test_json_follows_the_schema(self) -> None:
        """A JSON media type means JSON without NaN; where the component states a schema, events
        conform to it.
        """
        encoder = self.encoder()
        if "json" not in encoder.content_type:
            return
        component = self.component()
        schema = None if component.schema is None else json.loads(component.schema())
        for name, window in edge_case_windows(self.plan().hypotheses).items():
            for line in encoder.encode(window).splitlines():
                event = _json_of(line, name)
                errors = [] if schema is None else schema_errors(event, schema)
                require(
                    not errors,
                    f"{name}: {'; '.join(errors[:3])}",
                    f"See opir schema {component.name}.",
                )

    def test_clock_network_and_global_random_state_are_not_used(self) -> None:
        """Clock, entropy, environment, network and global random state are not used."""
        change = "Take the time and the id of an event from its detection."
        require_no_outside_inputs(self.use(), change)

    def exercise(self) -> object:
        """Build the encoder and encode the windows."""
        return [self.encoder().encode(window) for window in self.windows()]

    def test_a_built_encoder_pickles(self) -> None:
        """The built encoder can be pickled, and its copy returns the same bytes."""
        window = self.windows()[2]
        is_equal = require_pickling(self.encoder()).encode(window) == self.encoder().encode(window)
        require_equal(
            is_equal, "a pickled copy returns other bytes", "Keep all state in fields that pickle."
        )


def _part(window: Window, rows: slice) -> Window:
    return evolve(
        window,
        detections=window.detections.take(rows),
        truth=window.truth.take(rows),
        tracks=Tracks.empty(),
    )


def _part_of_tracks(window: Window, rows: slice) -> Window:
    return evolve(window, tracks=window.tracks.take(rows))


def _json_of(line: bytes, name: str) -> Any:
    def refuse(word: str) -> None:
        raise ValueError(f"{word} is not JSON")

    try:
        return json.loads(line, parse_constant=refuse)
    except ValueError as error:
        raise ConformanceError(
            f"{name}: a line is not JSON: {error}", "Write null for what is unknown, never NaN."
        ) from error
