"""The boundary between the core and plugins: whatever a component raises or returns wrongly is one
`ModelError`.

The message names the component with its owner and version, the method, the line, and the command
that tests it.
"""

import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from types import FrameType, TracebackType
from typing import Any

from attrs import frozen

from opir_core.errors import ModelError, OpirError
from opir_core.host.error_messages import described_error, is_of_plugin, place_of_frame
from opir_core.host.host import Host
from opir_core.scene.scene import Choice, Scene


class InvalidOutput(ModelError):  # noqa: N818 - `PluginErrors` adds the owner
    """What a component returned is invalid; `key` is that of the component in the scene,
    `detection` for instance.
    """

    def __init__(self, key: str, method: str, words: str) -> None:
        self.key = key
        self.method = method
        self.words = words
        super().__init__(f"{key}: {method} {words}")


def owner_text(host: Host, choice: Choice) -> str:
    """Return the beginning of a message: a component with its path in the scene and its owner."""
    kind = host.component(choice.hook, choice.name).kind
    owner = host.provenance(choice.hook, choice.name)
    return f"{choice.path}: the {kind} {choice.name!r} of {owner}"


def check_hint(name: str) -> str:
    """Return the end of a message about a broken component: the command that tests it."""
    return f"`opir check {name}` shows what is required"


def is_interruption(error: BaseException) -> bool:
    """Return whether an exception is the user's Ctrl-C, which only the main thread gets."""
    return (
        isinstance(error, KeyboardInterrupt)
        and threading.current_thread() is threading.main_thread()
    )


#: The calls of components that have not returned, by thread, the innermost last: a function that
#: returns the name, and when the call began or the last call in it returned, in seconds of the
#: monotonic clock.
_CALLS: dict[int, list[tuple[Callable[[], str], float]]] = {}


def _begin(name: Callable[[], str]) -> None:
    _CALLS.setdefault(threading.get_ident(), []).append((name, time.monotonic()))


def _end() -> None:
    _CALLS[threading.get_ident()].pop()
    still_at_work()


def still_at_work() -> None:
    """Restart the time of the innermost call of a component in this thread."""
    calls = _CALLS.get(threading.get_ident())
    if calls:
        calls[-1] = calls[-1][0], time.monotonic()
    else:
        _CALLS.pop(threading.get_ident(), None)


def overdue_call(thread: int | None, after_s: float) -> str:
    """Return the call of a component that a thread has been in for longer than `after_s`, with its
    line; "" if none.
    """
    latest = _CALLS.get(thread or 0, [])[
        -1:
    ]  # a copy: the thread goes on, and its list may be empty at the next step
    duration_s = time.monotonic() - latest[0][1] if latest else 0.0
    if duration_s <= after_s:
        return ""
    place = place_of_thread(thread)
    return (
        f"{latest[0][0]()} has not returned for {duration_s:.1f}"
        f" s{f': in {place}' if place else ''}"
    )


def place_of_thread(thread: int | None) -> str:
    """Return the line that a thread executes, preferably the plugin's; "" if the thread has
    ended.
    """
    frame = sys._current_frames().get(thread) if thread is not None else None
    return "" if frame is None else place_of_frame(frame)


@frozen(eq=False, repr=False)
class PluginErrors:
    """A context in which components of a scene are called: their errors leave it as `ModelError`,
    with the owner.

    opir's own errors and Ctrl-C pass; so does what no plugin has raised, which is an internal
    error.
    """

    host: Host
    scene: Scene

    def __enter__(self) -> None:
        """Begin the calls."""
        _begin(lambda: f"a component of the scene {self.scene.name}")

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        """Raise the `ModelError` for what has been raised."""
        _end()
        if isinstance(error, InvalidOutput):
            choice: Choice = getattr(self.scene, error.key)
            raise ModelError(
                f"{self._owner(choice)}: {error.method} {error.words}; {check_hint(choice.name)}"
            ) from error
        if error is None or isinstance(error, OpirError) or is_interruption(error):
            return
        text = self._blamed(error)
        if text:
            raise ModelError(text) from error

    def _owner(self, choice: Choice) -> str:
        """Return the owner of a component; its path if the program put a part of its own into the
        plan.
        """
        try:
            return owner_text(self.host, choice)
        except (OpirError, ValueError):
            return choice.path

    def _blamed(self, error: BaseException) -> str:
        """Return the message about an exception with the component in whose code it was raised; ""
        for the core's.
        """
        choice_of_package = dict(self._roots())
        for frame in _frames(error):
            choice = (
                choice_of_package.get(_root(frame.f_globals.get("__name__", "")))
                if is_of_plugin(frame)
                else None
            )
            if choice is not None:
                method = frame.f_code.co_name
                return (
                    f"{self._owner(choice)}: {method} raised {described_error(error)};"
                    f" {check_hint(choice.name)}"
                )
        return ""

    def _roots(self) -> Iterator[tuple[str, Choice]]:
        """Yield the packages of the scene's components; of several in a package the first of the
        scene comes last.
        """
        for choice in reversed(self.scene.choices):
            try:
                component: Any = self.host.component(choice.hook, choice.name)
            except (OpirError, ValueError):
                continue
            build = getattr(component.build, "func", component.build)
            yield _root(getattr(build, "__module__", "") or ""), choice


def error_of_part(host: Host, choice: Choice, error: BaseException) -> ModelError | None:
    """Return the error of the part of a component in whose code an exception was raised, None if it
    was not in the code of any.
    """
    own_package = _package_of(host, choice)
    packages = {_package_of(host, part): part for part in choice.parts.values()}
    for frame in _frames(error):
        package = _root(frame.f_globals.get("__name__", ""))
        if package in packages and package != own_package and is_of_plugin(frame):
            part = packages[package]
            words = f"{frame.f_code.co_name} raised {described_error(error)}"
            return ModelError(f"{owner_text(host, part)}: {words}; {check_hint(part.name)}")
    return None


def _package_of(host: Host, choice: Choice) -> str:
    """Return the package of the function that builds a component."""
    build = host.component(choice.hook, choice.name).build
    return _root(getattr(getattr(build, "func", build), "__module__", "") or "")


def blamed_call(owner: Callable[[], str], hint: str, method: str, call: Callable[[], Any]) -> Any:
    """Call a component; re-raise its exceptions as `ModelError` (opir's own errors and
    KeyboardInterrupt pass).
    """
    _begin(lambda: f"{owner()}: {method}")
    try:
        return call()
    except OpirError:
        raise
    except BaseException as error:
        if is_interruption(error):
            raise
        raise ModelError(f"{owner()}: {method} raised {described_error(error)}; {hint}") from error
    finally:
        _end()


def _root(module: str) -> str:
    return module.partition(".")[0]


def _frames(error: BaseException) -> Iterable[FrameType]:
    trace = error.__traceback__
    while trace is not None:
        yield trace.tb_frame
        trace = trace.tb_next
