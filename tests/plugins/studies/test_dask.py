"""The executor `dask` gives the results of the others."""

import os
import socket
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest
import study_tasks
from opir_dask.executor import DaskExecutor
from opir_studies import LostTasksError, Study, sweep
from opir_testing import ExecutorContract
from study_scene import PERIOD, SCENE
from study_tasks import doubled_or_always_killed, doubled_or_killed, slept

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


def program(*words):
    """Return a process of Dask's command line."""
    return subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(Path(study_tasks.__file__).parent)},
    )


@pytest.fixture
def cluster(tmp_path):
    """Yield the address of a scheduler, its process and that of its one worker."""
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    scheduler = program("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    worker = program(
        "worker", address, "--no-nanny", "--nthreads", "1", "--local-directory", str(tmp_path)
    )
    yield address, scheduler, worker
    for process in (worker, scheduler):
        end(process)


def end(process):
    process.kill()
    process.wait(30.0)


def free_port():
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        return listening.getsockname()[1]


DEATHS = pytest.mark.parametrize(
    ("dies", "message"),
    [
        ("worker", r"has had no worker for 3 s; start it and its workers, and run the study again"),
        ("scheduler", r"has ended or been restarted; start it"),
    ],
)


@DEATHS
def test_a_cluster_that_dies_ends_with_words(cluster, dies, message):
    address, scheduler, worker = cluster
    with closing(DaskExecutor(address, None, 30.0)) as dask:
        results = dask.results(slept, [0.0, 60.0])
        assert next(results) == (0, 0.0)
        dask._timeout_s = 3.0
        end({"worker": worker, "scheduler": scheduler}[dies])
        began_s = time.monotonic()
        with pytest.raises(OpirError, match=message):
            list(results)
        assert time.monotonic() - began_s < 60.0


@DEATHS
def test_a_cluster_that_dies_with_results_ends_with_words(cluster, dies, message):
    address, scheduler, worker = cluster
    with closing(DaskExecutor(address, None, 30.0)) as dask:
        results = dask.results(slept, [0.0, 1.0, 1.0, 1.0])
        next(results)
        time.sleep(6.0)  # the others end, and none is fetched
        next(results)
        dask._timeout_s = 3.0
        end({"worker": worker, "scheduler": scheduler}[dies])
        with pytest.raises(OpirError, match=message):
            list(results)


@pytest.mark.parametrize("workers", [1, 2, 4])
def test_the_bytes_are_those_of_serial(tmp_path, workers):
    varied = {"scene": SCENE, "vary": {PERIOD: [100, 400]}, "runs": 10}
    sweep(Study(**varied, executor="serial"), tmp_path / "serial")
    sweep(Study(**varied, executor="dask"), tmp_path / "dask", workers=workers)
    for name in ("results.parquet", "results.csv", "runs.parquet", "study.json"):
        assert (tmp_path / "dask" / name).read_bytes() == (tmp_path / "serial" / name).read_bytes()
