"""The files of a batch run are all of one run: however it ends, and however often it is started."""

import json
import os
import shutil
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from waiting import until

from opir_core import Plan, compile_plan, load_run
from opir_core.cli.main import main
from opir_core.errors import SceneError, SinkError
from opir_core.output import OutputFiles, deliver, finish_interrupted
from opir_core.output.run_files import read_manifest
from opir_core.reading import scene_from_mapping

SCENE = {
    "scene": "small",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 40.0,
    "seed": 1,
    "sensors": [{"constellation": "DSP"}],
    "targets": [
        {
            "id": "T1",
            "type": "ICBM",
            "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 1.0},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
        }
    ],
}
NAMES = ("e.jsonl", "e.manifest.json", "e.truth.jsonl")


def plan_of(folder: Path, seed: int, *more: Any) -> Plan:
    outputs = [{"jsonl": {"path": str(folder / "e.jsonl")}}, *more]
    return compile_plan(scene_from_mapping({**SCENE, "seed": seed, "outputs": outputs}))


def run_into(
    folder: Path, seed: int, *more: Any, on_window: Callable[[Any], None] | None = None
) -> Any:
    beside = {"truth_path": folder / "e.truth.jsonl", "manifest_path": folder / "e.manifest.json"}
    return deliver(plan_of(folder, seed, *more), **beside, on_window=on_window)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder: Path = tmp_path_factory.mktemp("kept")
    run_into(folder, 1)
    return folder


@pytest.fixture
def good(kept: Path, tmp_path: Path) -> Path:
    shutil.copytree(kept, tmp_path / "good")
    return tmp_path / "good"


def test_the_manifest_has_the_sum_of_every_file(good: Path) -> None:
    files = contents(good)
    assert tuple(files) == NAMES
    reported = read_manifest(good / "e.manifest.json")["written_files"]
    assert [(entry["kind"], entry["name"]) for entry in reported] == [
        ("events", "e.jsonl"),
        ("truth", "e.truth.jsonl"),
    ]
    for entry in reported:
        assert entry["sha256"] == sha256(files[entry["name"]]).hexdigest()
        assert entry["bytes"] == len(files[entry["name"]]) > 0


@pytest.mark.parametrize("name", ["e.jsonl", "e.truth.jsonl"])
def test_a_file_with_one_figure_changed_is_refused(good: Path, name: str) -> None:
    text = (good / name).read_text(encoding="utf-8")
    key = '"azimuth_deg":' if name == "e.jsonl" else '"range_m":'
    place = text.index(key) + len(key)
    digit = next(at for at in range(place, len(text)) if text[at].isdigit())
    changed = text[:digit] + str((int(text[digit]) % 8) + 1) + text[digit + 1 :]
    (good / name).write_text(changed, encoding="utf-8")
    with pytest.raises(SceneError, match=r"of the manifest's run \(the SHA-256 differs\)"):
        load_run(good)


class StoppedError(BaseException):
    pass


def stop(_window: Any) -> None:
    raise StoppedError


@pytest.mark.parametrize("kind", [StoppedError, KeyboardInterrupt, SystemExit, SinkError])
def test_a_run_that_is_interrupted_leaves_the_run_before(
    good: Path, kind: type[BaseException]
) -> None:
    def interrupt(_window: Any) -> None:
        raise kind

    former_files = contents(good)
    with pytest.raises(kind):
        run_into(good, 2, on_window=interrupt)
    assert contents(good) == former_files


def test_a_folder_that_was_empty_is_empty_after_an_interruption(tmp_path: Path) -> None:
    with pytest.raises(StoppedError):
        run_into(tmp_path, 2, on_window=stop)
    assert contents(tmp_path) == {}


def test_a_failing_file_keeps_the_earlier_run(good: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    former_files = contents(good)
    write = os.write
    calls = []

    def full(descriptor: int, data: Any) -> int:
        calls.append(descriptor)
        if len(calls) > 1:
            raise OSError(28, "No space left on device")
        return write(descriptor, data[: len(data) // 2])

    with monkeypatch.context() as patch:
        patch.setattr("opir_core.builtin.sinks._written", full)
        outcome = run_into(good, 2, "null")
    with pytest.raises(
        SinkError,
        match=r"no file of an earlier run is replaced; what was written is in .*e\.jsonl\.part",
    ):
        outcome.raise_for_failures()
    files_after = contents(good)
    assert {name: files_after[name] for name in NAMES} == former_files
    assert len(files_after["e.jsonl.part"].splitlines()) == outcome.report.failures[0].delivered > 0
    assert run_into(good, 2).report.failures == ()
    assert tuple(contents(good)) == NAMES


def test_of_three_runs_into_one_path_one_wins(good: Path) -> None:
    refused = []

    def more(_window: Any) -> None:
        for _ in range(2):
            with pytest.raises(SinkError) as raised:
                run_into(good, 3)
            refused.append(str(raised.value))

    run_into(good, 2, on_window=more)
    assert len(refused) >= 2
    assert all(
        "is being written by another run; wait until that has ended, or give another path" in item
        for item in refused
    )
    assert load_run(good).manifest["seed"] == 2
    assert tuple(contents(good)) == NAMES


def test_another_manifest_and_truth_do_not_make_it_another_file(good: Path) -> None:
    def more(_window: Any) -> None:
        with pytest.raises(SinkError, match=r"e\.jsonl is being written by another run"):
            deliver(plan_of(good, 3), truth_path=good / "other.truth.jsonl")

    run_into(good, 2, on_window=more)
    assert tuple(contents(good)) == NAMES


def serial_calls(monkeypatch: pytest.MonkeyPatch, name: str, fails_at: int) -> list[Any]:
    """Let the n-th call of a function of the system fail, as a damaged disk does; returns the
    calls.
    """
    owner: Any = Path if name == "replace" else os
    real = getattr(owner, name)
    calls = []

    def call(*words: Any) -> Any:
        calls.append(words)
        if len(calls) == fails_at:
            raise OSError(5, "Input/output error")
        return real(*words)

    monkeypatch.setattr(owner, name, call)
    return calls


def error_of(folder: Path) -> str | None:
    """Return the message of a run that fails."""
    try:
        run_into(folder, 2).raise_for_failures()
    except SinkError as error:
        return str(error)
    return None


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fsync", "replace", "ftruncate", "write"])
def test_whatever_call_fails_the_files_are_of_one_run(
    kept: Path, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    failed = 0
    for number in range(1, 200):
        folder = tmp_path / str(number)
        shutil.copytree(kept, folder)
        with monkeypatch.context() as patch:
            calls = serial_calls(patch, name, number)
            raised = error_of(folder)
        assert raised is None or "input/output error" in raised
        failed += raised is not None
        assert load_run(folder).manifest["seed"] in (1, 2)
        assert run_into(folder, 3).report.failures == ()
        assert load_run(folder).manifest["seed"] == 3
        assert tuple(contents(folder)) == NAMES
        if len(calls) < number:
            break
    assert failed == number - 1 > 0


@pytest.mark.slow
@pytest.mark.parametrize("renamed", range(4))
def test_a_run_killed_during_renaming_is_finished(
    good: Path, renamed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        serial_calls(patch, "replace", renamed + 1)
        with (
            pytest.raises(SinkError, match="whole under temporary names")
            if renamed < 3
            else _nothing()
        ):
            run_into(good, 2)
    assert finish_interrupted(good / "e.manifest.json") == (renamed < 3)
    assert tuple(contents(good)) == NAMES
    assert load_run(good).manifest["seed"] == 2


def _nothing() -> Any:
    from contextlib import nullcontext

    return nullcontext()


def test_a_run_that_is_not_whole_is_not_finished(good: Path) -> None:
    (good / "e.manifest.json.part").write_text(
        '{"written_files": [{"name": "e.jsonl", "bytes": 3, "sha256": "0"}]}'
    )
    (good / "e.jsonl.part").write_text("abc")
    former_files = contents(good)
    assert not finish_interrupted(good / "e.manifest.json")
    assert contents(good) == former_files
    assert load_run(good).manifest["seed"] == 1


def test_permissions_and_links_stay(good: Path) -> None:
    (good / "e.jsonl").rename(good / "far.jsonl")
    (good / "e.jsonl").symlink_to(good / "far.jsonl")
    (good / "far.jsonl").chmod(0o640)
    run_into(good, 2)
    assert (good / "e.jsonl").is_symlink()
    assert stat.S_IMODE((good / "far.jsonl").stat().st_mode) == 0o640
    assert load_run(good).manifest["seed"] == 2


def test_a_device_gets_the_events_and_has_nothing_beside_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps(SCENE), encoding="utf-8")
    (tmp_path / "null").symlink_to(os.devnull)
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(scene), "--out", "null", "--json"]) == 0
    reported = json.loads(capsys.readouterr().out)
    assert reported["files"] == {}
    assert next(iter(reported["outputs"].values()))["delivered"] > 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["null", "scene.yaml"]


@pytest.fixture
def long_run(good: Path, tmp_path: Path) -> Iterator[Callable[[], subprocess.Popen[str]]]:
    """Return a function that starts a long run over the good one."""
    scene = tmp_path / "scene.yaml"
    started = []
    sensors = [{"constellation": "DSP"}, {"constellation": "SBIRS-GEO"}]
    (target,) = SCENE["targets"]  # type: ignore[misc]
    launches = [{**target["launch"], "time_s": 60.0 * number} for number in range(400)]
    targets = [
        {**target, "id": f"T{number}", "launch": launch} for number, launch in enumerate(launches)
    ]
    changed = {"sensors": sensors, "targets": targets, "duration_s": 30_000.0}
    scene.write_text(json.dumps({**SCENE, **changed}), encoding="utf-8")

    def start() -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "opir_core", "run", str(scene), "--out", "e.jsonl"]
        started.append(subprocess.Popen(command, cwd=good, stderr=subprocess.PIPE, text=True))
        return started[-1]

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs POSIX signals")
@pytest.mark.parametrize(("number", "code"), [("SIGINT", 130), ("SIGTERM", -15), ("SIGKILL", -9)])
def test_a_process_that_a_signal_ends_leaves_the_run_before(
    good: Path, long_run: Callable[[], subprocess.Popen[str]], number: str, code: int
) -> None:
    former_files = contents(good)
    process = long_run()
    until(lambda: (good / "e.jsonl.part").exists() and (good / "e.jsonl.part").stat().st_size > 0)
    time.sleep(0.1)
    process.send_signal(getattr(signal, number))
    assert process.wait(60.0) == code
    files_after = contents(good)
    assert {name: files_after[name] for name in NAMES} == former_files
    assert (len(files_after) == len(NAMES)) == (number != "SIGKILL")
    assert load_run(good).manifest["seed"] == 1
    run_into(good, 2)
    assert tuple(contents(good)) == NAMES


def test_files_without_a_manifest_are_put_in_place_too(tmp_path: Path) -> None:
    (tmp_path / "e.jsonl").write_text("before", encoding="utf-8")
    files = OutputFiles()
    piece = files.stage(tmp_path / "e.jsonl")
    piece.write_text("after", encoding="utf-8")
    assert (tmp_path / "e.jsonl").read_text(encoding="utf-8") == "before"
    reported = files.commit({})["written_files"]
    assert reported[0]["sha256"] == sha256(b"after").hexdigest()
    assert contents(tmp_path) == {"e.jsonl": b"after"}
