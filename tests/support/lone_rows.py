"""Results of rows do not depend on the rows beside them."""

from collections.abc import Callable, Iterable
from typing import Any

ROWS = (slice(0, 1), slice(3, 5), slice(7, None, 3))


def assert_rows_independent(
    function: Callable[..., Iterable[Any]], *columns: Any, rows: Iterable[Any] = ROWS
) -> None:
    """Some rows of columns (n, ...) have the results of all rows, to the last bit."""
    results = function(*columns)
    for some_rows in rows:
        some_results = function(*(column[some_rows] for column in columns))
        for some_result, result in zip(some_results, results, strict=True):
            expected = result[some_rows]
            assert (some_result.shape, some_result.dtype) == (expected.shape, expected.dtype)
            assert some_result.tobytes() == expected.tobytes()
