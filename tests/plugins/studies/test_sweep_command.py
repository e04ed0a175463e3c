"""`opir sweep` as a user sees it."""

import json

import pytest
from study_scene import PERIOD, SCENE

from opir_core.cli.main import main


@pytest.fixture
def sweep(tmp_path, monkeypatch, capsys):
    """Return a function that runs the command, and returns the exit code and texts."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.yaml").write_text(json.dumps(SCENE))

    def command(words: str, *more: str):
        return main(["sweep", *words.split(), *more]), capsys.readouterr()

    return command


@pytest.mark.slow
def test_a_table_has_a_row_per_design(sweep):
    code, printed = sweep(f"short.yaml --vary {PERIOD}=100,400 --runs 5 --executor serial")
    assert code == 0
    note, _, table = printed.out.partition("\n\n")
    assert note == "note: detection: constant, since the scene describes no light"
    assert table.startswith("short: 2 designs, 10 runs; mean [95 % interval] over runs\n")
    rows = [line.split()[:2] for line in table.splitlines()]
    assert rows[3:5] == [["100", "5"], ["400", "5"]]
    assert "minus the first design" in printed.out
    assert printed.out.endswith("All figures: short-study/results.csv\n")


@pytest.mark.slow
def test_a_study_file_and_flags(sweep, tmp_path):
    (tmp_path / "study.yaml").write_text(
        "study: mine\nscene: short.yaml\nruns: 9\nexecutor: serial\n"
        f"vary:\n  '{PERIOD}': {{from: 100, to: 300, step: 100}}\n"
    )
    flags = "--runs 3 --set targets[0].launch.time_s=2 --metric latency --out there --json"
    code, printed = sweep(f"study.yaml {flags}")
    document = json.loads(printed.out)
    assert code == 0
    assert document["study"] == "mine"
    assert [design[PERIOD] for design in document["designs"]] == [100, 200, 300]
    assert {row["figure"] for row in document["results"]} == set(document["figures"])
    assert all(row["runs"] == 3 for row in document["results"])
    table = (tmp_path / "there" / "results.csv").read_text()
    assert table.startswith(f"design,{PERIOD},figure,unit,runs,")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flags", "code", "words"),
    [
        (["--vary", "tracker"], 2, "--vary: 'tracker' has no values"),
        (["--vary", f"{PERIOD}=-5"], 2, "sensors[0].scan_period_ms: -5.0 is outside"),
        (["--set", "x"], 2, "--set: 'x' has no '='"),
        (["--runs", "0"], 2, "--runs: 0 is outside [1, 1000000]"),
        (["--workers", "0"], 2, "--workers: 0 is not a number of workers"),
        (["--design", "box"], 2, "'box' is not one of"),
        (["--executor", "dusk"], 3, "no executor is named 'dusk'"),
        (["--metric", "{latency: {x: 1}}"], 2, "metrics[0].latency.x: unknown key"),
        (["--show", "latency"], 2, "no metric of the study gives 'latency'"),
    ],
)
def test_invalid_words_are_refused(sweep, flags, code, words):
    returned, printed = sweep("short.yaml --runs 2 --executor serial", *flags)
    assert returned == code
    assert words in printed.err


@pytest.mark.parametrize("scene", ["[short.yaml]", "3.5", "null"])
def test_a_study_of_no_scene_is_one_message(sweep, tmp_path, scene):
    (tmp_path / "study.yaml").write_text(f"study: mine\nscene: {scene}\n")
    code, printed = sweep("study.yaml")
    assert code == 2
    assert printed.err.startswith("opir: study.yaml: 1 problem\n  scene: must be the path of")


def test_a_missing_file_is_one_message(sweep):
    code, printed = sweep("nowhere.yaml")
    assert code == 2
    assert "there is no such file" in printed.err
