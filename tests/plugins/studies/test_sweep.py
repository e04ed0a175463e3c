"""A study gives the statistics of its runs, continues where it stopped, and does not depend on what
ran it.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from attrs import evolve
from opir_studies import Study, StudyError, load_study, read_study, sweep
from opir_studies.runs import result_of
from opir_studies.statistics import interval
from scipy.stats import bootstrap, ttest_1samp
from study_scene import PERIOD, SCENE

import opir_core
from opir_core.errors import PluginError, SceneError

TABLES = ("results.parquet", "results.csv", "runs.parquet", "study.json")
STUDY = Study(scene=SCENE, study="s", vary={PERIOD: [100, 400]}, runs=6, executor="serial")


def swept(folder, **changes):
    return sweep(evolve(STUDY, **changes), folder)


def tables_of(folder):
    return [(folder / name).read_bytes() for name in TABLES]


def test_intervals_are_cut_at_0_and_shares_at_1_but_not_counts(tmp_path):
    """The whole interval of a mean latency reaches below 0; false tracks are a count, without a
    bound at 1.
    """
    result = swept(tmp_path, metrics=("latency", "tracks"), runs=3, vary={PERIOD: [100, 9000]})
    assert result.definition["bounds"]["detected"] == [0.0, 1.0]
    assert result.definition["bounds"]["false_tracks"] == [0.0, None]
    rows = result.rows("latency_s")
    shown = result.shown_rows("latency_s")
    assert min(row["low_95"] for row in rows) < 0.0
    assert min(row["low_95"] for row in shown) == 0.0
    assert [row["high_95"] for row in shown] == [row["high_95"] for row in rows]


@pytest.fixture
def counted(monkeypatch):
    """Count the runs that are made."""
    runs = []

    def counting(task):
        runs.extend(
            (task.scene.sensors[0].model.config.scan_period_ms, number)
            for number in task.replicates
        )
        return result_of(task)

    monkeypatch.setattr("opir_studies.sweeping.result_of", counting)
    return runs


@pytest.mark.parametrize("name", ["opir-core", "numpy", "opir-trackers"])
def test_a_worker_with_another_version_is_refused(tmp_path, monkeypatch, name):
    def made_elsewhere(task):
        result = result_of(task)
        assert name in result.versions
        return evolve(result, versions={**result.versions, name: "0.0.1"})

    monkeypatch.setattr("opir_studies.sweeping.result_of", made_elsewhere)
    scene = {**SCENE, "tracker": "kepler-arc"}
    message = f"a worker has {name} 0.0.1, and this is .*; install the same on both"
    with pytest.raises(SceneError, match=message):
        swept(tmp_path, runs=1, scene=scene)


@pytest.mark.slow
def test_a_row_of_a_run_is_that_of_the_run_with_its_seed(tmp_path):
    rows = swept(tmp_path).runs.to_pylist()
    assert [row["seed"] for row in rows] == 2 * list(range(100, 106))
    for row in (rows[1], rows[8]):
        overrides = [f"{PERIOD}={row[PERIOD]:g}", f"seed={row['seed']}"]
        run = opir_core.simulate(opir_core.scene_from_mapping(SCENE, overrides=overrides))
        assert row["latency_s"] == run.summary["targets"][0]["latency_s"]
        assert row["seed"] == SCENE["seed"] + row["replicate"]


@pytest.mark.slow
def test_statistics_are_those_of_scipy(tmp_path):
    result = swept(tmp_path, runs=12)
    reference, values = np.reshape(result.runs["latency_s"].to_pylist(), (2, 12))
    row = result.rows("latency_s")[1]
    for figure, sample in (("", values), ("difference_", values - reference)):
        expected = ttest_1samp(sample, 0.0).confidence_interval(0.95)
        assert row[figure[:-1] or "mean"] == pytest.approx(sample.mean(), rel=1e-12)
        assert row[f"{figure}low_95"] == pytest.approx(expected.low, rel=1e-9)
        assert row[f"{figure}high_95"] == pytest.approx(expected.high, rel=1e-9)
    assert row["sd"] == pytest.approx(np.std(values, ddof=1), rel=1e-12)
    assert (row["runs"], row["first_seed"], row["last_seed"], row["unit"]) == (12, 100, 111, "s")


def test_the_interval_agrees_with_a_bootstrap():
    values = np.random.default_rng(3).normal(5.0, 2.0, 400)
    _, low, high = interval(values)
    expected = bootstrap((values,), np.mean, rng=np.random.default_rng(0)).confidence_interval
    assert [low, high] == pytest.approx(list(expected), abs=0.1 * (high - low))
    assert interval(np.array([2.0, np.nan]))[0] == 2.0
    assert np.isnan(interval(np.array([2.0]))[1:]).all()
    assert np.isnan(interval(np.array([np.nan]))).all()


@pytest.mark.slow
def test_a_finished_study_runs_nothing_again(tmp_path, counted):
    tables = []
    for _ in range(2):
        swept(tmp_path)
        assert len(counted) == 12
        tables.append(tables_of(tmp_path))
    assert tables[0] == tables[1]


@pytest.mark.slow
def test_a_changed_study_keeps_the_runs_that_still_match(tmp_path, counted):
    swept(tmp_path)
    counted.clear()
    swept(tmp_path, vary={PERIOD: [400, 800]}, runs=8)
    assert sorted(counted) == [(400.0, 6), (400.0, 7), *((800.0, number) for number in range(8))]
    swept(tmp_path, metrics=["latency"])
    assert len(counted) == 10 + 12
    expected = swept(tmp_path / "other", vary={PERIOD: [400, 800]}, runs=8)
    continued = swept(tmp_path, vary={PERIOD: [400, 800]}, runs=8)
    assert continued.table.equals(expected.table)
    assert load_study(tmp_path).runs.equals(expected.runs)


@pytest.mark.slow
def test_a_damaged_or_foreign_part_is_named(tmp_path):
    swept(tmp_path)
    tables = tables_of(tmp_path)
    path = next((tmp_path / "parts").glob("*.parquet"))
    (tmp_path / "parts" / "x.parquet.part").write_bytes(b"half")
    content = path.read_bytes()
    path.write_bytes(content[:-20])
    with pytest.raises(SceneError, match=r"is damaged .*delete it, and its runs are made again"):
        swept(tmp_path)
    path.unlink()
    swept(tmp_path)
    assert tables_of(tmp_path) == tables
    assert not list((tmp_path / "parts").glob("*.part"))
    pq.write_table(pa.table({"key": ["a"]}), tmp_path / "parts" / "foreign.parquet")
    with pytest.raises(SceneError, match="is no part of a study"):
        swept(tmp_path)


@pytest.mark.slow
def test_the_bytes_do_not_depend_on_the_executor(tmp_path):
    varied = {
        "vary": {PERIOD: [100, 200, 400], "targets[0].launch.time_s": [1.0, 1.5]},
        "runs": 15,
    }
    swept(tmp_path / "serial", **varied)
    expected = tables_of(tmp_path / "serial")
    for workers in (1, 2, 4):
        folder = tmp_path / str(workers)
        swept(folder, **varied, executor={"processes": {"workers": workers}})
        assert tables_of(folder) == expected


@pytest.mark.slow
@pytest.mark.parametrize("kill", ["parent", "worker"])
def test_a_kill_loses_only_the_runs_under_way(tmp_path, kill):
    swept(tmp_path / "whole", runs=150)
    (tmp_path / "scene.json").write_text(json.dumps(SCENE))
    words = f"sweep scene.json --vary {PERIOD}=100,400 --runs 150 --out killed --workers 2 --quiet"
    command = [sys.executable, "-m", "opir_core", *words.split()]
    process = subprocess.Popen(command, cwd=tmp_path)
    folder_of_parts = tmp_path / "killed" / "parts"
    end_s = time.monotonic() + 240.0
    while len(list(folder_of_parts.glob("*.parquet"))) < 4 and time.monotonic() < end_s:
        time.sleep(0.01)
    workers = workers_of(process.pid)
    assert workers, process.kill()
    if kill == "parent":
        process.kill()
        process.wait()
        assert 0 < len(keys_in(folder_of_parts)) < 300
        while any(map(is_alive, workers)) and time.monotonic() < end_s:
            time.sleep(0.05)
        assert not any(map(is_alive, workers)), "workers outlive their parent"
        assert subprocess.run(command, cwd=tmp_path, check=False).returncode == 0
    else:
        os.kill(workers[-1], signal.SIGKILL)
        assert process.wait(240) == 0
    killed, complete = (
        (tmp_path / folder / "runs.parquet").read_bytes() for folder in ("killed", "whole")
    )
    assert killed == complete
    # No run is on the disk twice.
    keys = keys_in(folder_of_parts)
    assert len(keys) == len(set(keys)) == 300


def keys_in(parts):
    return [
        key for path in parts.glob("*.parquet") for key in pq.read_table(path)["key"].to_pylist()
    ]


def listed(words):
    command = ["ps", "-ww", "-o", *words.split()]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def workers_of(number):
    rows = [line.split(None, 1) for line in listed(f"pid=,args= --ppid {number}").splitlines()]
    return [int(pid) for pid, words in rows if "spawn_main" in words]


def is_alive(number):
    state = listed(f"stat= -p {number}")
    return bool(state.strip()) and not state.startswith("Z")


def test_every_design_is_checked_before_the_first_run(tmp_path, counted):
    with pytest.raises(SceneError) as caught:
        swept(tmp_path, vary={PERIOD: [100, -1, 0]})
    assert [problem.path for problem in caught.value.problems] == [
        f"design 1 ({PERIOD}=-1)",
        f"design 2 ({PERIOD}=0)",
    ]
    assert "sensors[0].scan_period_ms: -1.0 is outside" in caught.value.problems[0].message
    assert not counted


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"metrics": ["latenzy"]}, PluginError, "no metric is named 'latenzy'"),
        ({"metrics": [{"detection_by_time": {"times": [1]}}]}, SceneError, "did you mean times_s"),
        (
            {"metrics": [{"detection_by_time": {"times_s": [3, 1]}}]},
            SceneError,
            "the times must increase",
        ),
        ({"metrics": ["latency", "latency"]}, SceneError, "two metrics give detected"),
        ({"metrics": []}, SceneError, "name one at least"),
        ({"metrics": [3]}, SceneError, "write a name, or {name: settings}"),
        ({"executor": "cluster"}, PluginError, "no executor is named 'cluster'"),
        ({"executor": {"processes": {"workers": 0}}}, SceneError, "workers: 0 is outside"),
        ({"until": "latency_s"}, SceneError, "is not FIGURE:WIDTH"),
        (
            {"until": "latency_m:1%"},
            SceneError,
            "no metric of the study gives 'latency_m'; the nearest is 'latency_s'",
        ),
    ],
)
def test_an_invalid_study_is_refused(tmp_path, changes, error, words):
    with pytest.raises(error) as caught:
        swept(tmp_path, **changes)
    assert words in str(caught.value)


@pytest.mark.slow
def test_runs_that_fail_are_named_and_the_others_kept(tmp_path, monkeypatch):
    def failing(plan):
        if plan.scene.seed == 103:
            raise ValueError("no such luck")
        return opir_core.run_of_plan(plan)

    def finished(result):
        return [row["runs_with_value"] for row in result.rows("latency_s")]

    with monkeypatch.context() as patched:
        patched.setattr("opir_studies.runs.run_of_plan", failing)
        with pytest.raises(StudyError) as caught:
            swept(tmp_path)
    assert "2 runs failed; the others are kept" in str(caught.value)
    assert f"design 1 ({PERIOD}=400), seed 103: ValueError: no such luck" in str(caught.value)
    assert finished(load_study(tmp_path)) == [5, 5]
    assert finished(swept(tmp_path)) == [6, 6]


@pytest.mark.slow
def test_a_study_stops_when_the_interval_is_narrow(tmp_path, counted):
    narrow = {"runs": 200, "until": "latency_s:0.08"}
    result = swept(tmp_path, **narrow)
    rows = result.rows("latency_s")
    for row in rows:
        assert 0.5 * (row["high_95"] - row["low_95"]) <= 0.08 or row["runs"] == 200
    assert rows[0]["runs"] == 20 < rows[1]["runs"] < 200
    assert len(counted) == sum(row["runs"] for row in rows)
    # Runs that are there from a longer study change nothing.
    swept(tmp_path / "longer", runs=200)
    shutil.copytree(tmp_path / "longer" / "parts", tmp_path / "again" / "parts")
    assert swept(tmp_path / "again", **narrow).table.equals(result.table)


def test_a_file_is_read_strictly(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text("scene: a/b.yaml\nruns: 3\nvary:\n  seed: [1, 2]\n")
    assert read_study(path).scene == str(tmp_path / "a" / "b.yaml")
    assert read_study(path).vary == {"seed": [1, 2]}
    path.write_text("scene: b.yaml\nrun: 3\nruns: 0\n")
    with pytest.raises(SceneError) as caught:
        read_study(path)
    assert "did you mean runs?" in str(caught.value)
    assert "line 2" in str(caught.value)
    assert "runs: 0 is outside [1, 1000000] (line 3" in str(caught.value)


@pytest.mark.slow
@pytest.mark.peers
def test_results_become_a_frame_of_pandas(tmp_path):
    pytest.importorskip("pandas")
    assert list(swept(tmp_path).to_pandas()["design"].unique()) == [0, 1]


@pytest.mark.slow
def test_results_are_loaded_as_they_were_returned(tmp_path):
    result = swept(tmp_path)
    loaded = load_study(tmp_path)
    assert loaded.table.equals(result.table)
    assert loaded.definition == result.definition
    assert repr(loaded) == "<StudyResult s: 2 designs, 12 runs, 13 figures>"
    with pytest.raises(KeyError, match="there are latency_s"):
        loaded.rows("nothing")
    with pytest.raises(SceneError, match="is no folder of a finished study"):
        load_study(tmp_path / "nowhere")
