"""Executors give every result once, whatever happens to their workers."""

import os
from itertools import islice

import pytest
from opir_studies.executors import LostTasksError, ProcessesExecutor, SerialExecutor
from opir_testing import ExecutorContract
from study_tasks import (
    doubled,
    doubled_or_always_killed,
    doubled_or_hung,
    doubled_or_killed,
    is_beside,
    own_number,
    threads,
)


class TestSerial(ExecutorContract):
    name = "serial"


@pytest.mark.slow
class TestProcesses(ExecutorContract):
    name = "processes"


@pytest.fixture
def executor():
    made = ProcessesExecutor(2)
    yield made
    made.close()


def test_work_is_done_elsewhere(executor):
    assert os.getpid() not in dict(executor.results(own_number, range(3))).values()
    assert dict(SerialExecutor().results(own_number, [1])) == {0: os.getpid()}


def test_workers_have_one_thread_each_unless_the_user_says_otherwise(monkeypatch):
    for given, found in ((None, "1"), ("3", "3")):
        monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
        if given:
            monkeypatch.setenv("OPENBLAS_NUM_THREADS", given)
        executor = ProcessesExecutor(1)
        assert dict(executor.results(threads, [0])) == {0: found}
        executor.close()
        assert os.environ.get("OPENBLAS_NUM_THREADS") == given


@pytest.mark.slow
def test_a_killed_worker_costs_no_result(executor, tmp_path):
    tasks = [
        (number, str(tmp_path / f"killed-{number}") if number in (2, 11) else "")
        for number in range(20)
    ]
    assert dict(executor.results(doubled_or_killed, tasks)) == {
        number: 2 * number for number in range(20)
    }
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.slow
def test_after_one_death_tasks_still_run_beside_each_other(executor, tmp_path):
    death, one, other = (str(tmp_path / name) for name in ("death", "one", "other"))
    # More tasks than workers: a pool notices the death of its youngest worker at the next task or
    # result.
    tasks = [(death, one, other), (death, other, one), (death, one, other)]
    assert dict(executor.results(is_beside, tasks)) == dict.fromkeys(range(3), True)


@pytest.mark.slow
def test_a_task_that_kills_every_worker_is_lost_alone(executor):
    found = {}
    with pytest.raises(LostTasksError) as caught:
        found.update(executor.results(doubled_or_always_killed, range(8)))
    assert caught.value.tasks == (3,)


@pytest.mark.slow
def test_all_other_results_come_before_the_loss(executor):
    results = executor.results(doubled_or_always_killed, range(8))
    found = dict(islice(results, 7))
    with pytest.raises(LostTasksError):
        next(results)
    assert found == {number: 2 * number for number in range(8) if number != 3}


def test_an_executor_can_be_used_again(executor):
    for _ in range(2):
        assert dict(executor.results(doubled, [1, 2])) == {0: 2, 1: 4}


@pytest.mark.slow
def test_a_task_that_hangs_is_lost_alone_with_its_reason():
    executor = ProcessesExecutor(2, dead_after_s=1.0)
    found = {}
    with pytest.raises(
        LostTasksError, match=r"the tracker 'x': step has not returned for 1\."
    ) as caught:
        found.update(executor.results(doubled_or_hung, range(8)))
    executor.close()
    assert caught.value.tasks == (3,)
    assert found == {number: 2 * number for number in range(8) if number != 3}
