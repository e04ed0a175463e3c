"""Watching what code asks of the world: the clock, entropy, the network, and random numbers that everybody shares.

Python's profiler sees each call of a C function, however it was imported, so nothing is patched and nothing escapes by
`from time import time`. Calls from within C code (a client library's own threads) are not seen.
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

_CLOCK = {"time", "time_ns", "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "process_time", "sleep"}
_DATES = {"now", "utcnow", "today"}
#: Modules that may look at the clock or ask for entropy on their own account. Philox draws entropy for a seed sequence
#: that it then does not use, because the core's streams give it a key.
_EXEMPT = {"logging", "threading", "importlib._bootstrap", "queue", "tempfile", "opir_core.random_streams.philox"}
#: Seeds of the two global generators while code is watched; nobody would come upon them otherwise.
_MARK = 0x6F706972


def asked_of_the_world(act: Callable[[], object]) -> list[str]:
    """Return what a function asks of clock, entropy, network and global random state, each with the place it is asked.

    The function is run once beforehand, so that what modules do when they are imported does not count.
    """
    act()
    with _global_states_marked() as marked, _watched() as seen:
        act()
        if _global_states() != marked:
            seen.append("global random state: numbers are drawn from it, or it is seeded")
    return list(dict.fromkeys(seen))


@contextmanager
def _global_states_marked() -> Iterator[tuple[object, ...]]:
    state, numpy_state = random.getstate(), _numpy_state()
    random.seed(_MARK)
    np.random.seed(_MARK)  # noqa: NPY002 - the very state that is watched
    try:
        yield _global_states()
    finally:
        random.setstate(state)
        np.random.set_state(numpy_state)  # noqa: NPY002


@contextmanager
def _watched() -> Iterator[list[str]]:
    seen: list[str] = []

    def note(frame: FrameType, event: str, argument: Any) -> None:
        what = _forbidden(argument) if event == "c_call" else ""
        asker = _asker(frame) if what else None
        if asker is not None:
            seen.append(f"{what} ({_place(asker)})")

    # What others hang on the collector (hypothesis times it) is not asked by the code that happens to set it off.
    collects = gc.isenabled()
    gc.disable()
    earlier = sys.getprofile()
    threading.setprofile(note)
    sys.setprofile(note)
    try:
        yield seen
    finally:
        sys.setprofile(earlier)
        threading.setprofile(earlier)
        if collects:
            gc.enable()


def _forbidden(function: Any) -> str:
    """Return what kind of thing a C function asks of the world, "" for all others."""
    name, module = getattr(function, "__name__", ""), getattr(function, "__module__", None)
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


def _asker(frame: FrameType | None) -> FrameType | None:
    """Return the innermost frame that is not the standard library's, or None where one may ask on its own account."""
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


def _place(frame: FrameType) -> str:
    path = PurePath(frame.f_code.co_filename)
    return f"{'/'.join(path.parts[-2:])}, line {frame.f_lineno}"
