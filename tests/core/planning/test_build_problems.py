"""Problems that show when components are built are reported like those of reading: all at once,
with path and line.
"""

import pytest

from opir_core import compile_plan
from opir_core.cli.main import main
from opir_core.errors import SceneError
from opir_core.reading import load_scene

HEAD = """scene: two
epoch: "2026-04-01T12:00:00Z"
duration_s: 60
sensors:
"""
FILES = """  - {model: generic-scanner, id: A, orbit: {omm_file: {path: a.json}}}
  - model: generic-scanner
    id: B
    orbit:
      omm_file: {path: b.json}
"""
DECAYED = """  - model: generic-scanner
    id: C
    orbit:
      tle:
        - 1 28872U 05037B   05333.02012661  .25992681  00000-0  24476-3 0  1534
        - 2 28872  96.4736 157.9986 0303955 244.0492 110.6523 16.46015938 10708
"""
TABLES = """targets:
  - {id: T1, model: table, type: SRBM, file: none.csv}
  - {id: T2, model: table, type: SRBM, file: empty.csv}
"""


@pytest.fixture
def reported(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.json").write_text("[]")
    (tmp_path / "empty.csv").write_text("")

    def validated(text, *options):
        (tmp_path / "scene.yaml").write_text(text)
        assert main(["validate", "scene.yaml", *options]) == 2
        return capsys.readouterr().err.splitlines()

    return validated


def test_two_files_that_are_none_are_two_problems(reported):
    assert reported(HEAD + FILES) == [
        "opir: scene.yaml: 2 problems",
        (
            "  sensors[0].orbit.omm_file.path: a.json: holds no OMM; exactly one is needed (line 5,"
            " column 62)"
        ),
        (
            "  sensors[1].orbit.omm_file.path: b.json: cannot be read: no such file, relative to"
            " the working directory "
            "(line 9, column 24)"
        ),
    ]


def test_sensors_and_targets_are_reported_together(reported):
    head, *lines = reported(HEAD + FILES + DECAYED + TABLES)
    assert head == "opir: scene.yaml: 5 problems"
    assert "sensors[2].orbit.tle: SGP4 has no position for object 28872 at 0.0 s" in lines[2]
    assert "targets[0].file: none.csv: cannot be read" in lines[3]
    assert "targets[1].file: empty.csv: is empty" in lines[4]
    assert [line.rpartition("(")[2] for line in lines[2:]] == [
        "line 14, column 9)",
        "line 17, column 46)",
        "line 18, column 46)",
    ]


def test_problems_of_options_name_the_option(reported):
    lines = reported(
        HEAD + FILES.splitlines(True)[0], "--set", "sensors[0].orbit.omm_file.path=c.json"
    )
    assert lines[1].endswith("(override 'sensors[0].orbit.omm_file.path=c.json')")


def test_a_constellation_says_its_problem_once(reported):
    lines = reported(
        HEAD
        + "  - {constellation: DSP, orbit: {omm_file: {path: a.json}}, orbital_slot_deg: null}\n"
    )
    assert len(lines) == 2


def test_from_python_the_problems_have_their_paths(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(HEAD + FILES)
    with pytest.raises(SceneError) as caught:
        compile_plan(load_scene("scene.yaml"))
    assert [problem.path for problem in caught.value.problems] == [
        "sensors[0].orbit.omm_file.path",
        "sensors[1].orbit.omm_file.path",
    ]
