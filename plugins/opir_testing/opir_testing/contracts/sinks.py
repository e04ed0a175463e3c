"""Conformance tests of sinks: each runs as in `opir run` and in a live run."""

import hashlib
import os
import tempfile
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from attrs import fields_dict

from opir_core import ModelError, Plan, SceneError, SinkError
from opir_core.interfaces import has_own
from opir_core.live import LiveRun, LiveSettings
from opir_core.output import OutputFiles, RunOutcome, deliver, opened_sink
from opir_core.plugin import Delivery, EventEncoder, Sink, SinkModel, Window
from opir_core.random_streams import uuid_text
from opir_core.scene import Choice
from opir_testing.bench import bench_scene, encoder_of, planned
from opir_testing.contracts.contract import (
    ConformanceError,
    require,
    require_complete_abilities,
    require_equal,
)
from opir_testing.contracts.outputs import OutputContract, edge_case_windows
from opir_testing.doubles import stub_window

#: The scene time of a cycle of the live run, ns, and the time in which it ends, s; pauses between
#: two looks at it, s.
_CYCLE_NS = 5_000_000_000
_LIVE_S = 20.0
_POLL_S = 0.01
_MANIFEST = "manifest.json"
_SPOOL = "waiting.spool"

_OPENING = (
    "Derive the class from opir_core.plugin.Sink. If it writes a file, open the path that"
    " context.stage(path) returns: a file that exists and is empty, to be filled in place."
)
_RESUMING = (
    "If context.resumes, append to the output; or raise SinkError in build if it can have no spool."
)


class SinkContract(OutputContract):
    """Conformance tests of a sink, in an empty folder; a setting `path` gets a file there."""

    kind = SinkModel

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
        """Yield the built sink, in an empty folder, with files as a batch run places them: empty,
        to be renamed.
        """
        with _empty_folder():
            files = OutputFiles()
            try:
                yield self.opened_with(files)
            finally:
                files.abandon()

    def exercise(self) -> object:
        """Open the sink, write the windows and close it."""
        with self.opened() as sink:
            for window in self.windows():
                sink.write(window)
            return sink.close()

    def opened_with(self, files: OutputFiles) -> Sink:
        """Return the built sink, with its files placed as those of a batch run."""
        choice = Choice(SinkModel.hook, self.name, self.config(), "outputs[0]")
        try:
            return opened_sink(self.plan(), choice, files.stage, is_checked=False)
        except ModelError as error:
            raise ConformanceError(str(error).partition("; ")[0], _OPENING) from error

    @classmethod
    def run_plan(cls, duration_s: float = 90.0, **settings: Any) -> Plan:
        """Return the plan of the test scene with the sink as its output; `settings` are added to
        its block.
        """
        outputs = [{cls.name: {**cls.block(), **settings}}]
        return planned(bench_scene(outputs=outputs, duration_s=duration_s), cls.host())

    @classmethod
    def count(cls, window: Window) -> int:
        """Return the number of a window's events: of its tracks if the settings' encoder encodes
        these, else of its detections.
        """
        name = getattr(cls.config(), "encoder", "forge")
        encodes_tracks = cls.host().component(EventEncoder, name).encodes_tracks
        return len(window.tracks if encodes_tracks else window.detections)

    def test_every_event_is_accounted_for(self) -> None:
        """Delivered, spooled, dropped and withheld events add up to the events written."""
        with self.opened() as sink:
            for window in self.windows():
                sink.write(window)
            events = sum(map(self.count, self.windows()))
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
        self._require_written([])

    def test_windows_without_events_are_accepted(self) -> None:
        """Windows without events are accepted."""
        self._require_written([stub_window(count) for count in (0, 3, 0)])

    def test_windows_are_not_modified(self) -> None:
        """A sink does not change its windows: other sinks get the same ones."""
        messages = [encoder_of(self.plan()).encode(window) for window in self.windows()]
        with self.opened() as sink:
            for window in self.windows():
                sink.write(window)
            sink.close()
        repeated = [encoder_of(self.plan()).encode(window) for window in self.windows()]
        require(
            messages == repeated,
            "a window changes when it is written",
            "Copy columns before changing them.",
        )

    def test_edge_case_windows_are_accepted(self) -> None:
        """Detections over the pole, at the antimeridian, with and without estimates are
        accepted.
        """
        self._require_written(edge_case_windows().values())

    def test_what_is_synced_is_in_the_file(self) -> None:
        """After `sync` the file of a sink that has one holds what was written."""
        with self.opened() as sink:
            if not has_own(Sink, sink, "sync"):
                sink.close()
                return
            sink.sync()
            head = _sizes()
            sink.write(stub_window(3))
            sink.sync()
            synced = _sizes()
            sink.close()
            require(
                synced != head or _sizes() == head,
                "sync leaves what was written out of the file, and close adds it",
                "Flush the file in sync, and call os.fsync: a spool drops the events after it.",
            )

    def test_a_run_that_is_given_up_leaves_no_file(self) -> None:
        """A run that fails leaves no file: those of the sink are staged."""
        with _empty_folder():
            files = OutputFiles()
            sink = self.opened_with(files)
            for window in self.windows():
                sink.write(window)
            sink.close()
            files.abandon()
            require(
                not _sizes(),
                f"after a run that was given up there is {', '.join(_sizes())}",
                "Open what `context.stage(path)` returns, unless the context resumes.",
            )

    def test_a_batch_run_succeeds_and_succeeds_again(self) -> None:
        """A run like that of `opir run` writes all events, to files that exist and are empty, put
        in place later.
        """
        with _empty_folder():
            for run in ("the first run", "a second run in the same folder"):
                self._require_run(self.run_plan(), run, _OPENING)

    def test_a_live_run_succeeds(self) -> None:
        """A live run writes windows, most of them empty, and closes the sink, from a thread that
        has not opened it.
        """
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
            f"the run is {status.state}, the sink {sink.state}"
            f" ({sink.error or status.error or 'events are missing'})",
            "Open, write and close from any thread, and return within seconds.",
        )

    def test_a_run_with_a_spool_continues_its_output(self) -> None:
        """With a spool, a second run keeps what the first one has delivered; a sink that cannot
        says so at once.
        """
        with _empty_folder():
            spool = {"path": _SPOOL}
            try:
                self._require_run(self.run_plan(spool=spool), "a run with a spool", _RESUMING)
            except (SceneError, SinkError):
                return
            messages = _sizes()
            again = "a second run with the same spool"
            self._require_run(self.run_plan(45.0, spool=spool), again, _RESUMING)
            shorter = [name for name, size in messages.items() if _sizes().get(name, 0) < size]
            require(
                not shorter,
                f"a second run with the same spool makes {', '.join(shorter)} shorter: delivered"
                f" events are lost",
                _RESUMING,
            )

    def test_truth_is_read_back(self) -> None:
        """A sink that also writes the truth reads it back: the records of targets, then each
        detection by its id.
        """
        opened = self.component().open_truth
        read = self.component().read_truth
        require(
            (opened is None) == (read is None),
            "it only writes or only reads truth",
            "Set both or neither.",
        )
        if opened is None:
            return
        records = [{"record": "target", "target_id": id_} for id_ in self.plan().targets.ids]
        with tempfile.TemporaryDirectory(prefix="opir-check-") as folder:
            path = Path(folder) / "events.truth"
            with opened(path, path, self.plan().targets.ids, records) as file:
                for window in self.windows():
                    file.write(window)
            rows = list(read(path))
        ids = [
            text for window in self.windows() for text in uuid_text(window.detections.detection_id)
        ]
        require(
            rows[: len(records)] == records,
            "the records of targets are lost",
            "Keep the records as they are.",
        )
        is_equal = [row.get("detection_id") for row in rows[len(records) :]] == ids
        require_equal(
            is_equal,
            "the detections read are not those written",
            "Write a row for each detection, in their order.",
        )

    def _require_written(self, windows: Collection[Window]) -> None:
        """Require that a sink accounts for the events of windows."""
        with self.opened() as sink:
            for window in windows:
                sink.write(window)
            _require_accounts(sink.close(), sum(map(self.count, windows)))

    def _require_run(self, plan: Plan, run: str, change: str) -> None:
        """Require that a batch run delivers all events, and that its files are what the manifest
        says; `change` is the remedy if the sink cannot be built.
        """
        written: list[int] = []
        try:
            outcome = deliver(
                plan,
                manifest_path=Path(_MANIFEST),
                on_window=lambda window: written.append(self.count(window)),
            )
        except ModelError as error:
            raise ConformanceError(str(error).partition("; ")[0], change) from error
        report = outcome.report.sinks[0]
        require(report.error is None, f"{run} fails: {report.error}", _OPENING)
        _require_accounts(
            Delivery(
                report.delivered, report.spooled, report.dropped, report.withheld, report.recovered
            ),
            sum(written),
        )
        _require_files(outcome, run)


def _require_accounts(delivery: Delivery, events: int) -> None:
    require(isinstance(delivery, Delivery), f"close returns {delivery!r}", "Return a Delivery.")
    counts = (delivery.delivered, delivery.spooled, delivery.dropped, delivery.withheld)
    require(
        min(counts) >= 0 and sum(counts) == events + delivery.recovered,
        f"of {events} events {counts[0]} are delivered, {counts[1]} spooled, {counts[2]} dropped,"
        f" {counts[3]} withheld",
        "Count events in write; close waits for pending events and returns the Delivery of all.",
    )


def _require_files(outcome: RunOutcome, run: str) -> None:
    """Require that the files of a batch run are what its manifest says."""
    for file in outcome.manifest["written_files"]:
        content = Path(file["name"]).read_bytes()
        require(
            len(content) == file["bytes"] and hashlib.sha256(content).hexdigest() == file["sha256"],
            f"after {run} {file['name']} has {len(content)} bytes, and the staged file has"
            f" {file['bytes']}",
            "Fill the staged file and close it in close; do not replace it by another file.",
        )


def _sizes() -> Mapping[str, int]:
    """Return the sizes of the sink's files in this folder, bytes."""
    files = (
        path
        for path in Path().rglob("*")
        if path.is_file() and path.name not in (_MANIFEST, _SPOOL)
    )
    return {str(path): path.stat().st_size for path in files}


@contextmanager
def _empty_folder() -> Iterator[None]:
    working_folder = os.getcwd()  # noqa: PTH109
    with tempfile.TemporaryDirectory(prefix="opir-check-") as folder:
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(working_folder)
