"""Slow tests in thirds: `OPIR_THIRD=1/3` runs the first third of them, so that three runs of CI run
each of them.
"""

import zlib
from collections.abc import Callable

import pytest


def chooser(third: str) -> Callable[[str], bool]:
    """Return whether a test, by its id, is in a part as "1/3"; all are in the part "" or "all"."""
    if third in {"", "all"}:
        return lambda _node_id: True
    part, _, parts = third.partition("/")
    if not (part.isdecimal() and parts.isdecimal() and 1 <= int(part) <= int(parts)):
        raise pytest.UsageError(f"OPIR_THIRD must be all, 1/3, 2/3 or 3/3, got {third!r}")
    # Not `hash`: it differs from process to process.
    return lambda node_id: zlib.crc32(node_id.encode()) % int(parts) == int(part) - 1
