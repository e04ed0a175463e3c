"""Formulas of a state's components, evaluated with plain numbers for few states and over columns
for many.

A formula takes the components of its states, each a number or a column (n,), and the functions of
numbers or of columns. Both give the same bits but for `exp`; numpy's overhead per call would exceed
the arithmetic of a single state.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.flight import Gravity

#: Components of a vector: numbers of one state, or columns (n,) of many.
Vector = Sequence[Any]


def plus(vector: Vector, factor: Any, other: Vector) -> tuple[Any, Any, Any]:
    """Return a vector plus a factor times another one."""
    return (
        vector[0] + factor * other[0],
        vector[1] + factor * other[1],
        vector[2] + factor * other[2],
    )


def scaled(factor: Any, vector: Vector) -> tuple[Any, Any, Any]:
    """Return a factor times a vector."""
    return factor * vector[0], factor * vector[1], factor * vector[2]


def inner(vector: Vector, other: Vector) -> Any:
    """Return the inner product of two vectors, summed in order."""
    return vector[0] * other[0] + vector[1] * other[1] + vector[2] * other[2]


class Functions(NamedTuple):
    """Functions of plain numbers, or of columns.

    `gravity` is the gravitational acceleration, m/s², at x, y and z, m: its first three values.
    """

    sqrt: Callable[[Any], Any]
    exp: Callable[[Any], Any]
    least: Callable[[Any, Any], Any]
    greatest: Callable[[Any, Any], Any]
    where: Callable[[Any, Any, Any], Any]
    gravity: Any = None


class Arithmetic(NamedTuple):
    """The functions of numbers, for up to `few` rows, and those of columns."""

    few: int
    numbers: Functions
    columns: Functions

    def values(self, formula: Callable[..., Sequence[Any]], *arrays: Any) -> FloatArray:
        """Return the values (n, k) of a formula for the rows of arrays, (n,) or (n, components)."""
        count = arrays[0].shape[0]
        if count == 1:
            return np.array([formula(*[array.tolist()[0] for array in arrays], self.numbers)])
        if 0 < count <= self.few:
            rows = zip(*[array.tolist() for array in arrays], strict=True)
            return np.array([formula(*row, self.numbers) for row in rows])
        columns = [np.ascontiguousarray(array.T) for array in arrays]
        return np.stack(formula(*columns, self.columns), axis=1)


def arithmetic(few: int, gravity: Gravity | None = None) -> Arithmetic:
    """Return the arithmetic of formulas, with plain numbers for up to `few` rows."""
    numbers = Functions(math.sqrt, math.exp, min, max, _chosen)
    columns = Functions(np.sqrt, np.exp, np.minimum, np.maximum, np.where)
    if gravity is not None:
        numbers = numbers._replace(gravity=gravity.alone_with_inverse_radius)
        columns = columns._replace(gravity=partial(_gravity_at, gravity))
    return Arithmetic(few, numbers, columns)


def _gravity_at(gravity: Gravity, *position: FloatArray) -> FloatArray:
    return gravity(np.stack(position))


def _chosen(condition: bool, value: float, other: float) -> float:
    return value if condition else other
