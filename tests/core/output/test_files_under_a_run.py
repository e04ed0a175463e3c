"""Files that another process removes, cuts off or replaces under a run: the run says so and ends
with its exit code, and calls nothing delivered that is in no file.
"""

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from spool_transports import ENCODER, MIB, SENSORS, Holding, spooled, window
from waiting import until

from opir_core import compile_plan
from opir_core.cli.main import main
from opir_core.errors import SinkError
from opir_core.live import LiveRun, LiveSettings
from opir_core.output import deliver
from opir_core.output.run_files import CommandsFile
from opir_core.output.spool import Journal
from opir_core.output.spool.batches import EncodedBatcher
from opir_core.output.temporary_files import GrowingFile
from opir_core.plugin import Host
from opir_core.reading import scene_from_mapping
from opir_core.simulation.run import plan_windows

SCENE: Mapping[str, Any] = {
    "scene": "under",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 40.0,
    "seed": 1,
    "sensors": [{"constellation": "SBIRS-GEO"}],
    "targets": [
        {
            "id": "T1",
            "type": "ICBM",
            "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 1.0},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
        }
    ],
}


def removed(path: Path) -> None:
    path.unlink()


def replaced(path: Path) -> None:
    other = path.with_name("other")
    other.write_bytes(b"")
    other.replace(path)


def cut(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


HARMS = pytest.mark.parametrize("harm", [removed, replaced, cut])


class Once:
    """Harms a file after the third window with events."""

    def __init__(self, harm: Callable[[Path], None], path: Path) -> None:
        self._harm = harm
        self._path = path
        self._windows = 0
        self.events = 0

    def __call__(self, window: Any) -> None:
        if self._windows == 3:
            return
        events = len(getattr(window, "window", window).detections)
        self._windows += events > 0
        self.events += events
        if self._windows == 3:
            self._harm(self._path)


@pytest.fixture
def acknowledged(monkeypatch: pytest.MonkeyPatch) -> list[Journal]:
    """Return the journals of the acknowledgements so far."""
    journals = []
    take = Journal.acknowledge

    def acknowledge(journal: Journal, numbers: Any) -> None:
        take(journal, numbers)
        journals.append(journal)

    monkeypatch.setattr(Journal, "acknowledge", acknowledge)
    return journals


def is_empty(journals: list[Journal]) -> bool:
    return bool(journals) and journals[-1].waiting == 0


def scene_of(output: Mapping[str, Any]) -> Any:
    return scene_from_mapping({**SCENE, "outputs": [{"jsonl": output}]})


def lines_in(path: Path) -> int:
    return path.read_bytes().count(b"\n") if path.is_file() else 0


def batch_run(folder: Path, on_window: Any, **spool: Any) -> Any:
    plan = compile_plan(scene_of({"path": str(folder / "e.jsonl"), **spool}))
    return deliver(
        plan,
        truth_path=folder / "e.truth.jsonl",
        manifest_path=folder / "e.manifest.json",
        on_window=on_window,
        windows=plan_windows(plan, 2.0),
    )


@HARMS
@pytest.mark.parametrize("name", ["e.jsonl", "e.truth.jsonl", "e.manifest.json"])
def test_files_of_a_batch_run(name: str, harm: Any, tmp_path: Path) -> None:
    path = tmp_path / f"{name}.part"
    if name == "e.manifest.json" and harm is cut:
        harm = lambda _: None  # noqa: E731 - it is empty until the end
    ending = None
    try:
        outcome = batch_run(tmp_path, Once(harm, path))
        outcome.raise_for_failures()
    except SinkError as error:
        ending = error
    manifest = tmp_path / "e.manifest.json"
    if ending is None:
        assert name == manifest.name
        for entry in json.loads(manifest.read_text())["written_files"]:
            content = (tmp_path / entry["name"]).read_bytes()
            assert hashlib.sha256(content).hexdigest() == entry["sha256"]
        return
    assert ending.exit_code == 5
    assert "another process" in str(ending)
    assert str(tmp_path / name) in str(ending)
    assert not manifest.exists()
    assert not (tmp_path / "e.jsonl").exists()


@HARMS
@pytest.mark.parametrize("name", ["e.jsonl", "e.spool", "e.spool-wal"])
def test_files_of_a_spooled_batch_run(
    name: str, harm: Any, tmp_path: Path, acknowledged: list[Journal]
) -> None:
    spool = {"path": str(tmp_path / "e.spool"), "survives_power_cut": True}
    lines = tmp_path / "e.jsonl"

    def harmed_at_rest(path: Path) -> None:
        """The spool's thread writes the lines, and then the log: a cut between is another case."""
        until(lambda: lines_in(lines) == harmed.events and is_empty(acknowledged))
        harm(path)

    harmed = Once(harmed_at_rest, tmp_path / name)
    outcome = batch_run(tmp_path, harmed, spool=spool)
    with pytest.raises(SinkError, match="another process") as ending:
        outcome.raise_for_failures()
    assert ending.value.exit_code == 5
    (delivery,) = outcome.report.sinks
    taken = outcome.report.events
    assert delivery.delivered + delivery.spooled + delivery.dropped == taken
    if name == "e.jsonl":
        assert delivery.spooled > 0
        assert delivery.delivered <= harmed.events
    else:
        assert delivery.delivered == lines_in(lines)
        assert delivery.spooled == 0


@HARMS
@pytest.mark.parametrize("name", ["spool", "spool-wal"])
@pytest.mark.parametrize("is_acknowledged", [False, True])
def test_a_spool_before_a_transport(
    name: str, harm: Any, is_acknowledged: bool, tmp_path: Path
) -> None:
    carrier = Holding("take" if is_acknowledged else "hold")
    sink = spooled(tmp_path / "spool", carrier)
    sink.write(window(500))
    if is_acknowledged:
        until(lambda: sink.delivery_so_far().delivered == 500)
    assert sink.parked is None
    harm(tmp_path / name)
    assert "another process" in str(sink.parked)
    assert sink.outlives_the_process is False
    sink.write(window(100, 500))
    delivery = sink.close()
    assert f"the spool {tmp_path / 'spool'} cannot be written: the file or its log: another" in (
        delivery.complaint or ""
    )
    assert (delivery.spooled, delivery.delivered + delivery.dropped) == (0, 600)
    assert delivery.delivered <= len(carrier.ids)
    assert delivery.delivered >= 500 * is_acknowledged


@HARMS
@pytest.mark.parametrize("is_spooled", [False, True])
def test_the_file_of_a_live_run(is_spooled: bool, harm: Any, tmp_path: Path) -> None:
    path = tmp_path / "e.jsonl"
    spool = {"spool": {"path": str(tmp_path / "e.spool")}} if is_spooled else {}

    def harmed(live: Any) -> None:
        if live.window.start_s == 20.0:
            until(lambda: lines_in(path) > 100)
            harm(path)

    settings = LiveSettings(speed=None, cycle_ns=1_000_000_000)
    run = LiveRun(scene_of({"path": str(path), **spool}), Host.discover(), settings, harmed)
    run.start()
    until(lambda: run.status().state == "ended")
    status = run.stop()
    (sink,) = status.sinks
    assert sink.state == "failed"
    assert "another process" in (sink.error or "")
    assert sink.delivered + sink.spooled + sink.dropped == status.detections
    assert sink.spooled > 0 if is_spooled else sink.dropped > 0


def test_a_log_cut_off_before_an_acknowledgement(tmp_path: Path) -> None:
    """What the journal writes next fills the hole: it looks before."""
    journal = Journal(str(tmp_path / "spool"), MIB, survives_power_cut=True)
    for first in range(0, 400, 100):
        journal.put(next(EncodedBatcher(ENCODER, SENSORS).batches(window(100, first))))
    cut(tmp_path / "spool-wal")
    journal.acknowledge([1])
    assert not journal.outlives_the_process
    journal.close()


def test_the_command_ends_with_the_code_of_its_outputs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    spool = tmp_path / "e.spool"
    take = Journal.acknowledge

    def harmed(journal: Journal, numbers: Any) -> None:
        take(journal, numbers)
        spool.unlink(missing_ok=True)

    monkeypatch.setattr(Journal, "acknowledge", harmed)
    scene = tmp_path / "scene.yaml"
    output = {"path": str(tmp_path / "e.jsonl"), "spool": {"path": str(spool)}}
    scene.write_text(json.dumps({**SCENE, "outputs": [{"jsonl": output}]}))
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(scene), "--quiet"]) == 5
    assert "the file or its log: another process removed it" in capsys.readouterr().err


def test_a_file_that_is_moved_away_is_still_written(tmp_path: Path) -> None:
    """As logs are rotated: what is written is in the moved file."""
    path = tmp_path / "e.jsonl"

    def moved(live: Any) -> None:
        if live.window.start_s == 20.0:
            path.rename(tmp_path / "e.1.jsonl")

    settings = LiveSettings(speed=None, cycle_ns=1_000_000_000)
    run = LiveRun(scene_of({"path": str(path)}), Host.discover(), settings, moved)
    run.start()
    until(lambda: run.status().state == "ended")
    status = run.stop()
    assert status.sinks[0].delivered == status.detections == lines_in(tmp_path / "e.1.jsonl")


def test_a_spool_that_nobody_touches_has_no_fault(tmp_path: Path) -> None:
    journal = Journal(str(tmp_path / "spool"), MIB)
    assert journal.outlives_the_process
    assert journal.sync_fault == ""
    journal.close()
    assert journal.sync_fault == ""


def test_a_write_of_another_thread_during_a_look_is_no_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (tmp_path / "e.jsonl").open("wb", buffering=0) as file:
        growing = GrowingFile(file.fileno())
        look = os.fstat

        def late(descriptor: int) -> os.stat_result:
            status = look(descriptor)
            growing.size += file.write(b"line")
            return status

        with monkeypatch.context() as patched:
            patched.setattr("opir_core.output.temporary_files.os.fstat", late)
            fault = growing.fault()
    assert fault == ""


def test_a_cut_between_a_look_and_a_write_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "e.commands.jsonl"
    write = os.write

    def late(descriptor: int, lines: Any) -> int:
        cut(path)
        return write(descriptor, lines)

    file = CommandsFile(path)
    file.write_bytes(b"line\n" * 4)
    monkeypatch.setattr("opir_core.output.temporary_files.os.write", late)
    file.write_bytes(b"line\n")
    with pytest.raises(SinkError, match="cut it off at 15 of 25"), file:
        pass


def test_lines_go_through_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with ThreadPoolExecutor() as pool:
        content = pool.submit(pipe.read_bytes)
        with CommandsFile(pipe) as file:
            file.write_bytes(b"line\n")
        assert content.result() == b"line\n"
