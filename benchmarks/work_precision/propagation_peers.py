"""The same arcs, with the same forces, for SciPy and heyoka (see `propagation.py`)."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from opir_core.constants import (
    EARTH_ECCENTRICITY_SQUARED,
    EARTH_EQUATORIAL_RADIUS_M,
    EARTH_ROTATION_RAD_S,
)
from opir_core.flight import Forces
from opir_core.flight.forces import ZonalField

FIELD = ZonalField()
SEA_LEVEL_KG_M3 = 1.225
SCALE_HEIGHT_M = 7200.0
SCALE = np.array([7e6, 7e6, 7e6, 7e3, 7e3, 7e3])

#: Steps after which a run that has gone astray is cut off.
MOST_STEPS = 5000


class Problem(NamedTuple):
    """Arcs, their forces, and where they end."""

    name: str
    forces: Forces
    beta: np.ndarray | None
    position: np.ndarray
    velocity: np.ndarray
    duration: np.ndarray


def scalar_rates(beta: float | None) -> Callable[[float, Sequence[float]], list[float]]:
    """Return the right side in plain Python, the fastest there is for one arc at a time without
    compiling.
    """
    mu = FIELD.mu_m3_s2
    oblateness = 1.5 * FIELD.j2 * FIELD.radius_m**2
    e2 = EARTH_ECCENTRICITY_SQUARED
    a = EARTH_EQUATORIAL_RADIUS_M
    omega = EARTH_ROTATION_RAD_S
    sqrt = math.sqrt

    def rates(_time: float, state: Sequence[float]) -> list[float]:
        x, y, z, vx, vy, vz = state
        equatorial = x * x + y * y
        squared = equatorial + z * z
        r = sqrt(squared)
        pull = -mu / (squared * r)
        oblate = oblateness / squared
        polar = 5.0 * z * z / squared
        side = pull * (1.0 + oblate * (1.0 - polar))
        axis = pull * (1.0 + oblate * (3.0 - polar))
        if beta is None:
            return [vx, vy, vz, side * x, side * y, axis * z]
        q = a / r
        stretched = z / (1.0 - e2 * q * (1.0 + e2 * (0.5 - q) * z * z / squared))
        norm = sqrt(equatorial + stretched * stretched)
        height = (equatorial + z * stretched) / norm - a * sqrt(1.0 - e2 * (stretched / norm) ** 2)
        wx = vx + omega * y
        wy = vy - omega * x
        speed = sqrt(wx * wx + wy * wy + vz * vz)
        k = SEA_LEVEL_KG_M3 * math.exp(-height / SCALE_HEIGHT_M) * speed / (2.0 * beta)
        return [vx, vy, vz, side * x - k * wx, side * y - k * wy, axis * z - k * vz]

    return rates


def solved(part: Problem, method: str, bound: float, relative: float) -> np.ndarray:
    """Return positions at impact by SciPy."""
    from scipy.integrate import solve_ivp

    ends = []
    options = {
        "method": method,
        "rtol": max(relative, 3e-14),
        "atol": relative * SCALE,
        "max_step": bound,
    }
    for index, duration in enumerate(part.duration):
        rates = scalar_rates(None if part.beta is None else float(part.beta[index]))
        start = np.concatenate([part.position[index], part.velocity[index]])
        ends.append(solve_ivp(rates, (0.0, duration), start, **options).y[:3, -1])
    return np.array(ends)


def symbolic_system(heyoka: Any, with_drag: bool) -> list[Any]:
    """Return the same right side for heyoka, the ballistic coefficient its parameter."""
    x, y, z, vx, vy, vz = heyoka.make_vars("x", "y", "z", "vx", "vy", "vz")
    e2 = EARTH_ECCENTRICITY_SQUARED
    a = EARTH_EQUATORIAL_RADIUS_M
    equatorial = x * x + y * y
    squared = equatorial + z * z
    pull = -FIELD.mu_m3_s2 * squared**-1.5
    oblate = 1.5 * FIELD.j2 * FIELD.radius_m**2 / squared
    polar = 5.0 * z * z / squared
    side = pull * (1.0 + oblate * (1.0 - polar))
    axis = pull * (1.0 + oblate * (3.0 - polar))
    acceleration = [side * x, side * y, axis * z]
    if with_drag:
        q = a * squared**-0.5
        stretched = z / (1.0 - e2 * q * (1.0 + e2 * (0.5 - q) * z * z / squared))
        norm = heyoka.sqrt(equatorial + stretched * stretched)
        sine = stretched / norm
        height = (equatorial + z * stretched) / norm - a * heyoka.sqrt(1.0 - e2 * sine * sine)
        wind = [vx + EARTH_ROTATION_RAD_S * y, vy - EARTH_ROTATION_RAD_S * x, vz]
        speed = heyoka.sqrt(wind[0] * wind[0] + wind[1] * wind[1] + wind[2] * wind[2])
        k = SEA_LEVEL_KG_M3 * heyoka.exp(-height / SCALE_HEIGHT_M) * speed / (2.0 * heyoka.par[0])
        acceleration = [each - k * w for each, w in zip(acceleration, wind, strict=True)]
    return list(zip((x, y, z, vx, vy, vz), [vx, vy, vz, *acceleration], strict=True))


def heyoka_batch(
    heyoka: Any, problem: Problem, tolerance: float, bound: float
) -> Callable[[], np.ndarray]:
    """Return a run of heyoka's batch integrator, eight arcs at a time, compiled already."""
    lanes = 8
    system = symbolic_system(heyoka, problem.beta is not None)
    parameters = {} if problem.beta is None else {"pars": np.ones((1, lanes))}
    integrator = heyoka.taylor_adaptive_batch(
        system, np.zeros((6, lanes)), tol=tolerance, **parameters
    )
    states = np.concatenate([problem.position, problem.velocity], axis=1).T
    count = len(problem.duration)

    def run() -> np.ndarray:
        ends = np.empty((count, 3))
        for begin in range(0, count, lanes):
            which = np.minimum(np.arange(begin, begin + lanes), count - 1)
            integrator.set_time(0.0)
            integrator.state[:] = states[:, which]
            if problem.beta is not None:
                integrator.pars[0] = problem.beta[which]
            limits = {"max_delta_t": [bound] * lanes} if np.isfinite(bound) else {}
            integrator.propagate_until(problem.duration[which], max_steps=MOST_STEPS, **limits)
            ends[which] = integrator.state[:3].T
        return ends

    return run


def heyoka_single(
    heyoka: Any, problem: Problem, tolerance: float, bound: float
) -> Callable[[], np.ndarray]:
    """Return a run of heyoka's ordinary integrator, compiled already."""
    system = symbolic_system(heyoka, problem.beta is not None)
    integrator = heyoka.taylor_adaptive(
        system, [0.0] * 6, tol=tolerance, pars=[] if problem.beta is None else [1.0]
    )
    states = np.concatenate([problem.position, problem.velocity], axis=1)

    def run() -> np.ndarray:
        ends = np.empty((len(states), 3))
        for index, state in enumerate(states):
            integrator.time = 0.0
            integrator.state[:] = state
            if problem.beta is not None:
                integrator.pars[0] = problem.beta[index]
            limits = {"max_delta_t": bound} if np.isfinite(bound) else {}
            integrator.propagate_until(problem.duration[index], max_steps=MOST_STEPS, **limits)
            ends[index] = integrator.state[:3]
        return ends

    return run
