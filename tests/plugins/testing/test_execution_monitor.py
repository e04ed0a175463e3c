"""What code asks of the world, and what others ask while it happens to run."""

import gc
import os
import sys
import threading
import time
import warnings
from io import StringIO
from pathlib import Path

import pytest
from attrs import frozen
from opir_testing.contracts.contract import read_config
from opir_testing.execution_monitor import use_of

from opir_core.plugin import DetectionModel, number


def many_containers() -> list[list[int]]:
    return [[number] for number in range(200_000)]


@pytest.mark.slow
def test_callbacks_of_the_collector_are_no_inputs():
    def timed(phase, info):
        time.perf_counter()

    gc.callbacks.append(timed)
    try:
        assert use_of(many_containers).inputs == []
        assert gc.isenabled()
    finally:
        gc.callbacks.remove(timed)


def test_the_clock_is_seen_however_it_was_imported():
    from time import monotonic

    (reported,) = use_of(lambda: monotonic()).inputs
    assert reported.startswith(
        "the clock: time.monotonic (testing/test_execution_monitor.py, line "
    )


def left_open():
    Path(__file__).open().read()  # noqa: SIM115 - what is to be seen


def left_at_work():
    threading.Thread(target=time.sleep, args=(1.5,), name="slow", daemon=False).start()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("act", "words"),
    [
        (lambda: print("x"), "prints (testing/test_execution_monitor.py, line "),  # noqa: T201 - is to be seen
        (lambda: sys.stderr.write("x"), "prints (testing/test_execution_monitor.py, line "),
        (lambda: warnings.warn("odd", stacklevel=1), "warns: UserWarning: odd (testing/"),
        (left_open, "warns: ResourceWarning: unclosed file"),
        (left_at_work, "leaves threads at work: slow"),
    ],
    ids=["print", "write", "warn", "file", "thread"],
)
def test_what_is_left_behind_is_seen(act, words):
    use = use_of(act)
    assert [effect[: len(words)] for effect in use.effects] == [words]
    assert use.inputs == []


def test_the_environment_is_seen_as_it_is_read():
    for read in (lambda: os.environ.get("HOME"), lambda: os.getenv("HOME", "")):
        (reported,) = use_of(read).inputs
        assert reported.startswith("the environment: HOME (testing/")


def test_settings_are_read_where_the_author_reads_them():
    @frozen
    class Settings:
        gate: float = number(default=1.0, help="gate")
        unused: float = number(default=2.0, help="unused")

    component = DetectionModel(name="x", summary="x", config=Settings, build=print)
    settings = Settings()
    use = use_of(lambda: (settings.gate, read_config(component, {})), Settings)
    assert use.settings_read == {"gate"}
    assert "__getattribute__" not in vars(Settings)


def test_a_date_that_stays_in_a_drawing_differs_in_the_next() -> None:
    """matplotlib reads the clock for undated drawings too, so that its reading tells nothing."""
    matplotlib = pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    def drawing() -> str:
        stream = StringIO()
        with matplotlib.rc_context({"svg.hashsalt": "one"}):
            Figure().savefig(stream, format="svg")
        return stream.getvalue()

    assert use_of(drawing).inputs == []
    assert drawing() != drawing()
