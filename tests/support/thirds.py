"""Tests in thirds: `OPIR_THIRD=1/3` runs the first third of the slow ones, `OPIR_QUICK_THIRD=1/3`
that of the others.

So three runs of CI run each of them.
"""

import zlib

import pytest

#: The variables of the slow tests and of the quick ones.
SLOW = "OPIR_THIRD"
QUICK = "OPIR_QUICK_THIRD"


def chooser(third, name=SLOW):
    """Return whether a test, by its id, is in a part as "1/3"; all are in the part "" or "all".

    `name` is the variable that the part comes from.
    """
    if third in {"", "all"}:
        return lambda _node_id: True
    number, _, count = third.partition("/")
    if not (number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise pytest.UsageError(f"{name} must be all, 1/3, 2/3 or 3/3, got {third!r}")
    # Not `hash`: it differs from process to process.
    return lambda node_id: zlib.crc32(node_id.encode()) % int(count) == int(number) - 1
