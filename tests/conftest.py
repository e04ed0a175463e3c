"""Settings of all tests: profiles of hypothesis, time limits, worker processes, and a line on what
was left out.
"""

import os
from collections.abc import Callable

import peer_libraries
import pytest
import thirds
from hypothesis import HealthCheck, Phase, settings

FULL_EXAMPLES = 100
SHARED = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow], "print_blob": True}
# The same examples at each run, so that a change is judged by what it changes; `explore` draws new
# ones.
settings.register_profile("quick", max_examples=15, derandomize=True, **SHARED)
settings.register_profile("full", max_examples=FULL_EXAMPLES, derandomize=True, **SHARED)
settings.register_profile("explore", max_examples=10 * FULL_EXAMPLES, **SHARED)
# For mutants: that a property fails is enough, a small example would take its time.
settings.register_profile(
    "unshrunk", settings.get_profile("quick"), phases=[Phase.explicit, Phase.generate]
)
settings.load_profile("quick")

SLOW_TIME_LIMIT_S = 600
MOST_WORKERS = 4

#: Key of the number of slow tests left out, in the configuration and in a worker's answer.
LEFT_OUT = pytest.StashKey[int]()
LEFT_OUT_NAME = "slow_tests_left_out"
#: Keys of the files left out because a library that they import is not installed, and of those
#: libraries, each in the configuration and in a worker's answer.
FILES = pytest.StashKey[list[str]]()
ABSENT = pytest.StashKey[list[str]]()
#: Keys of the predicates that are true for the slow tests and for the quick ones to be run, by
#: their ids.
IS_CHOSEN = pytest.StashKey[Callable[[str], bool]]()
IS_CHOSEN_QUICK = pytest.StashKey[Callable[[str], bool]]()
PEERS_REQUIRED = os.environ.get("OPIR_PEERS") == "required"


def pytest_configure(config):
    """Read which third of the slow tests is to be run, and which of the quick ones."""
    config.stash[IS_CHOSEN] = thirds.chooser(os.environ.get(thirds.SLOW, ""), thirds.SLOW)
    config.stash[IS_CHOSEN_QUICK] = thirds.chooser(os.environ.get(thirds.QUICK, ""), thirds.QUICK)


def pytest_ignore_collect(collection_path, config):
    """Leave out a file that imports a library of the extra `peers` which is not installed."""
    if PEERS_REQUIRED or collection_path.suffix != ".py" or not peer_libraries.missing():
        return None
    if absent := peer_libraries.imported_by(collection_path) & peer_libraries.missing():
        config.stash[FILES] = [*config.stash.get(FILES, []), str(collection_path)]
        config.stash[ABSENT] = [*config.stash.get(ABSENT, []), *absent]
        return True
    return None


def pytest_collection_finish(session):
    """Give the files left out to the process that started this worker, if this is one."""
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["files"] = session.config.stash.get(FILES, [])
        session.config.workeroutput["absent"] = session.config.stash.get(ABSENT, [])


def pytest_collection_modifyitems(config, items):
    """Mark the tests that need other libraries; give long tests more time, and leave out those of
    other thirds.
    """
    with_peers = {
        path for path in {item.path for item in items} if peer_libraries.imported_by(path)
    }
    # Properties with all examples are slow too.
    slow = {"slow", "hypothesis"} if settings().max_examples >= FULL_EXAMPLES else {"slow"}
    is_chosen = config.stash[IS_CHOSEN]
    is_chosen_quick = config.stash[IS_CHOSEN_QUICK]
    chosen = []
    elsewhere = []
    for item in items:
        if item.path in with_peers:
            item.add_marker(pytest.mark.peers)
        markers = {marker.name for marker in item.iter_markers()}
        if markers & slow and "timeout" not in markers:
            item.add_marker(pytest.mark.timeout(SLOW_TIME_LIMIT_S))
        is_due = (is_chosen if markers & slow else is_chosen_quick)(item.nodeid)
        (chosen if is_due else elsewhere).append(item)
    if elsewhere:
        config.hook.pytest_deselected(items=elsewhere)
        items[:] = chosen


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config):
    """Return the worker processes of `-n auto`: one more than cores for all tests, none if the
    command names tests.
    """
    if config.option.collectonly or any(arguments_of(config)):
        return 0
    cores = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    return min(cores + 1, MOST_WORKERS)


def arguments_of(config):
    """Return the files, folders and tests that the command names."""
    return [] if config.args_source is not pytest.Config.ArgsSource.ARGS else list(config.args)


def pytest_deselected(items):
    """Count the slow tests that the expression of `-m` leaves out."""
    config = items[0].config
    slow = sum(item.get_closest_marker("slow") is not None for item in items)
    config.stash[LEFT_OUT] = config.stash.get(LEFT_OUT, 0) + slow
    if hasattr(config, "workeroutput"):
        config.workeroutput[LEFT_OUT_NAME] = config.stash[LEFT_OUT]


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    """Take over what a worker left out: each worker collects all tests."""
    config = getattr(node, "config", None)
    output = getattr(node, "workeroutput", {})
    if config is not None:
        config.stash[FILES] = output.get("files", [])
        config.stash[ABSENT] = output.get("absent", [])
        config.stash[LEFT_OUT] = max(config.stash.get(LEFT_OUT, 0), output.get(LEFT_OUT_NAME, 0))


def pytest_terminal_summary(terminalreporter, config):
    """Print how many tests and files were left out, why, and how to run them."""
    if files := set(config.stash.get(FILES, [])):
        names = ", ".join(sorted(set(config.stash[ABSENT])))
        what = "file of tests was" if len(files) == 1 else "files of tests were"
        terminalreporter.line(
            f"{len(files)} {what} left out, without {names}: pip install '.[peers]'."
        )
    if count := config.stash.get(LEFT_OUT, 0):
        tests = "slow test was" if count == 1 else "slow tests were"
        terminalreporter.line(
            f'{count} {tests} left out. Run them: pytest -m slow. Run all: pytest -m "" or make ci.'
        )
