"""Conformance tests of event encoders and sinks."""

import hashlib
import json
import os
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from attrs import evolve, fields_dict

from opir_core import ModelError, Plan, SceneError, SinkError, plan_windows
from opir_core.live import LiveRun, LiveSettings
from opir_core.output import (
    SCHEMA_VERSION,
    TRACKS_VERSION,
    OutputFiles,
    RunOutcome,
    deliver,
    event_counter,
    only_encodable,
    opened_sink,
    schema,
)
from opir_core.plugin import Component, Delivery, Encoder, EncoderContext, EventEncoder, Sink, SinkModel, Tracks, Window
from opir_core.random_streams import uuid_text
from opir_core.scene import Choice
from opir_testing.bench import bench_scene, encoder_of, planned
from opir_testing.contracts.contract import (
    ConformanceError,
    Contract,
    require,
    require_complete_abilities,
    require_no_outside_inputs,
    require_pickling,
)
from opir_testing.doubles import stub_estimates, stub_regions, stub_window
from opir_testing.json_schema import schema_errors

#: The scene time of a cycle of the live run, ns, and the time in which it ends, s; pauses between two looks at it, s.
_CYCLE_NS = 5_000_000_000
_LIVE_S = 20.0
_POLL_S = 0.01

_OPENING = (
    "Derive the class from opir_core.plugin.Sink. If it writes a file, open the path that context.stage(path) returns:"
    " a file that exists and is empty, to be filled in place."
)
_RESUMING = "If context.resumes, append to the output; or raise SinkError in build if it can have no spool."


def edge_case_windows() -> Mapping[str, Window]:
    """Return windows of edge cases of sensor 0, by description."""
    pole, edge, zero = [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], np.zeros(3)
    known = stub_estimates(
        2,
        state=[6.5e6, 1.0, 2.0, 10.0, 20.0, 30.0],
        launch=[np.pi / 2, np.pi, 1.0],
        launch_covariance=[[4.0, 1.0, 0.0], [1.0, 9.0, 0.0], [0.0, 0.0, 0.25]],
        impact=[-np.pi / 2, -np.pi, 2.0],
        impact_covariance=[[1e6, 0.0, 0.0], [0.0, 1e6, 0.0], [0.0, 0.0, 4.0]],
    )
    with_regions = evolve(
        known,
        impact_regions=stub_estimates(
            2, impact_regions=[stub_regions(89.5, 0.0), stub_regions(9.0, 180.0)]
        ).impact_regions,
        impact_method=np.array([0, 1], dtype=np.uint8),
    )
    return {
        "one detection": stub_window(1),
        "many detections": stub_window(300),
        "over the pole": stub_window(3, line_of_sight_ecef=pole, sensor_ecef_m=[0.0, 0.0, 4.2e7]),
        "at the antimeridian": stub_window(3, sensor_ecef_m=[-4.2e7, -1e-3, 0.0], line_of_sight_ecef=edge),
        "with an estimate": stub_window(2, track=0, estimate=0, estimates=known),
        "with unknown estimates": stub_window(2, track=7, estimate=1, estimates=stub_estimates(2)),
        "with unknown values": stub_window(2, snr=np.nan, confidence=0.0, bands=0),
        "with tracks": evolve(
            stub_window(2, track=0, estimate=0, estimates=known),
            tracks=Tracks.concatenate([with_regions, stub_estimates(2, tick_s=[1.0, 2.0])]),
        ),
        "with tracks alone": evolve(stub_window(0), tracks=with_regions),
        "with full confidence": stub_window(2, snr=1e6, confidence=1.0, line_of_sight_sigma_rad=zero[0]),
    }


class OutputContract(Contract):
    """What conformance tests of encoders and sinks share: the plan and the windows of the test scene."""

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

    kind: ClassVar[type[Component]] = EventEncoder

    @classmethod
    @cache
    def encoder(cls) -> Encoder:
        """Return the built encoder, for the sensors of the test scene."""
        context = EncoderContext(sensors=cls.plan().sensors, epoch_us=cls.plan().scene.epoch_us)
        return cls.built(Encoder, cls.config(), context)

    @classmethod
    def part(cls) -> Any:
        """Return the built encoder."""
        return cls.encoder()

    def test_media_type_and_schema_version_are_stated(self) -> None:
        """The encoder states a media type and a schema version."""
        encoder: Any = self.encoder()
        valid = encoder.content_type.count("/") == 1 and encoder.schema_version.strip()
        require(valid, "content_type or schema_version is invalid", "Set a media type, type/subtype, and a version.")

    def test_each_detection_is_one_line(self) -> None:
        """Each encodable detection, or track, is one line, ended by its only newline; none of them give no bytes."""
        encoder = self.encoder()
        rows = "tracks" if encoder.encodes_tracks else "detections"
        for name, window in {**edge_case_windows(), "empty": stub_window(0)}.items():
            text: Any = encoder.encode(window)
            expected = event_counter(encoder)(only_encodable(window, encoder))
            require(
                isinstance(text, bytes) and text.count(b"\n") == expected and text[-1:] in (b"", b"\n"),
                f"a window of {expected} {rows} ({name}) gives {text.count(bytes([10]))} lines",
                f"Return bytes: one line for each of the {rows}, ended by a newline, with escapes inside.",
            )

    def test_encoders_of_tracks_are_marked(self) -> None:
        """The component states `encodes_tracks` if, and only if, its encoder does."""
        states, is_one = self.component().encodes_tracks, self.encoder().encodes_tracks
        require(
            states == is_one,
            f"the component states encodes_tracks={states}, its encoder {is_one}",
            "Set encodes_tracks in EventEncoder(...) and in the encoder.",
        )

    def test_windows_encode_alone_as_together(self) -> None:
        """Windows cut in two give the same bytes, and so does the same window twice."""
        encoder = self.encoder()
        for window in self.windows():
            part = _part_of_tracks if encoder.encodes_tracks else _part
            middle = event_counter(encoder)(window) // 2
            halves = (part(window, slice(0, middle)), part(window, slice(middle, None)))
            same = encoder.encode(window) == b"".join(map(encoder.encode, halves))
            require(same, "a window cut in two gives other bytes", "Encode each row from its own columns alone.")

    def test_no_truth_is_written(self) -> None:
        """The truth changes no byte."""
        encoder = self.encoder()
        for window in self.windows():
            if len(window.truth):
                changed = evolve(window.truth, range_m=window.truth.range_m + 1e6, target=window.truth.target[::-1])
                same = encoder.encode(window) == encoder.encode(evolve(window, truth=changed))
                require(same, "the bytes depend on the truth", "Use window.detections and window.estimates only.")

    def test_json_follows_the_schema(self) -> None:
        """A JSON media type means JSON without NaN; with a schema version of the core, events conform to its schema."""
        encoder = self.encoder()
        if "json" not in encoder.content_type:
            return
        name_of = {SCHEMA_VERSION: "detection", TRACKS_VERSION: "track"}.get(encoder.schema_version)
        due = None if name_of is None else schema(name_of)
        for name, window in edge_case_windows().items():
            for line in encoder.encode(window).splitlines():
                event = _json_of(line, name)
                errors = [] if due is None else schema_errors(event, due)
                require(not errors, f"{name}: {'; '.join(errors[:3])}", f"See opir schema {name_of}.")

    def test_clock_network_and_global_random_state_are_not_used(self) -> None:
        """Clock, entropy, network and global random state are not used."""
        change = "Take the time and the id of an event from its detection."
        require_no_outside_inputs(lambda: [self.encoder().encode(window) for window in self.windows()], change)

    def test_a_built_encoder_pickles(self) -> None:
        """The built encoder can be pickled, and its copy returns the same bytes."""
        window = self.windows()[2]
        same = require_pickling(self.encoder()).encode(window) == self.encoder().encode(window)
        require(same, "a pickled copy returns other bytes", "Keep all state in fields that pickle.")


class SinkContract(OutputContract):
    """Conformance tests of a sink, in an empty folder; a setting `path` gets a file there."""

    kind: ClassVar[type[Component]] = SinkModel

    @classmethod
    def block(cls) -> Mapping[str, Any]:
        """Return the settings, with a file if the sink needs one."""
        needs_path = "path" in fields_dict(cls.component().config) and "path" not in cls.settings
        return {**cls.settings, **({"path": "events.out"} if needs_path else {})}

    @classmethod
    def part(cls) -> Any:
        """Return the built sink, closed."""
        with cls().opened() as sink:
            sink.close()
        return sink

    @contextmanager
    def opened(self) -> Iterator[Sink]:
        """Yield the built sink, in an empty folder, with files as a batch run places them: empty, to be renamed."""
        with _empty_folder():
            files = OutputFiles()
            try:
                yield self.opened_with(files)
            finally:
                files.abandon()

    def opened_with(self, files: OutputFiles) -> Sink:
        """Return the built sink, with its files placed as those of a batch run."""
        choice = Choice(SinkModel.hook, self.name, self.config(), "outputs[0]")
        try:
            return opened_sink(self.plan(), choice, files.stage, is_checked=False)
        except ModelError as error:
            raise ConformanceError(str(error).partition("; ")[0], _OPENING) from error

    @classmethod
    def run_plan(cls, duration_s: float = 90.0, **settings: Any) -> Plan:
        """Return the plan of the test scene with the sink as its output; `settings` are added to its block."""
        outputs = [{cls.name: {**cls.block(), **settings}}]
        return planned(bench_scene(outputs=outputs, duration_s=duration_s), cls.host())

    def test_every_event_is_accounted_for(self) -> None:
        """Delivered, spooled, dropped and withheld events add up to the events written."""
        with self.opened() as sink:
            for window in self.windows():
                sink.write(window)
            events = sum(len(window.detections) for window in self.windows())
            so_far = sink.delivery_so_far()
            if so_far is not None:
                _require_accounts(so_far, events)
            _require_accounts(sink.close(), events)

    def test_optional_abilities_are_complete(self) -> None:
        """An optional ability is implemented completely or not at all."""
        with self.opened() as sink:
            require_complete_abilities(Sink, sink, [("waits", "outlives_the_process")])
            sink.close()

    def test_a_sink_without_windows_delivers_nothing(self) -> None:
        """A sink closed without windows has delivered nothing."""
        with self.opened() as sink:
            _require_accounts(sink.close(), 0)

    def test_windows_without_events_are_accepted(self) -> None:
        """Windows without events are accepted."""
        with self.opened() as sink:
            for count in (0, 3, 0):
                sink.write(stub_window(count))
            _require_accounts(sink.close(), 3)

    def test_windows_are_not_modified(self) -> None:
        """A sink does not change its windows: other sinks get the same ones."""
        before = [encoder_of(self.plan()).encode(window) for window in self.windows()]
        with self.opened() as sink:
            for window in self.windows():
                sink.write(window)
            sink.close()
        after = [encoder_of(self.plan()).encode(window) for window in self.windows()]
        require(before == after, "a window changes when it is written", "Copy columns before changing them.")

    def test_edge_case_windows_are_accepted(self) -> None:
        """Detections over the pole, at the antimeridian, with and without estimates are accepted."""
        with self.opened() as sink:
            for window in edge_case_windows().values():
                sink.write(window)
            _require_accounts(sink.close(), sum(len(window.detections) for window in edge_case_windows().values()))

    def test_a_batch_run_succeeds_and_succeeds_again(self) -> None:
        """A run like that of `opir run` writes all events to staged files: empty ones, put in place at the end; so twice."""
        with _empty_folder():
            for run in ("the first run", "a second run in the same folder"):
                _require_run(deliver(self.run_plan(), manifest_path=Path("manifest.json")), run)

    def test_a_live_run_succeeds(self) -> None:
        """A live run writes windows, most of them empty, and closes the sink, from a thread that has not opened it."""
        with _empty_folder():
            plan = self.run_plan()
            run = LiveRun(plan.scene, plan.host, LiveSettings(speed=None, cycle_ns=_CYCLE_NS))
            run.start()
            limit_s = time.monotonic() + _LIVE_S
            while run.state == "running" and time.monotonic() < limit_s:
                time.sleep(_POLL_S)
            status = run.stop(_LIVE_S)
        (sink,) = status.sinks
        require(
            status.state == "stopped" and sink.state == "closed" and not sink.unbalanced,
            f"the run is {status.state}, the sink {sink.state} ({sink.error or status.error or 'events are missing'})",
            "Open, write and close from any thread, and return within seconds.",
        )

    def test_a_run_with_a_spool_continues_its_output(self) -> None:
        """With a spool, a second run keeps what the first one has delivered; a sink that cannot says so at once."""
        with _empty_folder():
            spool = {"path": "events.spool"}
            try:
                outcome = deliver(self.run_plan(spool=spool))
            except ModelError as error:
                raise ConformanceError(str(error).partition("; ")[0], _RESUMING) from error
            except (SceneError, SinkError):
                return
            _require_run(outcome, "a run with a spool")
            before = _sizes()
            _require_run(deliver(self.run_plan(45.0, spool=spool)), "a second run with the same spool")
            shorter = [name for name, size in before.items() if _sizes().get(name, 0) < size and "spool" not in name]
            require(
                not shorter,
                f"a second run with the same spool makes {', '.join(shorter)} shorter: delivered events are lost",
                _RESUMING,
            )

    def test_truth_is_read_back(self) -> None:
        """A sink that also writes the truth reads it back: the records of targets, then each detection by its id."""
        opened, read = self.component().open_truth, self.component().read_truth
        require((opened is None) == (read is None), "it only writes or only reads truth", "Set both or neither.")
        if opened is None:
            return
        records = [{"record": "target", "target_id": id_} for id_ in self.plan().targets.ids]
        with tempfile.TemporaryDirectory(prefix="opir-check-") as folder:
            path = Path(folder) / "events.truth"
            with opened(path, path, self.plan().targets.ids, records) as file:
                for window in self.windows():
                    file.write(window)
            rows = list(read(path))
        ids = [text for window in self.windows() for text in uuid_text(window.detections.detection_id)]
        require(rows[: len(records)] == records, "the records of targets are lost", "Keep the records as they are.")
        same = [row.get("detection_id") for row in rows[len(records) :]] == ids
        require(same, "the detections read are not those written", "Write a row for each detection, in their order.")


def _require_accounts(delivery: Delivery, events: int) -> None:
    require(isinstance(delivery, Delivery), f"close returns {delivery!r}", "Return a Delivery.")
    counts = (delivery.delivered, delivery.spooled, delivery.dropped, delivery.withheld)
    require(
        min(counts) >= 0 and sum(counts) == events + delivery.recovered,
        f"of {events} events {counts[0]} are delivered, {counts[1]} spooled, {counts[2]} dropped, {counts[3]} withheld",
        "Count events in write; close waits for pending events and returns the Delivery of all.",
    )


def _require_run(outcome: RunOutcome, run: str) -> None:
    """Require that a batch run has delivered all events, and that its files are what the manifest says."""
    report = outcome.report.sinks[0]
    require(
        report.error is None,
        f"{run} fails: {report.error}",
        _OPENING,
    )
    _require_accounts(
        Delivery(report.delivered, report.spooled, report.dropped, report.withheld, report.recovered),
        outcome.report.events,
    )
    for file in outcome.manifest["written_files"]:
        content = Path(file["name"]).read_bytes()
        require(
            len(content) == file["bytes"] and hashlib.sha256(content).hexdigest() == file["sha256"],
            f"after {run} {file['name']} has {len(content)} bytes, and the staged file has {file['bytes']}",
            "Fill the staged file and close it in close; do not replace it by another file.",
        )


def _sizes() -> Mapping[str, int]:
    """Return the sizes of the files in this folder, bytes."""
    return {str(path): path.stat().st_size for path in Path.cwd().rglob("*") if path.is_file()}


def _part(window: Window, rows: slice) -> Window:
    return evolve(window, detections=window.detections.take(rows), truth=window.truth.take(rows), tracks=Tracks.empty())


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


@contextmanager
def _empty_folder() -> Iterator[None]:
    here = os.getcwd()  # noqa: PTH109
    with tempfile.TemporaryDirectory(prefix="opir-check-") as folder:
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(here)
