"""Files of runs, exports, reports and studies: regular files alone are replaced, whole, and what
was written lasts.
"""

import os
import stat
import threading
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from exported_runs import exported
from opir_report.pages.files import write_page
from opir_report.pages.run_report import run_page
from opir_studies import Study, load_study, sweep
from repository import EXAMPLES
from study_scene import PERIOD, SCENE

import opir_core
from opir_core.cli.main import main
from opir_core.errors import SceneError, SinkError

ONE_FILE = ("kml", "geojson", "czml", "tdm")


@pytest.fixture(scope="module")
def events(tmp_path_factory):
    """Return the events of a short run with tracks, its truth, tracks and manifest beside them."""
    path = tmp_path_factory.mktemp("run") / "events.jsonl"
    assert run_into(path) == 0
    return path


def run_into(path, *more):
    scene = str(EXAMPLES / "first_light.yaml")
    return main(
        [
            "run",
            scene,
            "--set",
            "duration_s=20",
            "--tracker",
            "imm",
            "--out",
            str(path),
            "--quiet",
            *more,
        ]
    )


@pytest.fixture(scope="module")
def run(events):
    return opir_core.load_run(events)


@cache
def page_of(run):
    return run_page(run)


def small_study():
    return Study(scene=SCENE, study="s", vary={PERIOD: [100, 400]}, runs=2, executor="serial")


def exporting(name):
    return lambda run, path: exported(run, name, path)


WRITERS: dict[str, Callable[[Any, Path], object]] = {
    **{name: exporting(name) for name in ("kml", "parquet", "oem")},
    "report": lambda run, path: write_page(page_of(run), path / "report.html", with_data=True),
    "run": lambda _run, path: run_into(path / "e.jsonl"),
    "sweep": lambda _run, path: sweep(small_study(), path / "made" / "study"),
}


@pytest.mark.parametrize("name", ONE_FILE)
def test_an_export_through_a_pipe_keeps_the_pipe(run, tmp_path, name):
    pipe = tmp_path / "pipe"
    read = list[bytes]()
    os.mkfifo(pipe)
    reading = threading.Thread(target=lambda: read.append(pipe.read_bytes()), daemon=True)
    reading.start()
    exported(run, name, pipe)
    assert stat.S_ISFIFO(pipe.lstat().st_mode), "the pipe was replaced"
    reading.join(30.0)
    exported(run, name, tmp_path / "file")
    assert read == [(tmp_path / "file").read_bytes()]


def device(path, minor):
    try:
        os.mknod(path, 0o666 | stat.S_IFCHR, os.makedev(1, minor))
        path.open("wb").close()
    except OSError:
        pytest.skip("devices cannot be made here")
    return path


@pytest.mark.parametrize("name", ONE_FILE)
def test_an_export_to_a_device_leaves_the_device(run, tmp_path, name):
    null = device(tmp_path / "null", 3)
    full = device(tmp_path / "full", 7)
    exported(run, name, null)
    with pytest.raises(SinkError, match=r"full cannot be written: no space left on device"):
        exported(run, name, full)
    assert stat.S_ISCHR(null.lstat().st_mode)
    assert stat.S_ISCHR(full.lstat().st_mode)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["full", "null"]


def linked(path, victim):
    path.symlink_to(victim)


def hard_linked(path, victim):
    path.hardlink_to(victim)


def dangling(path, victim):
    path.symlink_to(victim.with_name("new"))


MADE_UP = ("e.truth.jsonl", "e.tracks.jsonl", "e.manifest.json")
PARTS = tuple(f"{name}.part" for name in ("e.jsonl", *MADE_UP))


@pytest.mark.parametrize(
    ("name", "plant"),
    [
        *((name, linked) for name in (*MADE_UP, *PARTS)),
        *(
            (name, plant)
            for name in (MADE_UP[0], PARTS[0], PARTS[-1])
            for plant in (hard_linked, dangling)
        ),
    ],
)
def test_a_run_writes_through_no_link_under_a_name_that_it_makes_up(
    tmp_path,
    name,
    plant,
    capsys,
):
    victim = tmp_path / "victim"
    folder = tmp_path / "out"
    folder.mkdir()
    victim.write_bytes(b"of somebody else")
    plant(folder / name, victim)
    code = run_into(folder / "e.jsonl")
    assert victim.read_bytes() == b"of somebody else"
    assert not (tmp_path / "new").exists()
    if plant is hard_linked and name in MADE_UP:  # its name is given to the new file
        assert code == 0
        return
    assert code == 5
    message = capsys.readouterr().err
    assert f"{folder / name} cannot be written: a" in message
    assert "link has its name" in message
    assert [path.name for path in folder.iterdir()] == [name]


def test_a_path_that_is_a_link_stays_a_link(tmp_path):
    (tmp_path / "far").mkdir()
    for name in ("e.jsonl", "t.jsonl"):
        (tmp_path / name).symlink_to(tmp_path / "far" / name)
    assert run_into(tmp_path / "e.jsonl", "--truth", str(tmp_path / "t.jsonl")) == 0
    assert sorted(path.name for path in (tmp_path / "far").iterdir()) == ["e.jsonl", "t.jsonl"]
    assert (tmp_path / "e.jsonl").is_symlink()
    assert (tmp_path / "t.jsonl").is_symlink()


def test_a_pipe_under_a_name_that_opir_makes_up_is_refused(tmp_path, capsys):
    os.mkfifo(tmp_path / "e.truth.jsonl")
    assert run_into(tmp_path / "e.jsonl") == 5
    assert "a device or a pipe has its name" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("kml", "out.part"),
        ("parquet", "out/detections.parquet"),
        ("parquet", "out/detections.parquet.part"),
        ("parquet", "out/.opir.part"),
        ("report", "out/report.html.part"),
        ("report", "out/report.data/launches.parquet"),
        ("report", "out/report.data/launches.parquet.part"),
        ("report", "out/report.data"),
        ("sweep", "out/made/study/study.json"),
        ("sweep", "out/made/study/results.csv.part"),
        ("sweep", "out/made/study/parts"),
    ],
)
def test_exports_reports_and_studies_write_through_no_planted_link(run, tmp_path, name, place):
    victim = tmp_path / "victim"
    victim.mkdir() if place.endswith((".data", "parts")) else victim.write_bytes(
        b"of somebody else"
    )
    (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / place).symlink_to(victim)
    with pytest.raises(SinkError, match=r"a link has its name"):
        WRITERS[name](run, tmp_path / "out")
    assert (
        not list(victim.iterdir())
        if victim.is_dir()
        else victim.read_bytes() == b"of somebody else"
    )


@pytest.mark.parametrize("name", WRITERS)
def test_what_is_renamed_and_every_folder_that_was_made_is_on_disk(
    run, tmp_path, name, monkeypatch
):
    calls = list[tuple[str, Path]]()
    fsync = os.fsync
    replace = Path.replace

    def synced(descriptor):
        calls.append(("sync", Path(f"/proc/self/fd/{descriptor}").readlink()))
        fsync(descriptor)

    def renamed(path, target):
        calls.append(("rename", Path(target)))
        assert ("sync", path) in calls, f"{path} is renamed before its content is on disk"
        return replace(path, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(Path, "replace", renamed)
    if name in ("run", "report"):
        (tmp_path / "out").mkdir()
    paths = {tmp_path, *tmp_path.iterdir()}
    WRITERS[name](run, tmp_path / "out")
    new_paths = [path for path in tmp_path.rglob("*") if path not in paths]
    files = [path for path in new_paths if path.is_file()]
    assert files
    assert not [path for path in files if path.name.endswith(".part")]
    for path in files:
        at = calls.index(("rename", path))
        assert ("sync", path.parent) in calls[at:], f"the name of {path} is not on disk"
    for folder in (path for path in new_paths if path.is_dir()):
        assert ("sync", folder.parent) in calls, f"the folder {folder} is not on disk"


def killed_at(number, write, monkeypatch):
    """Let a process be killed at the n-th call that changes names or syncs, and return whether it
    was.
    """
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
    calls = 0

    def counted(real):
        def call(*inputs, **named):
            nonlocal calls
            calls += 1
            if calls == number:
                os._exit(9)
            return real(*inputs, **named)

        return call

    for owner, what in ((os, "fsync"), (Path, "replace"), (Path, "unlink"), (os, "open")):
        monkeypatch.setattr(owner, what, counted(getattr(owner, what)))
    try:
        write()
        os._exit(0)
    finally:
        os._exit(1)


def contents(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and not path.name.endswith(".part")
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kml", "parquet", "report"])
def test_a_kill_leaves_the_old_files_or_the_new_ones(run, events, tmp_path, name, monkeypatch):
    other = opir_core.load_run(events)
    path = tmp_path / "out"
    states = list[dict[str, bytes]]()
    object.__setattr__(other.plan.scene, "name", "another")
    page_of(run), page_of(other)
    for state in (run, other):
        place = tmp_path / str(len(states)) / "out"
        place.parent.mkdir()
        if name == "report":
            place.mkdir()
        WRITERS[name](state, place)
        states.append(contents(place.parent))
    if name == "report":
        path.mkdir()
    write = WRITERS[name]
    number = 0
    stages = set()
    while True:
        number += 1
        write(run, path)
        if not killed_at(number, lambda: write(other, path), monkeypatch):
            break
        result = contents(tmp_path / "out") if path.is_dir() else {"out": path.read_bytes()}
        old, new = (
            {name.removeprefix("out/"): text for name, text in state.items()} for state in states
        )
        assert all(result[name] in (old[name], new[name]) for name in old), (
            f"half a file at call {number}"
        )
        stages.add(result == old)
    assert stages == {True, False} or name == "parquet"
    assert number > 5


@pytest.mark.parametrize("file", ["part", "results.parquet", "runs.parquet", "results.csv"])
def test_a_flipped_bit_in_a_study_is_reported(tmp_path, file):
    sweep(small_study(), tmp_path)
    path = next((tmp_path / "parts").glob("*.parquet")) if file == "part" else tmp_path / file
    content = path.read_bytes()
    step = max(1, len(content) // 40)
    for place in range(0, len(content), step):
        path.write_bytes(
            content[:place] + bytes([content[place] ^ 1 << place % 8]) + content[place + 1 :]
        )
        with pytest.raises(SceneError, match="is not what was written"):
            sweep(small_study(), tmp_path) if file == "part" else load_study(tmp_path)
    path.write_bytes(content)
    assert load_study(tmp_path).runs.num_rows == 4


def test_the_definition_of_a_study_has_the_sum_of_each_table(tmp_path):
    definition = sweep(small_study(), tmp_path).definition
    listed = {entry["name"]: entry["sha256"] for entry in definition["written_files"]}
    assert listed == {
        name: sha256((tmp_path / name).read_bytes()).hexdigest()
        for name in (
            "results.parquet",
            "results.csv",
            "runs.parquet",
            "launches.parquet",
            "shares.parquet",
            "shares.csv",
        )
    }
