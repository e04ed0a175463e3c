"""Confusion matrices: by true target class, the probabilities of each reported type."""

import math
from collections.abc import Mapping

Confusion = Mapping[str, Mapping[str, float]]

#: How far the sum of a row may be from 1.
ROW_SUM_TOLERANCE = 1e-9


def confusion_complaint(matrix: object) -> str | None:
    """Return the error in a confusion matrix, or None.

    Rows are target classes and may be omitted; columns are reported types, 0 where omitted. A row
    holds probabilities and sums to 1 within 1e-9.
    """
    if not isinstance(matrix, Mapping):
        return f"{matrix!r} is not a mapping of true types to reported types"
    complaints = (_row_complaint(true_type, row) for true_type, row in matrix.items())
    return next((complaint for complaint in complaints if complaint), None)


def _row_complaint(true_type: str, row: object) -> str | None:
    if not isinstance(row, Mapping):
        return f"{true_type}: {row!r} is not a mapping of reported types to probabilities"
    for name, probability in row.items():
        if not is_probability(probability):
            return f"{true_type}: {name}: {probability!r} is not a probability in [0, 1]"
    total = math.fsum(row.values())
    return (
        None
        if abs(total - 1.0) <= ROW_SUM_TOLERANCE
        else f"{true_type}: the row sums to {total:.10g}, not to 1"
    )


def is_probability(value: object) -> bool:
    """Return whether a value is a number in [0, 1]."""
    return isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value <= 1.0
