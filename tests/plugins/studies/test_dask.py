"""The executor `dask` gives the results of the others."""

from contextlib import closing

import pytest
from opir_dask.executor import DaskExecutor
from opir_studies import LostTasksError, Study, sweep
from opir_testing import ExecutorContract
from study_scene import PERIOD, SCENE
from study_tasks import doubled_or_always_killed, doubled_or_killed

from opir_core.errors import OpirError

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]


class TestDask(ExecutorContract):
    name = "dask"


@pytest.fixture
def executor():
    with closing(DaskExecutor("", 2, 30.0)) as dask:
        yield dask


def test_a_killed_worker_costs_no_result(executor, tmp_path):
    tasks = [(number, str(tmp_path / "killed") if number == 5 else "") for number in range(12)]
    assert dict(executor.results(doubled_or_killed, tasks)) == {
        number: 2 * number for number in range(12)
    }
    assert (tmp_path / "killed").exists()


def test_a_task_that_kills_every_worker_is_lost(executor):
    with pytest.raises(LostTasksError) as caught:
        list(executor.results(doubled_or_always_killed, range(6)))
    assert 3 in caught.value.tasks


def test_no_scheduler_is_one_message():
    message = r"no Dask scheduler answers at tcp://127.0.0.1:1 within 0\.5 s"
    with pytest.raises(OpirError, match=message):
        list(DaskExecutor("tcp://127.0.0.1:1", None, 0.5).results(doubled_or_killed, [(1, "")]))


@pytest.mark.parametrize("workers", [1, 2, 4])
def test_the_bytes_are_those_of_serial(tmp_path, workers):
    varied = {"scene": SCENE, "vary": {PERIOD: [100, 400]}, "runs": 10}
    sweep(Study(**varied, executor="serial"), tmp_path / "serial")
    sweep(Study(**varied, executor="dask"), tmp_path / "dask", workers=workers)
    for name in ("results.parquet", "results.csv", "runs.parquet", "study.json"):
        assert (tmp_path / "dask" / name).read_bytes() == (tmp_path / "serial" / name).read_bytes()
