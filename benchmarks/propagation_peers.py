"""The same arcs, with the same forces, for SciPy and heyoka (see `propagation.py`)."""

import math
from typing import NamedTuple

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
#: Arcs of heyoka's batch.
LANES = 8


class Problem(NamedTuple):
    """Arcs (n,), their forces, ballistic coefficients with drag, kg/m², and where they end."""

    name: str
    forces: Forces
    beta: np.ndarray | None
    position: np.ndarray
    velocity: np.ndarray
    duration: np.ndarray


def right_side(state, beta, sqrt, exp):
    """Return the rates of a state (6,), in the numbers or symbols of a library; `beta` is None
    without drag.
    """
    x, y, z, vx, vy, vz = state
    e2 = EARTH_ECCENTRICITY_SQUARED
    a = EARTH_EQUATORIAL_RADIUS_M
    omega = EARTH_ROTATION_RAD_S
    equatorial = x * x + y * y
    squared = equatorial + z * z
    r = sqrt(squared)
    pull = -FIELD.mu_m3_s2 / (squared * r)
    oblate = 1.5 * FIELD.j2 * FIELD.radius_m**2 / squared
    polar = 5.0 * z * z / squared
    side = pull * (1.0 + oblate * (1.0 - polar))
    axis = pull * (1.0 + oblate * (3.0 - polar))
    rates = [side * x, side * y, axis * z]
    if beta is not None:
        q = a / r
        stretched = z / (1.0 - e2 * q * (1.0 + e2 * (0.5 - q) * z * z / squared))
        length = sqrt(equatorial + stretched * stretched)
        sine = stretched / length
        height = (equatorial + z * stretched) / length - a * sqrt(1.0 - e2 * sine * sine)
        wind = [vx + omega * y, vy - omega * x, vz]
        speed = sqrt(wind[0] * wind[0] + wind[1] * wind[1] + wind[2] * wind[2])
        k = SEA_LEVEL_KG_M3 * exp(-height / SCALE_HEIGHT_M) * speed / (2.0 * beta)
        rates = [rate - k * air for rate, air in zip(rates, wind, strict=True)]
    return [vx, vy, vz, *rates]


def solved(part, method, bound, relative):
    """Return positions (n, 3) at impact by SciPy."""
    from scipy.integrate import solve_ivp

    ends = []
    options = {
        "method": method,
        "rtol": max(relative, 3e-14),
        "atol": relative * SCALE,
        "max_step": bound,
    }
    for index, duration in enumerate(part.duration):
        beta = None if part.beta is None else float(part.beta[index])
        start = np.concatenate([part.position[index], part.velocity[index]])
        # In plain Python, the fastest for one arc at a time without compiling.
        flight = solve_ivp(
            lambda _, state, beta=beta: right_side(state.tolist(), beta, math.sqrt, math.exp),
            (0.0, duration),
            start,
            **options,
        )
        ends.append(flight.y[:3, -1])
    return np.array(ends)


def symbolic_system(heyoka, with_drag):
    """Return the rates for heyoka, the ballistic coefficient its parameter."""
    state = heyoka.make_vars("x", "y", "z", "vx", "vy", "vz")
    beta = heyoka.par[0] if with_drag else None
    return list(zip(state, right_side(state, beta, heyoka.sqrt, heyoka.exp), strict=True))


def heyoka_run(heyoka, problem, tolerance, bound, lanes):
    """Return a run of heyoka's integrator, compiled already: some arcs at a time, or one."""
    is_batch = lanes > 1
    system = symbolic_system(heyoka, problem.beta is not None)
    settings = {"tol": tolerance}
    if problem.beta is not None:
        settings["pars"] = np.ones((1, lanes)) if is_batch else [1.0]
    kind = heyoka.taylor_adaptive_batch if is_batch else heyoka.taylor_adaptive
    integrator = kind(system, np.zeros((6, lanes)) if is_batch else [0.0] * 6, **settings)
    states = np.concatenate([problem.position, problem.velocity], axis=1)
    # A run that has gone astray is cut off.
    limits = {"max_steps": 5000}
    if np.isfinite(bound):
        limits["max_delta_t"] = [bound] * lanes if is_batch else bound

    def run():
        ends = np.empty((len(states), 3))
        for begin in range(0, len(states), lanes):
            rows = np.minimum(np.arange(begin, begin + lanes), len(states) - 1)
            arcs = rows if is_batch else begin
            if is_batch:
                integrator.set_time(0.0)
            else:
                integrator.time = 0.0
            integrator.state[:] = states[arcs].T
            if problem.beta is not None:
                integrator.pars[0] = problem.beta[arcs]
            integrator.propagate_until(problem.duration[arcs], **limits)
            ends[arcs] = integrator.state[:3].T
        return ends

    return run
