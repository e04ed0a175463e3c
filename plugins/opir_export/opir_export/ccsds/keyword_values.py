"""The keyword form (KVN) of CCSDS messages: lines `KEYWORD = value`, times in UTC to 1 µs."""

from collections.abc import Mapping, Sequence

import numpy as np

from opir_core.arrays import IntArray

_ORIGINATOR = "OPIR"


def header(kind: str, version: str, epoch_us: int, comments: Sequence[str]) -> list[str]:
    """Return the lines of a message's header.

    CREATION_DATE is the scene's epoch, so that the same run gives the same bytes.
    """
    return [
        f"CCSDS_{kind}_VERS = {version}",
        *(f"COMMENT {text}" for text in comments),
        f"CREATION_DATE = {time_texts(np.array([0]), epoch_us)[0]}",
        f"ORIGINATOR = {_ORIGINATOR}",
        "",
    ]


def block(name: str, values: Mapping[str, object]) -> list[str]:
    """Return the lines of a block between NAME_START and NAME_STOP."""
    lines = (f"{key} = {value}" for key, value in values.items())
    return [f"{name}_START", *lines, f"{name}_STOP"]


def time_texts(since_us: IntArray, epoch_us: int) -> list[str]:
    """Return times (n,), µs from the epoch, as calendar times in UTC."""
    texts: list[str] = np.datetime_as_string(
        (since_us + epoch_us).astype("datetime64[us]")
    ).tolist()
    return texts
