"""Runs, exports, reports, studies, imports through power cuts and kills: the files before or the
new ones, whole.
"""

import json
import os

import pytest
from power_cuts import can_record, kills, power_cuts, record
from study_scene import PERIOD, SCENE

from opir_core.cli.main import main
from opir_core.output import OutputFiles, finish_interrupted

#: Power cuts of each recording in the slow tests; in the quick ones a few.
CUTS = int(os.environ.get("OPIR_POWER_CUTS", "1000"))
FEW = 60

pytestmark = pytest.mark.skipif(not can_record(), reason="needs Linux and a C compiler")

PROGRAM = """
import sys
from pathlib import Path
from opir_core.cli.main import main
from power_cuts import note
assert main(sys.argv[2:]) == 0
note(Path(sys.argv[1]), "done")
"""
EPHEMERIS = "time_s,x_ecef_m,y_ecef_m,z_ecef_m\n" + "".join(
    f"{t},{-2.6e6 + t},{-4.6e6},{3.6e6}\n" for t in range(2000)
)

#: Arguments of a command that writes into the folder {disk}; {number} is 1 of the files before and
#: 2 of the new ones.
COMMANDS = {
    "run": "run {scene} --set seed={number} --out {disk}/e.jsonl --quiet",
    "run of columns": "run {scene} --set seed={number} --out {disk}/e.parquet --quiet",
    "run into two folders": "run {scene} --set seed={number} --out {disk}/a/e.jsonl --truth"
    " {disk}/b/t.jsonl --quiet",
    "export of a file": "export {run} --to kml --out {disk}/run.kml",
    "export of a folder": "export {run} --to parquet --out {disk}/tables",
    "report": "report {run} --out {disk}/report.html",
    "sweep": "sweep {scene} --set seed={number} --vary {period}=100,400 --metric latency --runs 2"
    " --executor serial"
    " --out {disk}/study --quiet",
    "import": "import {ephemeris} --out {disk}/states.csv",
}


def finish(disk):
    """Do what the next command that reads or writes the files does."""
    for manifest in disk.rglob("*.part"):
        finish_interrupted(manifest.with_name(manifest.name.removesuffix(".part")))
    for folder in {listed.parent for listed in disk.rglob(".opir.part")}:
        OutputFiles(folder=folder).abandon()


def contents(disk):
    """Return the files of a folder, without temporary ones, parts of studies and times."""
    return {
        str(path.relative_to(disk)): path.read_bytes()
        for path in disk.rglob("*")
        if path.is_file()
        and path.suffix != ".part"
        and path.parent.name != "parts"
        and path.name not in ("run_times.csv", "notes")
    }


def parts(disk):
    """Return the parts of the studies in a folder."""
    return {path.name: path.read_bytes() for path in disk.rglob("parts/*.parquet")}


class Stage:
    """A folder with the files of a command, and the means to make them anew."""

    def __init__(self, scratch, command):
        self.scratch = scratch
        self._command = command
        self.disk = scratch / "disk"
        self.disk.mkdir()
        for folder in ("a", "b"):
            (self.disk / folder).mkdir()
        (scratch / "scene.yaml").write_text(json.dumps(SCENE), encoding="utf-8")
        for number in (1, 2):
            (scratch / f"states{number}.csv").write_text(
                EPHEMERIS.replace("3600000.0", f"36{number}0000.0"), encoding="utf-8"
            )
            run = f"run {scratch}/scene.yaml --set seed={number} --set scene=s{number} --quiet"
            (scratch / f"run{number}").mkdir()
            assert main([*run.split(), "--out", f"{scratch}/run{number}/e.jsonl"]) == 0

    def arguments(self, number, disk=None):
        """Return the arguments of the command with the files before, 1, or the new ones, 2."""
        places = {"scene": "scene.yaml", "ephemeris": f"states{number}.csv", "run": f"run{number}"}
        inputs = {key: self.scratch / name for key, name in places.items()}
        return self._command.format(
            **inputs, disk=disk or self.disk, number=number, period=PERIOD
        ).split()


@pytest.fixture
def stage(tmp_path):
    return lambda name: Stage(tmp_path, COMMANDS[name])


def recorded(stage):
    """Return what the command does that makes the new files, and the files before and after."""
    contents_before = contents(stage.disk)
    recording = record(stage.disk, PROGRAM, stage.scratch, stage.disk, *stage.arguments(2))
    return recording, contents_before, contents(stage.disk)


def require_old_or_new(stage, interrupted):
    """Return whether the new files were there after interruptions; fail if neither they nor those
    before were.
    """
    recording, old, new = recorded(stage)
    files = parts(stage.disk)
    found_new = set[bool]()
    for cut in interrupted(recording):
        place = cut.make(stage.scratch / "cut")
        finish(place)
        result = contents(place)
        assert result in (old, new), f"cut {cut.seed} after call {cut.calls}"
        assert parts(place).items() <= files.items()
        assert result == new or not cut.notes, (
            f"cut {cut.seed}: undone after the end of the command"
        )
        found_new.add(result == new)
    return found_new


def require_resumable(stage, seeds):
    """Fail if the command does not make the new files from what cuts leave."""
    recording, _old, new = recorded(stage)
    for cut in power_cuts(recording, seeds):
        place = cut.make(stage.scratch / "cut")
        assert main(stage.arguments(2, place)) == 0
        result = contents(place)
        different = {
            path
            for path in new
            if result[path] != new[path] and not path.endswith(".manifest.json")
        }
        assert not different, f"cut {cut.seed} after call {cut.calls}"


def test_a_run_over_another_is_old_or_new_after_a_power_cut(stage):
    of_run = stage("run")
    assert main(of_run.arguments(1)) == 0
    assert require_old_or_new(of_run, lambda calls: power_cuts(calls, range(FEW))) == {True, False}


@pytest.mark.slow
@pytest.mark.parametrize("is_first", [True, False])
@pytest.mark.parametrize("name", COMMANDS)
def test_files_are_old_or_new_after_a_power_cut(stage, name, is_first):
    of_command = stage(name)
    if not is_first:
        assert main(of_command.arguments(1)) == 0
    assert require_old_or_new(of_command, lambda calls: power_cuts(calls, range(CUTS))) == {
        True,
        False,
    }


@pytest.mark.slow
@pytest.mark.parametrize("is_first", [True, False])
@pytest.mark.parametrize("name", COMMANDS)
def test_files_are_old_or_new_after_a_kill_at_any_call(stage, name, is_first):
    of_command = stage(name)
    if not is_first:
        assert main(of_command.arguments(1)) == 0
    assert require_old_or_new(of_command, kills) == {True, False}


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_goes_on_after_a_power_cut(stage, name):
    of_command = stage(name)
    assert main(of_command.arguments(1)) == 0
    require_resumable(of_command, range(12))
