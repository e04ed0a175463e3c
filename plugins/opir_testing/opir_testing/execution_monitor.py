"""Monitors of a function's execution: bytecode instructions; use of clock, entropy, environment,
network and global random state; what is printed, warned of or left open; settings that are read.

The count of instructions is the same on every machine. Array code needs a number that hardly
depends on the rows; a loop over rows needs several for each. Python's profiler sees each call of a
C function, however it was imported; calls from within C code (threads of a client library) are not
seen.
"""

import gc
import inspect
import linecache
import os
import random
import sys
import threading
import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import PurePath
from types import FrameType
from typing import Any

import numpy as np
from attrs import frozen, has

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
    *("strftime", "localtime", "gmtime", "ctime", "asctime"),
}
_DATES = {"now", "utcnow", "today"}
#: Modules that may use clock, entropy and environment themselves. Philox draws entropy for a seed
#: sequence that it does not use, because the core's streams give it a key; the boundary of plugins
#: notes when a call began, for the watchdog; the host reads which plugins are allowed. matplotlib
#: dates a file that it draws for the layout alone: a date that remains differs in the next SVG.
_OWN = {"opir_core.random_streams.philox", "opir_core.host.boundary", "opir_core.host.host"}
_LIBRARIES = {"logging", "threading", "importlib._bootstrap", "queue", "tempfile", "matplotlib"}
_EXEMPT = _LIBRARIES | _OWN
#: The function that reads a variable of the environment.
_ENVIRONMENT = type(os.environ).__getitem__.__code__
#: Modules that read every setting, whatever a component does with it.
_READING = ("opir_core.scene.", "opir_core.reading.", "opir_testing.")
#: How long a thread may still run after the function has returned, s.
_ENDING_S = 1.0
#: The seed of both global generators during monitoring; no other code uses it.
_MARK = 0x6F706972


@frozen
class Use:
    """What a function reads from outside and leaves behind, each with its source line, and the
    names of the settings that it reads.
    """

    inputs: Sequence[str]
    effects: Sequence[str]
    settings_read: Collection[str]


def use_of(act: Callable[[], object], config: type = object) -> Use:
    """Return the uses of clock, entropy, environment, network and global random state by a
    function, what it prints, warns of and leaves open, and which fields of configurations of a
    class it reads.

    The function runs once before, so that imports do not count.
    """
    with _settings_recorded(config) as settings, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        act()
    with _marked_global_states() as marked, _effects() as effects, _monitored(effects) as uses:
        act()
        if _global_states() != marked:
            uses.append("global random state: numbers are drawn from it, or it is seeded")
    return Use(list(dict.fromkeys(uses)), list(dict.fromkeys(effects)), settings)


@contextmanager
def _settings_recorded(config: type) -> Iterator[set[str]]:
    """Record the fields of a configuration class that are read outside of the reading of scenes."""
    names: set[str] = set()
    if not has(config):
        yield names
        return
    earlier = config.__getattribute__

    def noted(settings: object, name: str) -> Any:
        own = inspect.currentframe()
        frame = own and own.f_back
        while frame is not None and _is_of_attrs(frame):
            frame = frame.f_back
        if frame is not None and not _module_of(frame).startswith(_READING):
            names.add(name)
        return earlier(settings, name)

    is_own = "__getattribute__" in vars(config)
    config.__getattribute__ = noted  # type: ignore[method-assign]
    try:
        yield names
    finally:
        if is_own:
            config.__getattribute__ = earlier  # type: ignore[method-assign]
        else:
            del config.__getattribute__


def _is_of_attrs(frame: FrameType) -> bool:
    """Return whether a frame is of attrs, or of a method that it has generated."""
    is_generated = frame.f_code.co_filename.startswith("<attrs")
    return is_generated or _module_of(frame).partition(".")[0] in {"attr", "attrs"}


@contextmanager
def _effects() -> Iterator[list[str]]:
    """Collect the warnings that are raised, and the threads that are left at work."""
    effects: list[str] = []
    threads = set(threading.enumerate())
    with warnings.catch_warnings(record=True) as raised:
        warnings.simplefilter("always")
        yield effects
    for warning in raised:
        place = _shortened(warning.filename, warning.lineno)
        effects.append(f"warns: {warning.category.__name__}: {warning.message} ({place})")
    for thread in set(threading.enumerate()) - threads:
        if not thread.daemon:
            thread.join(_ENDING_S)
        if thread.is_alive() and not thread.daemon:
            effects.append(f"leaves threads at work: {thread.name}")


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
def _monitored(effects: list[str]) -> Iterator[list[str]]:
    uses: list[str] = []

    def note(frame: FrameType, event: str, argument: Any) -> None:
        use = effect = ""
        if event == "c_call":
            use = _outside_input(argument)
            effect = "" if use else _print_of(argument)
        elif event == "call" and frame.f_code is _ENVIRONMENT:
            use = f"the environment: {frame.f_locals.get('key')}"
        caller = _caller(frame) if use or effect else None
        if event == "call" and caller is not None and not _names_variable(caller, frame):
            caller = None
        if caller is not None:
            place = _source_line(caller)
            (uses if use else effects).append(f"{use or effect} ({place})")

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


def _names_variable(caller: FrameType, read: FrameType) -> bool:
    """Return whether the file of a caller names the variable of the environment that is read:
    a compiled library that reads one in a call has no frame of its own.
    """
    text = "".join(linecache.getlines(caller.f_code.co_filename))
    return str(read.f_locals.get("key")) in text


def _print_of(function: Any) -> str:
    """Return what a C function writes to standard output or error, "" for none."""
    owner = getattr(function, "__self__", None)
    is_stream = owner is sys.stdout or owner is sys.stderr
    is_write = is_stream and function.__name__.startswith("write")
    return "prints" if function is print or is_write else ""


def _caller(frame: FrameType | None) -> FrameType | None:
    """Return the innermost frame outside the standard library, or None inside an exempt module."""
    while frame is not None:
        module = _module_of(frame)
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
    return _shortened(frame.f_code.co_filename, frame.f_lineno)


def _shortened(path: str, line: int) -> str:
    return f"{'/'.join(PurePath(path).parts[-2:])}, line {line}"


def _module_of(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__", ""))
