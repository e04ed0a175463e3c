"""Two-body arcs to 50 digits, and what rounding their inputs does by itself. Callers set mpmath's
digits.
"""

import mpmath
import numpy as np
from kepler_arcs import States

from opir_core.constants import EARTH_MU_M3_S2 as MU


def universal_functions(beta: mpmath.mpf, s: mpmath.mpf) -> tuple[mpmath.mpf, ...]:
    """Return the universal functions G0 to G3 of the universal anomaly s; beta is twice the binding
    energy.
    """
    z = beta * s * s
    if abs(z) < 1e-12:
        return (
            1 - z / 2,
            s * (1 - z / 6),
            s * s * (0.5 - z / 24 + z * z / 720),
            s**3 * (1 - z / 20 + z * z / 840) / 6,
        )
    k = mpmath.sqrt(abs(beta))
    c, d = (
        (mpmath.cos(k * s), mpmath.sin(k * s))
        if beta > 0
        else (mpmath.cosh(k * s), mpmath.sinh(k * s))
    )
    return c, d / k, (1 - c) / beta, (s - d / k) / beta


def exact_position(state: list[mpmath.mpf]) -> list[mpmath.mpf]:
    """Return the end position of (x, y, z, vx, vy, vz, duration, mu) to 50 digits, by universal
    variables.
    """
    position = state[:3]
    velocity = state[3:6]
    duration = state[6]
    mu = state[7]
    r = mpmath.sqrt(mpmath.fdot(position, position))
    eta = mpmath.fdot(position, velocity)
    beta = 2 * mu / r - mpmath.fdot(velocity, velocity)
    if beta > 0:
        period = 2 * mpmath.pi * mu / beta ** (mpmath.mpf(3) / 2)
        duration -= period * mpmath.nint(duration / period)

    def late(s: mpmath.mpf) -> tuple[mpmath.mpf, mpmath.mpf]:
        g = universal_functions(beta, s)
        return r * g[1] + eta * g[2] + mu * g[3] - duration, r * g[0] + eta * g[1] + mu * g[2]

    sense = 1 if duration >= 0 else -1
    low = mpmath.mpf(0)
    high = sense * mpmath.cbrt(abs(duration) / mu)
    while sense * late(high)[0] < 0:
        low = high
        high = 2 * high
    s = (low + high) / 2
    before = mpmath.inf
    for _ in range(2000):
        excess, slope = late(s)
        low, high = (s, high) if sense * excess < 0 else (low, s)
        good = (
            slope > 0
            and min(low, high) < s - excess / slope < max(low, high)
            and abs(excess) < before / 2
        )
        moved = s - excess / slope if good else (low + high) / 2
        before = abs(excess) if good else mpmath.inf
        if abs(moved - s) <= abs(s) * mpmath.mpf(10) ** -50:
            break
        s = moved
    g = universal_functions(beta, moved)
    f = 1 - mu * g[2] / r
    lag = r * g[1] + eta * g[2]
    return [f * p + lag * v for p, v in zip(position, velocity, strict=True)]


def references(states: States) -> tuple[list[list[mpmath.mpf]], np.ndarray]:
    """Return the exact end positions, and the errors, m, that rounding the inputs alone makes."""
    ends = []
    floors = []
    nudge = mpmath.mpf(10) ** -20
    for position, velocity, duration in zip(*states, strict=True):
        state = [mpmath.mpf(float(value)) for value in (*position, *velocity, duration, MU)]
        end = exact_position(state)
        floor = 0.0
        for index, value in enumerate(state):
            nudged = [*state[:index], value * (1 + nudge), *state[index + 1 :]]
            floor += float(distance(exact_position(nudged), end) / nudge) * 1.1e-16
        ends.append(end)
        floors.append(floor)
    return ends, np.array(floors)


def distance(one: list[mpmath.mpf], other: list[mpmath.mpf]) -> mpmath.mpf:
    return mpmath.sqrt(mpmath.fsum((a - b) ** 2 for a, b in zip(one, other, strict=True)))
