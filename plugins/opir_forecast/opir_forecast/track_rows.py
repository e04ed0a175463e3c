"""Records that are kept from tick to tick by the numbers of tracks."""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from opir_core.arrays import IntArray

_Record = TypeVar("_Record", bound=Any)


def rows_of_tracks(
    record: _Record, number: IntArray, begun: Callable[[IntArray], _Record]
) -> _Record:
    """Return the rows of a record for track numbers (n,), in this order; of unknown ones those that
    are `begun` for their numbers.

    The column `number` of the record ascends.
    """
    if record.number.tobytes() == number.tobytes():
        return record
    row = np.searchsorted(record.number, number)
    is_known = np.append(record.number, -1)[row] == number
    rows = type(record).concatenate([record.take(row[is_known]), begun(number[~is_known])])
    return rows.take(np.argsort(np.argsort(~is_known, kind="stable")))
