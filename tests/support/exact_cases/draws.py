"""Inputs drawn for the cases: usual ones, and among them those at the ends of what a number can
be.
"""

import numpy as np

#: Of how many draws one is of the special values.
_SPECIAL = 8


def uniform(rng, n, low, high, special=()):
    """Return numbers (n,) between two bounds, some of them special."""
    return with_special(rng, rng.uniform(low, high, n), special)


def log_uniform(rng, n, low, high, special=()):
    """Return positive numbers (n,) evenly distributed in logarithm, some of them special."""
    return with_special(rng, np.exp(rng.uniform(np.log(low), np.log(high), n)), special)


def with_special(rng, values, special):
    """Return the values with an eighth of them replaced by special ones."""
    if len(special):
        rows = np.flatnonzero(rng.random(len(values)) < 1.0 / _SPECIAL)
        values[rows] = rng.choice(np.asarray(special, dtype=np.float64), len(rows))
    return values


def probabilities(rng, n):
    """Return probabilities (n,), as near to 0 and 1 as doubles are."""
    small = np.exp(rng.uniform(np.log(1e-300), 0.0, n))
    mid = rng.uniform(0.0, 1.0, n)
    kind = rng.integers(0, 4, n)
    return np.select(
        [kind == 0, kind == 1, kind == 2],
        [small, mid, 1.0 - np.exp(rng.uniform(-36.0, 0.0, n))],
        mid,
    )


def angles(rng, n):
    """Return angles (n,), rad: of any turn, and at or beside the quarters."""
    base = rng.uniform(-np.pi, np.pi, n)
    beside = rng.integers(-4, 5, n) * (0.5 * np.pi) + rng.choice(
        [0.0, 1e-16, -1e-12, 1e-8, 5e-324], n
    )
    return np.where(rng.random(n) < 0.15, beside, base)


def latitudes(rng, n):
    """Return geodetic latitudes (n,), rad, poles and equator among them."""
    return uniform(
        rng,
        n,
        -0.5 * np.pi,
        0.5 * np.pi,
        (0.0, 0.5 * np.pi, -0.5 * np.pi, 1.5707963267948963, 1e-12, 5e-324),
    )


def directions(rng, n):
    """Return unit vectors (n, 3), some along the axes or almost."""
    vectors = rng.normal(size=(n, 3))
    is_close = rng.random(n) < 0.15
    vectors[is_close] *= rng.choice([0.0, 1e-16, 1e-9, 1.0], (int(is_close.sum()), 3))
    size = np.sqrt((vectors**2).sum(axis=1, keepdims=True))
    return np.where(size > 0.0, vectors / np.where(size > 0.0, size, 1.0), [0.0, 0.0, 1.0])


def positions(rng, n, low=6.3e6, high=5e7):
    """Return ECEF positions (n, 3), m, from the ground to beyond geostationary orbit."""
    return directions(rng, n) * log_uniform(rng, n, low, high)[:, None]


def times(rng, n):
    """Return scene times (n,), s: minutes, days, and thirty years."""
    size = log_uniform(rng, n, 1e-9, 1e9, (0.0, 5e-324, 86164.0, 3.2e7, 9.5e8))
    return size * rng.choice([-1.0, 1.0], n)


def epochs(rng, n):
    """Return epochs (n,) from 1970 to 2100, to the microsecond."""
    return rng.integers(0, 4_102_444_800_000_000, n).astype("datetime64[us]")
