"""Monitors of a function's execution: bytecode instructions, and use of clock, entropy, network,
global random state.

The count of instructions is the same on every machine. Array code needs a number that hardly
depends on the rows; a loop over rows needs several for each. Python's profiler sees each call of a
C function, however it was imported; calls from within C code (threads of a client library) are not
seen.
"""

import gc
import random
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import PurePath
from types import FrameType
from typing import Any

import numpy as np

#: A loop over rows takes more steps than this for each row; array computations in blocks of rows
#: take fewer.
LOOP_STEPS = 8.0


def python_steps(act: Callable[[], object]) -> int:
    """Return the number of bytecode instructions of a function and of all that it calls.

    The function runs once before, so that imports and caches do not count.
    """
    act()
    count = 0

    def note(frame: FrameType, event: str, _argument: Any) -> Any:
        nonlocal count
        frame.f_trace_opcodes = True
        frame.f_trace_lines = False
        count += event == "opcode"
        return note

    earlier = sys.gettrace()
    sys.settrace(note)
    try:
        act()
    finally:
        sys.settrace(earlier)
    return count


def steps_per_row(act: Callable[[int], object], few: int, many: int) -> float:
    """Return the additional steps of a function for each additional row, between `few` and `many`
    rows; what the first call makes once is not counted.
    """
    act(few)
    return (python_steps(lambda: act(many)) - python_steps(lambda: act(few))) / (many - few)


_CLOCK = {
    "time",
    "time_ns",
    "monotonic",
    "monotonic_ns",
    "perf_counter",
    "perf_counter_ns",
    "process_time",
    "sleep",
}
_DATES = {"now", "utcnow", "today"}
#: Modules that may use clock and entropy themselves. Philox draws entropy for a seed sequence that
#: it does not use, because the core's streams give it a key; the boundary of plugins notes when a
#: call began, for the watchdog.
_OWN = {"opir_core.random_streams.philox", "opir_core.host.boundary"}
_EXEMPT = {"logging", "threading", "importlib._bootstrap", "queue", "tempfile", *_OWN}
#: The seed of both global generators during monitoring; no other code uses it.
_MARK = 0x6F706972


def outside_inputs(act: Callable[[], object]) -> list[str]:
    """Return the uses of clock, entropy, network and global random state by a function, each with
    its source line.

    The function runs once before, so that imports do not count.
    """
    act()
    with _marked_global_states() as marked, _monitored() as uses:
        act()
        if _global_states() != marked:
            uses.append("global random state: numbers are drawn from it, or it is seeded")
    return list(dict.fromkeys(uses))


@contextmanager
def _marked_global_states() -> Iterator[tuple[object, ...]]:
    state = random.getstate()
    numpy_state = _numpy_state()
    random.seed(_MARK)
    np.random.seed(_MARK)  # noqa: NPY002 - the state that is monitored
    try:
        yield _global_states()
    finally:
        random.setstate(state)
        np.random.set_state(numpy_state)  # noqa: NPY002


@contextmanager
def _monitored() -> Iterator[list[str]]:
    uses = []

    def note(frame: FrameType, event: str, argument: Any) -> None:
        use = _outside_input(argument) if event == "c_call" else ""
        caller = _caller(frame) if use else None
        if caller is not None:
            uses.append(f"{use} ({_source_line(caller)})")

    # Callbacks of the garbage collector (hypothesis times it) are not part of the monitored code.
    collects = gc.isenabled()
    gc.disable()
    earlier = sys.getprofile()
    threading.setprofile(note)
    sys.setprofile(note)
    try:
        yield uses
    finally:
        sys.setprofile(earlier)
        threading.setprofile(earlier)
        if collects:
            gc.enable()


def _outside_input(function: Any) -> str:
    """Return the outside input that a C function reads, "" for none."""
    name = getattr(function, "__name__", "")
    module = getattr(function, "__module__", None)
    owner = getattr(function, "__self__", None)
    if module == "time" and name in _CLOCK:
        return f"the clock: time.{name}"
    if name in _DATES and isinstance(owner, type) and owner.__module__ == "datetime":
        return f"the clock: {owner.__name__}.{name}"
    if name in {"urandom", "getrandom"} and module in {"posix", "nt"}:
        return f"entropy: os.{name}"
    if module == "_socket" or type(owner).__module__ in {"_socket", "socket"}:
        return f"the network: socket.{name}"
    return ""


def _caller(frame: FrameType | None) -> FrameType | None:
    """Return the innermost frame outside the standard library, or None inside an exempt module."""
    while frame is not None:
        module = frame.f_globals.get("__name__", "")
        if module in _EXEMPT or module.partition(".")[0] in _EXEMPT:
            return None
        if module.partition(".")[0] not in sys.stdlib_module_names:
            return frame
        frame = frame.f_back
    return None


def _global_states() -> tuple[object, ...]:
    numpy_state = _numpy_state()
    return (random.getstate(), numpy_state["state"]["key"].tobytes(), numpy_state["state"]["pos"])


def _numpy_state() -> Any:
    return np.random.get_state(legacy=False)  # noqa: NPY002


def _source_line(frame: FrameType) -> str:
    path = PurePath(frame.f_code.co_filename)
    return f"{'/'.join(path.parts[-2:])}, line {frame.f_lineno}"
