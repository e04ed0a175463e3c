"""Settings of all tests: profiles of hypothesis, time limits, worker processes, and a line on what was left out."""

import os
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, settings

FULL_EXAMPLES = 100
SHARED = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow], "print_blob": True}
# The same examples at each run, so that a change is judged by what it changes; `explore` draws new ones.
settings.register_profile("quick", max_examples=15, derandomize=True, **SHARED)
settings.register_profile("full", max_examples=FULL_EXAMPLES, derandomize=True, **SHARED)
settings.register_profile("explore", max_examples=10 * FULL_EXAMPLES, **SHARED)
# For mutants: that a property fails is enough, a small example would take its time.
settings.register_profile("unshrunk", settings.get_profile("quick"), phases=[Phase.explicit, Phase.generate])
settings.load_profile("quick")

SLOW_TIME_LIMIT_S = 600
MOST_WORKERS = 4

#: Key of the number of slow tests left out, in the configuration and in a worker's answer.
LEFT_OUT = pytest.StashKey[int]()
LEFT_OUT_NAME = "slow_tests_left_out"


def pytest_collection_modifyitems(items: Sequence[pytest.Item]) -> None:
    """Give slow tests, and properties with all examples, a longer time limit than the default in pyproject.toml."""
    slow = {"slow", "hypothesis"} if settings().max_examples >= FULL_EXAMPLES else {"slow"}
    for item in items:
        markers = {marker.name for marker in item.iter_markers()}
        if markers & slow and "timeout" not in markers:
            item.add_marker(pytest.mark.timeout(SLOW_TIME_LIMIT_S))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Return the worker processes of `-n auto`: one more than cores for all tests, none if the command names tests."""
    if config.option.collectonly or any(arguments_of(config)):
        return 0
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores + 1, MOST_WORKERS)


def arguments_of(config: pytest.Config) -> list[str]:
    """Return the files, folders and tests that the command names."""
    return [] if config.args_source is not pytest.Config.ArgsSource.ARGS else list(config.args)


def pytest_deselected(items: Sequence[pytest.Item]) -> None:
    """Count the slow tests that the expression of `-m` leaves out."""
    config, slow = items[0].config, sum(item.get_closest_marker("slow") is not None for item in items)
    config.stash[LEFT_OUT] = config.stash.get(LEFT_OUT, 0) + slow
    if hasattr(config, "workeroutput"):
        config.workeroutput[LEFT_OUT_NAME] = config.stash[LEFT_OUT]


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: object) -> None:
    """Take over the count of a worker: each worker collects all tests."""
    config, output = getattr(node, "config", None), getattr(node, "workeroutput", {})
    if config is not None:
        config.stash[LEFT_OUT] = max(config.stash.get(LEFT_OUT, 0), output.get(LEFT_OUT_NAME, 0))


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Print how many slow tests were left out, and how to run them."""
    if count := config.stash.get(LEFT_OUT, 0):
        tests = "slow test was" if count == 1 else "slow tests were"
        terminalreporter.line(f'{count} {tests} left out. Run them: pytest -m slow. Run all: pytest -m "" or make ci.')
