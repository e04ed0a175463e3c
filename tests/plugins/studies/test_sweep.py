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
from opir_studies import (
    Study,
    StudyError,
    load_study,
    read_study,
    sweep,
    sweeping as sweeping_module,
)
from opir_studies.runs import result_of
from opir_studies.statistics import interval
from scipy.stats import bootstrap, ttest_1samp
from study_scene import PERIOD, SCENE

import opir_core
from opir_core.errors import PluginError, SceneError

TABLES = ("results.parquet", "results.csv", "runs.parquet", "study.json")


def study(**changes):
    base = {
        "scene": SCENE,
        "study": "s",
        "vary": {PERIOD: [100, 400]},
        "runs": 6,
        "executor": "serial",
    }
    return Study(**{**base, **changes})


def tables_of(folder):
    return {name: (folder / name).read_bytes() for name in TABLES}


def test_intervals_are_cut_at_0_and_shares_at_1_but_not_counts(tmp_path):
    """The whole interval of a mean latency reaches below 0; false tracks are a count, without a
    bound at 1.
    """
    found = sweep(
        study(metrics=("latency", "tracks"), runs=3, vary={PERIOD: [100, 9000]}), tmp_path
    )
    assert found.definition["bounds"]["detected"] == [0.0, 1.0]
    assert found.definition["bounds"]["false_tracks"] == [0.0, None]
    wide = [row for row in found.rows("latency_s") if row["low_95"] < 0.0]
    assert wide
    assert min(row["low_95"] for row in found.shown_rows("latency_s")) == 0.0
    assert [row["high_95"] for row in found.shown_rows("latency_s")] == [
        row["high_95"] for row in found.rows("latency_s")
    ]


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

    monkeypatch.setattr(sweeping_module, "result_of", counting)
    return runs


@pytest.mark.parametrize("name", ["opir-core", "numpy", "opir-trackers"])
def test_a_worker_with_another_version_is_refused(tmp_path, monkeypatch, name):
    def made_elsewhere(task):
        result = result_of(task)
        assert name in result.versions
        return evolve(result, versions={**result.versions, name: "0.0.1"})

    monkeypatch.setattr(sweeping_module, "result_of", made_elsewhere)
    scene = {**SCENE, "tracker": "kepler-arc"}
    with pytest.raises(
        SceneError, match=f"a worker has {name} 0.0.1, and this is .*; install the same on both"
    ):
        sweep(study(runs=1, scene=scene), tmp_path)


@pytest.mark.slow
def test_a_row_of_a_run_is_what_the_run_alone_gives(tmp_path):
    found = sweep(study(), tmp_path).runs.to_pylist()
    assert len(found) == 12
    for row in (found[1], found[8]):
        overrides = [f"{PERIOD}={row[PERIOD]:g}", f"seed={row['seed']}"]
        run = opir_core.simulate(opir_core.scene_from_mapping(SCENE, overrides=overrides))
        assert row["latency_s"] == run.summary["targets"][0]["latency_s"]
        assert row["seed"] == SCENE["seed"] + row["replicate"]


@pytest.mark.slow
def test_seeds_do_not_depend_on_the_design(tmp_path):
    rows = sweep(study(), tmp_path).runs.to_pylist()
    assert (
        [row["seed"] for row in rows[:6]]
        == [row["seed"] for row in rows[6:]]
        == list(range(100, 106))
    )


@pytest.mark.slow
def test_statistics_are_those_of_scipy(tmp_path):
    result = sweep(study(runs=12), tmp_path)
    runs = result.runs.to_pylist()
    first, second = (
        np.array([row["latency_s"] for row in runs if row["design"] == number]) for number in (0, 1)
    )
    row = result.rows("latency_s")[1]
    low, high = ttest_1samp(second, 0.0).confidence_interval(0.95)
    assert row["mean"] == pytest.approx(second.mean(), rel=1e-12)
    assert (row["low_95"], row["high_95"]) == (
        pytest.approx(low, rel=1e-9),
        pytest.approx(high, rel=1e-9),
    )
    assert row["sd"] == pytest.approx(np.std(second, ddof=1), rel=1e-12)
    paired = ttest_1samp(second - first, 0.0).confidence_interval(0.95)
    assert row["difference"] == pytest.approx((second - first).mean(), rel=1e-12)
    assert row["difference_low_95"] == pytest.approx(paired.low, rel=1e-9)
    assert row["difference_high_95"] == pytest.approx(paired.high, rel=1e-9)
    assert (row["runs"], row["first_seed"], row["last_seed"], row["unit"]) == (12, 100, 111, "s")


def test_the_interval_agrees_with_a_bootstrap():
    values = np.random.default_rng(3).normal(5.0, 2.0, 400)
    _, low, high = interval(values)
    theirs = bootstrap((values,), np.mean, rng=np.random.default_rng(0)).confidence_interval
    assert low == pytest.approx(theirs.low, abs=0.1 * (high - low))
    assert high == pytest.approx(theirs.high, abs=0.1 * (high - low))
    assert interval(np.array([2.0, np.nan]))[0] == 2.0
    assert np.isnan(interval(np.array([2.0]))[1:]).all()
    assert np.isnan(interval(np.array([np.nan]))).all()


@pytest.mark.slow
def test_a_finished_study_runs_nothing_again(tmp_path, counted):
    sweep(study(), tmp_path)
    first = tables_of(tmp_path)
    count = len(counted)
    assert count == 12
    sweep(study(), tmp_path)
    assert len(counted) == count
    assert tables_of(tmp_path) == first


@pytest.mark.slow
def test_a_changed_study_keeps_the_runs_that_still_match(tmp_path, counted):
    sweep(study(), tmp_path)
    counted.clear()
    sweep(study(vary={PERIOD: [400, 800]}, runs=8), tmp_path)
    assert sorted(counted) == [(400.0, 6), (400.0, 7), *((800.0, number) for number in range(8))]
    sweep(study(metrics=["latency"]), tmp_path)
    assert len(counted) == 10 + 12
    whole = sweep(study(vary={PERIOD: [400, 800]}, runs=8), tmp_path / "other")
    again = sweep(study(vary={PERIOD: [400, 800]}, runs=8), tmp_path)
    assert again.table.equals(whole.table)
    assert load_study(tmp_path).runs.equals(whole.runs)


@pytest.mark.slow
def test_a_damaged_or_foreign_part_is_named(tmp_path):
    sweep(study(), tmp_path)
    before = tables_of(tmp_path)
    part = next((tmp_path / "parts").glob("*.parquet"))
    (tmp_path / "parts" / "x.parquet.part").write_bytes(b"half")
    content = part.read_bytes()
    part.write_bytes(content[:-20])
    with pytest.raises(SceneError, match=r"is damaged .*delete it, and its runs are made again"):
        sweep(study(), tmp_path)
    part.unlink()
    sweep(study(), tmp_path)
    assert tables_of(tmp_path) == before
    assert not list((tmp_path / "parts").glob("*.part"))
    pq.write_table(pa.table({"key": ["a"]}), tmp_path / "parts" / "foreign.parquet")
    with pytest.raises(SceneError, match="is no part of a study"):
        sweep(study(), tmp_path)


@pytest.mark.slow
def test_the_bytes_do_not_depend_on_the_executor(tmp_path):
    varied = study(vary={PERIOD: [100, 200, 400], "targets[0].launch.time_s": [1.0, 1.5]}, runs=15)
    sweep(varied, tmp_path / "serial")
    expected = tables_of(tmp_path / "serial")
    for workers in (1, 2, 4):
        changed = study(vary=varied.vary, runs=15, executor={"processes": {"workers": workers}})
        sweep(changed, tmp_path / str(workers))
        assert tables_of(tmp_path / str(workers)) == expected


@pytest.mark.slow
@pytest.mark.parametrize("kill", ["parent", "worker"])
def test_a_kill_loses_only_the_runs_under_way(tmp_path, kill):
    sweep(study(runs=150), tmp_path / "whole")
    scene = tmp_path / "scene.json"
    scene.write_text(json.dumps(SCENE))
    words = [
        sys.executable,
        "-m",
        "opir_core",
        "sweep",
        str(scene),
        "--vary",
        f"{PERIOD}=100,400",
        "--runs",
        "150",
    ]
    command = [*words, "--out", str(tmp_path / "killed"), "--workers", "2", "--quiet"]
    process = subprocess.Popen(command)
    parts = tmp_path / "killed" / "parts"
    until = time.monotonic() + 240.0
    while (
        len(list(parts.glob("*.parquet")) if parts.exists() else []) < 4
        and time.monotonic() < until
    ):
        time.sleep(0.01)
    workers = children_of(process.pid)
    assert workers, process.kill()
    if kill == "parent":
        process.kill()
        process.wait()
        kept = sum(pq.read_metadata(path).num_rows for path in parts.glob("*.parquet"))
        assert 0 < kept < 300
        while any(is_alive(worker) for worker in workers) and time.monotonic() < until:
            time.sleep(0.05)
        assert not any(is_alive(worker) for worker in workers), "workers outlive their parent"
        assert subprocess.run(command, check=False).returncode == 0
    else:
        os.kill(workers[-1], signal.SIGKILL)
        assert process.wait(240) == 0
    assert (tmp_path / "killed" / "runs.parquet").read_bytes() == (
        tmp_path / "whole" / "runs.parquet"
    ).read_bytes()
    # No run is on the disk twice.
    keys = [
        key for path in parts.glob("*.parquet") for key in pq.read_table(path)["key"].to_pylist()
    ]
    assert len(keys) == len(set(keys)) == 300


def children_of(number):
    listed = subprocess.run(
        ["ps", "-ww", "-o", "pid=,args=", "--ppid", str(number)],
        capture_output=True,
        text=True,
        check=False,
    )
    rows = [line.split(None, 1) for line in listed.stdout.splitlines()]
    return [int(pid) for pid, words in rows if "spawn_main" in words]


def is_alive(number):
    state = subprocess.run(
        ["ps", "-o", "stat=", "-p", str(number)], capture_output=True, text=True, check=False
    ).stdout
    return bool(state.strip()) and not state.startswith("Z")


def test_every_design_is_checked_before_the_first_run(tmp_path, counted):
    with pytest.raises(SceneError) as caught:
        sweep(study(vary={PERIOD: [100, -1, 0]}), tmp_path)
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
        sweep(study(**changes), tmp_path)
    assert words in str(caught.value)


@pytest.mark.slow
def test_runs_that_fail_are_named_and_the_others_kept(tmp_path, monkeypatch):
    from opir_studies import runs as runs_module

    whole = runs_module.run_of_plan

    def failing(plan):
        if plan.scene.seed == 103:
            raise ValueError("no such luck")
        return whole(plan)

    monkeypatch.setattr(runs_module, "run_of_plan", failing)
    with pytest.raises(StudyError) as caught:
        sweep(study(), tmp_path)
    assert "2 runs failed; the others are kept" in str(caught.value)
    assert f"design 1 ({PERIOD}=400), seed 103: ValueError: no such luck" in str(caught.value)
    assert [row["runs_with_value"] for row in load_study(tmp_path).rows("latency_s")] == [5, 5]
    monkeypatch.setattr(runs_module, "run_of_plan", whole)
    assert [row["runs_with_value"] for row in sweep(study(), tmp_path).rows("latency_s")] == [6, 6]


@pytest.mark.slow
def test_a_study_stops_when_the_interval_is_narrow(tmp_path, counted):
    result = sweep(study(runs=200, until="latency_s:0.08"), tmp_path)
    rows = result.rows("latency_s")
    for row in rows:
        width = 0.5 * (row["high_95"] - row["low_95"])
        assert width <= 0.08 or row["runs"] == 200
    assert rows[0]["runs"] == 20 < rows[1]["runs"] < 200
    assert len(counted) == sum(row["runs"] for row in rows)
    # Runs that are there from a longer study change nothing.
    sweep(study(runs=200), tmp_path / "longer")
    shutil.copytree(tmp_path / "longer" / "parts", tmp_path / "again" / "parts")
    assert sweep(study(runs=200, until="latency_s:0.08"), tmp_path / "again").table.equals(
        result.table
    )


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
    assert list(sweep(study(), tmp_path).to_pandas()["design"].unique()) == [0, 1]


@pytest.mark.slow
def test_results_are_loaded_as_they_were_returned(tmp_path):
    result = sweep(study(), tmp_path)
    again = load_study(tmp_path)
    assert again.table.equals(result.table)
    assert again.definition == result.definition
    assert repr(again) == "<StudyResult s: 2 designs, 12 runs, 13 figures>"
    with pytest.raises(KeyError, match="there are latency_s"):
        again.rows("nothing")
    with pytest.raises(SceneError, match="is no folder of a finished study"):
        load_study(tmp_path / "nowhere")
