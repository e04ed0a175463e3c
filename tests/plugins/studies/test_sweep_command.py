"""`opir sweep` as a user sees it."""

import json

import pytest
from study_scene import PERIOD, SCENE

from opir_core.cli.main import main


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.yaml").write_text(json.dumps(SCENE))
    return "short.yaml"


@pytest.mark.slow
def test_a_table_has_a_row_per_design(scene, capsys):
    assert (
        main(["sweep", scene, "--vary", f"{PERIOD}=100,400", "--runs", "5", "--executor", "serial"])
        == 0
    )
    printed = capsys.readouterr().out
    note, _, table = printed.partition("\n\n")
    assert note == "note: detection: constant, since the scene describes no light"
    assert table.startswith("short: 2 designs, 10 runs; mean [95 % interval] over runs\n")
    rows = [line.split() for line in table.splitlines()]
    assert [row[:2] for row in rows[3:5]] == [["100", "5"], ["400", "5"]]
    assert "minus the first design" in printed
    assert printed.endswith("All figures: short-study/results.csv\n")


@pytest.mark.slow
def test_a_study_file_and_flags(scene, tmp_path, capsys):
    (tmp_path / "study.yaml").write_text(
        "study: mine\nscene: short.yaml\nruns: 9\nexecutor: serial\n"
        f"vary:\n  '{PERIOD}': {{from: 100, to: 300, step: 100}}\n"
    )
    flags = [
        "--runs",
        "3",
        "--set",
        "targets[0].launch.time_s=2",
        "--metric",
        "latency",
        "--out",
        "there",
        "--json",
    ]
    assert main(["sweep", "study.yaml", *flags]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["study"] == "mine"
    assert [design[PERIOD] for design in found["designs"]] == [100, 200, 300]
    assert {row["figure"] for row in found["results"]} == set(found["figures"])
    assert all(row["runs"] == 3 for row in found["results"])
    assert (
        (tmp_path / "there" / "results.csv")
        .read_text()
        .startswith(f"design,{PERIOD},figure,unit,runs,")
    )


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
def test_invalid_words_are_refused(scene, capsys, flags, code, words):
    assert main(["sweep", scene, "--runs", "2", "--executor", "serial", *flags]) == code
    assert words in capsys.readouterr().err


def test_a_missing_file_is_one_message(scene, capsys):
    assert main(["sweep", "nowhere.yaml"]) == 2
    assert "there is no such file" in capsys.readouterr().err
