"""Nodes: the values of a scene as written, with their places.

A YAML file, a mapping and an override all become nodes, so one set of rules reads them all and
every error message has a place.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import Enum
from typing import Any

from attrs import Factory, define, evolve, frozen

#: The largest scene file, bytes.
MAXIMUM_FILE_BYTES = 16 * 2**20

#: The deepest nesting of blocks and lists.
MAXIMUM_DEPTH = 20

#: The most values (texts, numbers, blocks, lists) in a scene.
MAXIMUM_VALUES = 1_000_000

#: The most digits of a whole number.
MAXIMUM_DIGITS = 30

#: The most sensors, constellations spelled out, and the most targets.
MAXIMUM_SENSORS = 10_000
MAXIMUM_TARGETS = 50_000

#: The most blocks of sources; one block may stand for many emitters.
MAXIMUM_SOURCES = 1_000

#: The longest scene, s: a year and what a study adds to it. Time in which nothing is in view costs
#: next to nothing.
MAXIMUM_DURATION_S = 400 * 86_400.0

#: The longest name of a scene and the longest id of a sensor or a target, characters.
MAXIMUM_NAME_LENGTH = 200
MAXIMUM_ID_LENGTH = 64

#: The most problems that one message lists; the rest are counted.
MAXIMUM_PROBLEMS = 200

#: Line and column, both from 1, in a file; or the override that a node came from; or None.
Place = tuple[int, int] | str | None

_PLAIN_KEY = re.compile(r"[A-Za-z0-9_-]{1,64}")
_NOT_TEXT = re.compile("[\x00-\x08\x0b-\x1f\x7f\ud800-\udfff]")
_LONGEST_SHOWN = 60


class Unreadable(Enum):
    """The value of a node that could not be read; its complaints give the reason."""

    UNREADABLE = "unreadable"


UNREADABLE = Unreadable.UNREADABLE


class SwitchWord(str):
    """`on`, `off`, `yes` or `no` without quotes: a truth value where one is expected, and nothing
    elsewhere.
    """

    __slots__ = ()


@frozen
class Complaint:
    """One error: message, place in the text, and steps (`.launch`, `[0]`) from the node."""

    message: str
    place: Place = None
    steps: tuple[str, ...] = ()

    def under(self, *steps: str) -> "Complaint":
        """Return the complaint relative to a node further up."""
        return evolve(self, steps=(*steps, *self.steps))

    @property
    def path(self) -> str:
        """Return the scene path, `targets[0].launch.lat_deg`."""
        return "".join(self.steps).removeprefix(".")

    @property
    def text(self) -> str:
        """Return the message with the place, if known."""
        if self.place is None:
            return self.message
        return f"{self.message} ({place_text(self.place)})"


class InvalidNode(Exception):  # noqa: N818 - never seen outside the reading package
    """The errors of a node and the nodes in it; empty if the node has its own complaints."""

    def __init__(self, complaints: Iterable[Complaint] = ()) -> None:
        super().__init__()
        self.complaints = tuple(complaints)


@define(eq=False)
class Node:
    """A value as written.

    `value` is text, a number, a truth value, None, a list of nodes, a dict of nodes by key, a
    `SwitchWord` or `UNREADABLE`. `written` is the text of an unquoted scalar. `key_place` is where
    the key of this value stands.
    """

    value: Any
    place: Place = None
    key_place: Place = None
    written: str | None = None
    complaints: Sequence[Complaint] = ()

    def refused(self, message: str, *, at_key: bool = False) -> InvalidNode:
        """Return the error of this node, placed at its value or at its key (`at_key`)."""
        return InvalidNode([Complaint(message, self.key_place if at_key else self.place)])


@define
class ErrorCollector:
    """Collects the errors of several parts, so that all are reported at once."""

    complaints: list[Complaint] = Factory(list)
    is_whole: bool = True

    def at(self, *steps: str) -> "_Gather":
        """Collect the errors raised in the `with` block, under `steps`, and continue after it."""
        return _Gather(self, steps)

    def require_whole(self) -> None:
        """Raise all collected errors, if any."""
        if not self.is_whole:
            raise InvalidNode(self.complaints)


def read_each(items: Iterable["Node"], read: Callable[[int, "Node"], Any]) -> list[Any]:
    """Return the values of `read(index, item)`; raises the errors of all items together."""
    collector = ErrorCollector()
    values = []
    for index, item in enumerate(items):
        with collector.at(index_step(index)):
            values.append(read(index, item))
    collector.require_whole()
    return values


class _Gather:
    """The `with` block of `ErrorCollector.at`; a class for speed, because a scene enters one for
    every value.
    """

    __slots__ = ("_collector", "_steps")

    def __init__(self, collector: ErrorCollector, steps: tuple[str, ...]) -> None:
        self._collector = collector
        self._steps = steps

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: object, trace: object) -> bool:
        if not isinstance(error, InvalidNode):
            return False
        self._collector.is_whole = False
        self._collector.complaints += [
            complaint.under(*self._steps) for complaint in error.complaints
        ]
        return True


@contextmanager
def under(*steps: str) -> Iterator[None]:
    """Put the errors raised in the `with` block under `steps`."""
    try:
        yield
    except InvalidNode as refused:
        raise InvalidNode(complaint.under(*steps) for complaint in refused.complaints) from refused


def place_text(place: tuple[int, int] | str) -> str:
    """Return a place as text."""
    return place if isinstance(place, str) else f"line {place[0]}, column {place[1]}"


def key_step(key: str) -> str:
    """Return the step of a scene path into a block."""
    return f".{key}" if _PLAIN_KEY.fullmatch(key) else f".{shown_text(key)}"


def index_step(index: int) -> str:
    """Return the step of a scene path into a list."""
    return f"[{index}]"


def shown_text(text: str) -> str:
    """Return text in quotes, truncated, with unprintable characters escaped."""
    return repr(str(text)) if len(text) <= _LONGEST_SHOWN else f"{str(text)[:_LONGEST_SHOWN]!r}..."


def unprintable_complaint(text: str) -> str | None:
    """Return the error in the characters of a text, or None."""
    character = _NOT_TEXT.search(text)
    return (
        f"{shown_text(text)} contains U+{ord(character[0]):04X}, which is not text"
        if character
        else None
    )


def complaints_inside(node: Node) -> Iterator[Complaint]:
    """Yield the complaints of a node and the nodes in it."""
    yield from node.complaints
    for step, child in _children(node.value):
        for complaint in complaints_inside(child):
            yield complaint.under(step)


def ordered(complaints: Iterable[Complaint]) -> list[Complaint]:
    """Return complaints without duplicates: those with a line by line and column, then the others
    in order.
    """
    return sorted(
        dict.fromkeys(complaints),
        key=lambda complaint: (0, complaint.place) if isinstance(complaint.place, tuple) else (1,),
    )


def cut_short(complaints: list[Complaint]) -> list[Complaint]:
    """Return the first complaints, and one with the number of those omitted."""
    left_out = len(complaints) - MAXIMUM_PROBLEMS
    if left_out <= 0:
        return complaints
    return [
        *complaints[:MAXIMUM_PROBLEMS],
        Complaint(f"and {left_out} more problem{'s' if left_out > 1 else ''}"),
    ]


def _children(value: Any) -> Iterator[tuple[str, Node]]:
    if isinstance(value, Mapping):
        yield from ((key_step(key), child) for key, child in value.items())
    elif isinstance(value, list):
        yield from ((index_step(index), child) for index, child in enumerate(value))
