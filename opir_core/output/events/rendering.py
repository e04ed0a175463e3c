"""Lines of text from typed columns: encoders and the truth file say which columns a line has, a
renderer joins them.

A column is text common to all lines (`bytes`), `Looked`, `Decimal`, `Ids` or `Times`. `reference`
is the renderer in numpy and msgspec; plugins offer faster ones, which make the same bytes.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import ByteArray, FloatArray, IntArray, WordArray
from opir_core.errors import PluginError, SinkError
from opir_core.host.components import RendererModel
from opir_core.host.host import Host
from opir_core.interfaces.contexts import Renderer, RendererContext
from opir_core.interfaces.records import Detections
from opir_core.output.events.text import (
    number_texts,
    refuse_unwritable,
    rounded,
    timestamp_characters,
    unix_microseconds,
)
from opir_core.random_streams.detection_ids import uuid_characters

#: The environment variable that chooses a renderer.
CHOICE = "OPIR_RENDERER"

#: The renderers used without a choice, the fastest first; where none of them works, the reference.
PREFERRED = ("compiled",)


class Looked:
    """One of some texts per line, by `row` (n,); without it the texts (n,) are those of the
    lines.
    """

    __slots__ = ("row", "texts")

    def __init__(self, texts: Sequence[bytes], row: NDArray[Any] | None = None) -> None:
        self.texts = texts
        self.row = row

    def plain(self) -> tuple[Any, ...]:
        """Return the kind and the values, for a compiled renderer."""
        row = None if self.row is None else np.ascontiguousarray(self.row, dtype=np.int64)
        return "looked", list(self.texts), row

    def pieces(self) -> list[bytes]:
        """Return the texts (n,) of the lines."""
        if self.row is None:
            return list(self.texts)
        return np.array(self.texts, dtype=object).take(self.row).tolist()


class Decimal:
    """Numbers (n,), rounded to decimals, in the shortest text that reads back as this double; nan
    and inf are null.
    """

    __slots__ = ("decimals", "values")

    def __init__(self, values: FloatArray, decimals: int) -> None:
        self.values = values
        self.decimals = decimals

    def plain(self) -> tuple[Any, ...]:
        """Return the kind and the values, for a compiled renderer."""
        return "decimal", np.ascontiguousarray(self.values, dtype=np.float64), self.decimals

    def pieces(self) -> list[bytes]:
        """Return the texts (n,) of the lines."""
        return number_texts(rounded(self.values, self.decimals))


class Ids:
    """Ids (n, 2), the most significant half first, as UUIDs without quotes."""

    __slots__ = ("words",)

    def __init__(self, words: WordArray) -> None:
        self.words = words

    def plain(self) -> tuple[Any, ...]:
        """Return the kind and the values, for a compiled renderer."""
        return "ids", np.ascontiguousarray(self.words, dtype=np.uint64)

    def characters(self) -> ByteArray:
        """Return the ASCII codes (n, 36)."""
        return uuid_characters(self.words)


class Times:
    """Times (n,), µs since 1970-01-01, as `2026-04-01T12:00:00.050000Z`; `SinkError` outside the
    years 1 to 9999.
    """

    __slots__ = ("unix_us",)

    def __init__(self, unix_us: IntArray) -> None:
        refuse_unwritable(unix_us)
        self.unix_us = unix_us

    def plain(self) -> tuple[Any, ...]:
        """Return the kind and the values, for a compiled renderer."""
        return "times", np.ascontiguousarray(self.unix_us, dtype=np.int64)

    def characters(self) -> ByteArray:
        """Return the ASCII codes (n, 27)."""
        return timestamp_characters(self.unix_us)

    def pieces(self) -> list[bytes]:
        """Return the texts (n,) of the lines."""
        return _fixed_width(len(self.unix_us), [self.characters()])


def event_times(detections: Detections, epoch_us: int) -> tuple[Times, Times]:
    """Return the times of looks and of their reports, the same object if no report is late.

    `epoch_us` is the epoch, in µs since 1970-01-01 without leap seconds.
    """
    look = Times(unix_microseconds(detections.time_ns, epoch_us))
    if not detections.is_delayed:
        return look, look
    return look, Times(unix_microseconds(detections.reported_ns, epoch_us))


Column = bytes | Looked | Decimal | Ids | Times


def reference(count: int, columns: Sequence[Column]) -> bytes:
    """Return `count` lines, each joined from its columns."""
    pieces = [piece for group in _groups(count, columns) for piece in group]
    line: list[bytes] = [b""] * (count * len(pieces))
    for place, piece in enumerate(pieces):
        line[place :: len(pieces)] = [piece] * count if isinstance(piece, bytes) else piece
    return b"".join(line)


def _groups(count: int, columns: Sequence[Column]) -> Iterator[list[bytes | list[bytes]]]:
    """Yield the pieces of the lines: one for all lines or one per line, as few as the columns
    allow.
    """
    fixed: dict[int, ByteArray] = {}
    for is_fixed, group in groupby(
        columns, key=lambda column: isinstance(column, bytes | Ids | Times)
    ):
        members = list(group)
        if not is_fixed:
            yield [column.pieces() for column in members if isinstance(column, Looked | Decimal)]
        elif all(isinstance(column, bytes) for column in members):
            yield [b"".join(column for column in members if isinstance(column, bytes))]
        else:
            yield [_fixed_width(count, [_characters(column, fixed) for column in members])]


def _characters(column: Column, converted: dict[int, ByteArray]) -> ByteArray:
    """Return ASCII codes (width,) or (n, width); a column that stands twice in a line is converted
    once.
    """
    if isinstance(column, bytes):
        return np.frombuffer(column, dtype=np.uint8)
    if id(column) not in converted and isinstance(column, Ids | Times):
        converted[id(column)] = column.characters()
    return converted[id(column)]


def _fixed_width(count: int, columns: Sequence[ByteArray]) -> list[bytes]:
    """Return texts of one width, joined from texts common to all (width,) and columns of characters
    (n, width).
    """
    ends = np.cumsum([column.shape[-1] for column in columns]).tolist()
    text = np.empty((count, ends[-1]), dtype=np.uint8)
    for column, end in zip(columns, ends, strict=True):
        text[:, end - column.shape[-1] : end] = column
    return text.view(f"S{ends[-1]}").ravel().tolist()


def chosen_renderer(host: Host) -> tuple[str, Renderer]:
    """Return the name and the renderer that `OPIR_RENDERER` chooses; else the first of `PREFERRED`
    that works.

    Raises `PluginError` if `OPIR_RENDERER` names a renderer that is not installed, `SinkError` if
    it does not work.
    """
    choice = os.environ.get(CHOICE, "")
    if choice:
        component = host.component(RendererModel, choice, CHOICE)
        try:
            return choice, _built(component)
        except ImportError as error:
            raise SinkError(
                f"{CHOICE}={choice}: {error}; leave it unset for one that works"
            ) from error
    installed = host.names(RendererModel)
    for name in (preferred for preferred in PREFERRED if preferred in installed):
        with suppress(PluginError, ImportError):
            return name, _built(host.component(RendererModel, name))
    return "reference", reference


def _built(component: RendererModel) -> Renderer:
    return component.build(component.config(), RendererContext(reference=reference))
