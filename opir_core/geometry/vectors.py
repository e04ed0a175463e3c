"""Vectors as three columns, element by element: a result never depends on its neighbours.

`numpy.linalg.norm`, `@` and `einsum` sum in an order that depends on memory layout and batch size;
written-out components do not.
"""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray

#: Lengths below it, m, count as zero: their squares would underflow. Added to a divisor it makes
#: 0/0 zero and changes no other quotient.
NEVER_ZERO = 1e-150

#: 2**27 + 1: multiplying by it cuts a double into two halves whose products are exact (Veltkamp,
#: 1968).
_SPLITTER = 134217729.0


#: Two arrays of one shape.
FloatPair = tuple[FloatArray, FloatArray]


def floats(values: ArrayLike) -> FloatArray:
    """Return values as a float64 array, without a copy where they are one."""
    return np.asarray(values, dtype=np.float64)


def components(vectors: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, y and z of an (..., 3) array, each of shape (...), as views where the array is
    float64.
    """
    array = floats(vectors)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(
            f"expected vectors with a last axis of 3 (x, y, z), got shape {array.shape}"
        )
    return array[..., 0], array[..., 1], array[..., 2]


def vector(x: ArrayLike, y: ArrayLike, z: ArrayLike) -> FloatArray:
    """Return the (..., 3) array of three broadcast components."""
    out = np.empty((*np.broadcast_shapes(np.shape(x), np.shape(y), np.shape(z)), 3))
    out[..., 0] = x
    out[..., 1] = y
    out[..., 2] = z
    return out


def select(condition: BoolArray, yes: ArrayLike, no: ArrayLike) -> FloatArray:
    """Return `yes` where the condition holds, else `no`; a scalar of scalars, unlike
    `numpy.where`.
    """
    return np.where(condition, yes, no)[()]


def length(x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """Return the Euclidean length of vectors given by their components, to one unit in the last
    place.
    """
    return np.sqrt(x * x + y * y + z * z)


def dot(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Return the scalar products (...) of vectors (..., 3), which broadcast."""
    ax, ay, az = components(a)
    bx, by, bz = components(b)
    return ax * bx + ay * by + az * bz


def angle_between_rad(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Return the angles (...) between vectors (..., 3), rad, in [0, pi]; accurate to rounding near
    0 and pi too.
    """
    ax, ay, az = components(a)
    bx, by, bz = components(b)
    across = length(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    return np.arctan2(across, ax * bx + ay * by + az * bz)


def lengths_and_remainders(
    x: FloatArray, y: FloatArray, z: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the lengths of (x, y) and (x, y, z), each followed by its rounding error; their sum is
    exact to 1e-30.
    """
    xx, x_error = _exact_square(x)
    yy, y_error = _exact_square(y)
    zz, z_error = _exact_square(z)
    xy, xy_error = exact_sum(xx, yy)
    xyz, xyz_error = exact_sum(xy, zz)
    both_errors = x_error + y_error
    flat = _root_and_remainder(xy, xy_error, both_errors)
    return *flat, *_root_and_remainder(xyz, xyz_error + xy_error, both_errors + z_error)


def _root_and_remainder(
    squared: FloatArray, sum_error: FloatArray, square_errors: FloatArray
) -> FloatPair:
    """Return the root of a sum of squares, and its error from the errors of sum and squares."""
    root: FloatArray = np.sqrt(squared)
    square, square_error = _exact_square(root)
    residual = (squared - square) + (sum_error + (square_errors - square_error))
    return root, residual / (2.0 * root + NEVER_ZERO)


def _exact_square(x: FloatArray) -> FloatPair:
    """Return the rounded square and its rounding error, exactly (Dekker, Numer. Math. 18, 1971,
    224-242).
    """
    high = _SPLITTER * x
    high = high - (high - x)
    low = x - high
    square = x * x
    return square, ((high * high - square) + 2.0 * high * low) + low * low


def exact_sum(x: FloatArray, y: FloatArray) -> FloatPair:
    """Return the rounded sum and its rounding error, exactly (Knuth, The Art of Computer
    Programming 2, 4.2.2).
    """
    total = x + y
    addend = total - x
    return total, (x - (total - addend)) + (y - addend)
