"""Executors give every result once, whatever happens to their workers."""

import os
from contextlib import closing
from itertools import islice

import pytest
from opir_studies import LostTasksError
from opir_studies.executors import ProcessesExecutor, SerialExecutor
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
    with closing(ProcessesExecutor(2)) as processes:
        yield processes


def test_work_is_done_elsewhere(executor):
    assert os.getpid() not in dict(executor.results(own_number, range(3))).values()
    assert dict(SerialExecutor().results(own_number, [1])) == {0: os.getpid()}


@pytest.mark.parametrize(("setting", "expected"), [(None, "1"), ("3", "3")])
def test_workers_have_one_thread_each_unless_set(monkeypatch, setting, expected):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    if setting:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", setting)
    with closing(ProcessesExecutor(1)) as executor:
        assert dict(executor.results(threads, [0])) == {0: expected}
    assert os.environ.get("OPENBLAS_NUM_THREADS") == setting


def doubles(numbers):
    return {number: 2 * number for number in numbers}


@pytest.mark.slow
def test_a_killed_worker_costs_no_result(executor, tmp_path):
    marks = {number: str(tmp_path / str(number)) for number in (2, 11)}
    tasks = [(number, marks.get(number, "")) for number in range(20)]
    assert dict(executor.results(doubled_or_killed, tasks)) == doubles(range(20))
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.slow
def test_after_one_death_tasks_still_run_beside_each_other(executor, tmp_path):
    death, mark, partner = (str(tmp_path / name) for name in ("death", "mark", "partner"))
    # More tasks than workers: a pool notices the death of its youngest worker at the next task or
    # result.
    tasks = [(death, mark, partner), (death, partner, mark), (death, mark, partner)]
    assert dict(executor.results(is_beside, tasks)) == dict.fromkeys(range(3), True)


@pytest.mark.slow
def test_a_task_that_kills_its_workers_is_lost_after_all_others(executor):
    results = executor.results(doubled_or_always_killed, range(8))
    assert dict(islice(results, 7)) == doubles({*range(8)} - {3})
    with pytest.raises(LostTasksError) as caught:
        next(results)
    assert caught.value.tasks == (3,)


def test_an_executor_can_be_used_again(executor):
    for _ in range(2):
        assert dict(executor.results(doubled, [1, 2])) == {0: 2, 1: 4}


@pytest.mark.slow
def test_a_task_that_hangs_is_lost_with_its_reason():
    results = {}
    message = r"the tracker 'x': step has not returned for 1\."
    with (
        closing(ProcessesExecutor(2, dead_after_s=1.0)) as executor,
        pytest.raises(LostTasksError, match=message) as caught,
    ):
        results.update(executor.results(doubled_or_hung, range(8)))
    assert caught.value.tasks == (3,)
    assert results == doubles({*range(8)} - {3})
