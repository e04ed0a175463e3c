"""The runs of a study stay on the disk: the client keeps none, and reads columns in the order of
their numbers, whatever wrote them.
"""

import gc
import itertools

import numpy as np
import pyarrow as pa
import pytest
from opir_studies import Study, sweep
from opir_studies.finished import FinishedRuns
from opir_studies.planning import planned_study
from opir_studies.result import written_result
from opir_studies.runs import RunRecord, TaskResult
from study_scene import PERIOD, SCENE

STUDY = Study(
    scene={**SCENE, "duration_s": 2.0},
    study="s",
    runs=700,
    metrics=("latency",),
    vary={PERIOD: [500, 1000]},
    executor="serial",
)


@pytest.fixture(scope="module")
def planned():
    return planned_study(STUDY)


def record(planned, number):
    """Return the record of a run whose every figure is its number."""
    launches = len(planned.designs[0].launches)
    columns = (
        ("ICBM",) * launches if unit == "name" else (float(number),) * launches
        for unit in planned.launch_units.values()
    )
    values = (float(number),) * len(planned.units)
    return RunRecord(number, 7 + number, 0.5, values, launches=tuple(columns))


def written(planned, folder, parts):
    """Return the result of runs that are written as parts of these numbers, design after design."""
    finished = FinishedRuns.of(planned, folder)
    for design in (0, 1):
        for numbers in parts:
            finished.add(design, [record(planned, number) for number in numbers])
    return written_result(planned, folder, finished.first([STUDY.runs] * 2))


def test_columns_are_in_the_order_of_runs_whatever_wrote_them(planned, tmp_path):
    reference = written(planned, tmp_path / "whole", [range(700)])
    parts = [range(500, 700), [3, 1, 2, 0], range(3, 500), [10]]
    parted = written(planned, tmp_path / "parted", parts)
    for name in ("runs.parquet", "launches.parquet", "results.parquet", "study.json"):
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "parted" / name).read_bytes()
    assert parted.values("latency_s").tolist() == 2 * list(map(float, range(700)))
    assert parted.launches["seed"].to_pylist() == reference.launches["seed"].to_pylist()
    assert parted.run_count == 1400


def test_a_run_that_is_not_there_leaves_no_row(planned, tmp_path):
    result = written(planned, tmp_path, [range(200), range(201, 699)])
    numbers = [*range(200), *range(201, 699)]
    assert result.runs["replicate"].to_pylist() == 2 * numbers
    row = result.rows("latency_s")[1]
    assert row["runs"] == 698
    assert row["mean"] == pytest.approx(np.mean(numbers))
    assert row["difference"] == 0.0
    assert result.definition["notes"][0].startswith("4 of 1400 runs failed")


def test_runs_of_another_study_are_not_counted(planned, tmp_path):
    written(planned, tmp_path, [range(700)])
    second_study = planned_study(
        Study(
            scene={**SCENE, "duration_s": 3.0},
            study="s",
            runs=700,
            metrics=("latency",),
            executor="serial",
        )
    )
    found = FinishedRuns.of(second_study, tmp_path)
    assert found.count(range(700)) == 0
    assert found.missing(0, range(1, 700, 2)).tolist() == list(range(1, 700, 2))


def test_a_scene_without_launches_has_a_table_without_rows(tmp_path):
    study = Study(
        scene={**SCENE, "targets": [], "duration_s": 2.0},
        study="s",
        runs=3,
        metrics=("latency",),
        executor="serial",
    )
    assert sweep(study, tmp_path).launches.num_rows == 0


def test_the_client_keeps_no_run(planned, tmp_path, monkeypatch):
    def result_of(task):
        return TaskResult({}, tuple(record(planned, number) for number in task.replicates))

    monkeypatch.setattr("opir_studies.sweeping.result_of", result_of)
    calls, counts = itertools.count(), []

    def count_now_and_then(_runs):
        if next(calls) % 16 == 15:
            counts.append(sum(type(item) is RunRecord for item in gc.get_objects()))

    sweep(STUDY, tmp_path, on_progress=count_now_and_then)
    longest_task = 2 * STUDY.runs // 64
    assert max(counts) <= longest_task


def test_a_table_is_written_in_groups_of_rows(tmp_path):
    from opir_studies.tables import write_rows

    tables = [pa.table({"x": np.arange(start, start + 9000.0)}) for start in (0.0, 9000.0, 18000.0)]
    write_rows(tmp_path / "x.parquet", tables[0].schema, iter(tables))
    file = pa.parquet.ParquetFile(tmp_path / "x.parquet")
    assert file.read()["x"].to_pylist() == np.arange(27000.0).tolist()
    assert max(file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)) <= 18000
