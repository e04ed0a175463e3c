"""Two-body propagation against boinor (MIT licence), the heir of poliastro: its kernels of
Farnocchia and of Vallado.

Each is held to where it is known to be right (benchmarks/kepler.py): neither near
the parabola, the straight line, or a circle closed many times. Vallado's kernel takes its anomaly
as found once a step is below 1e-7 km^½: r / √mu times that is 1e-6 s, so it is itself sure of nine
digits and no more.
"""

from importlib import import_module

import numba
import numpy as np
import pytest

from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.kepler import propagate_kepler

MU_KM3_S2 = EARTH_MU_M3_S2 * 1e-9
COUNT = 200


@pytest.fixture(scope="module")
def kernels():
    """Return boinor's kernels as plain Python: compiling them takes a minute, running them so a
    millisecond a state.
    """
    compiles = numba.config.DISABLE_JIT
    numba.config.DISABLE_JIT = True
    try:
        yield {
            name: getattr(import_module(f"boinor.core.propagation.{name}"), name)
            for name in ("vallado",)
        } | {"farnocchia": import_module("boinor.core.propagation.farnocchia").farnocchia_rv}
    finally:
        numba.config.DISABLE_JIT = compiles


def by_elements(kernel, position, velocity, duration):
    return (
        np.array(
            [
                np.concatenate(kernel(MU_KM3_S2, *state, time))
                for *state, time in zip(
                    position * 1e-3, velocity * 1e-3, duration.tolist(), strict=True
                )
            ]
        )
        * 1e3
    )


def by_coefficients(kernel, position, velocity, duration):
    ends = []
    for r, v, time in zip(position * 1e-3, velocity * 1e-3, duration.tolist(), strict=True):
        f, g, f_rate, g_rate = kernel(MU_KM3_S2, r, v, time, 100)
        ends.append(np.concatenate([f * r + g * v, f_rate * r + g_rate * v]))
    return np.array(ends) * 1e3


def states(eccentricity, perigee_m, anomaly_rad, rng):
    """Return states on conics of random planes."""
    parameter = perigee_m * (1.0 + eccentricity)
    radius = parameter / (1.0 + eccentricity * np.cos(anomaly_rad))
    speed = np.sqrt(EARTH_MU_M3_S2 / parameter)
    zero = np.zeros(COUNT)
    position = radius[:, None] * np.stack([np.cos(anomaly_rad), np.sin(anomaly_rad), zero], axis=1)
    velocity = speed[:, None] * np.stack(
        [-np.sin(anomaly_rad), eccentricity + np.cos(anomaly_rad), zero], axis=1
    )
    axes = np.linalg.qr(rng.normal(size=(COUNT, 3, 3)))[0]
    return (axes @ position[:, :, None])[:, :, 0], (axes @ velocity[:, :, None])[:, :, 0]


def drawn(kind):
    rng = np.random.default_rng(20)
    around = rng.uniform(-np.pi, np.pi, COUNT)
    sense = rng.choice([-1.0, 1.0], COUNT)
    if kind == "ballistic":
        eccentricity = rng.uniform(0.3, 0.9, COUNT)
        climbing = np.pi + rng.uniform(-0.4, 0.4, COUNT)
        apogee_m = 6378e3 + rng.uniform(200e3, 1500e3, COUNT)
        perigee_m = apogee_m * (1.0 - eccentricity) / (1.0 + eccentricity)
        return *states(eccentricity, perigee_m, climbing, rng), sense * rng.uniform(
            10.0, 600.0, COUNT
        )
    if kind == "ellipse":
        perigee_m = rng.uniform(6.6e6, 4e7, COUNT)
        return *states(rng.uniform(0.01, 0.8, COUNT), perigee_m, around, rng), sense * rng.uniform(
            1.0, 9e4, COUNT
        )
    eccentricity = rng.uniform(1.05, 4.0, COUNT)
    anomaly = rng.uniform(-0.7, 0.7, COUNT) * np.arccos(-1.0 / eccentricity)
    return *states(eccentricity, rng.uniform(6.6e6, 4e7, COUNT), anomaly, rng), sense * rng.uniform(
        10.0, 2e4, COUNT
    )


def relative(result, expected):
    error = np.linalg.norm(result - expected, axis=1)
    return error / np.linalg.norm(expected, axis=1)


@pytest.mark.parametrize("kind", ["ballistic", "ellipse", "hyperbola"])
@pytest.mark.parametrize(
    ("name", "way", "bar"), [("farnocchia", by_elements, 1e-12), ("vallado", by_coefficients, 5e-9)]
)
def test_states_after_a_while(kernels, kind, name, way, bar):
    position, velocity, duration = drawn(kind)
    expected = way(kernels[name], position, velocity, duration)
    result = propagate_kepler(position, velocity, duration)
    assert relative(result[0], expected[:, :3]).max() <= bar
    assert relative(result[1], expected[:, 3:]).max() <= bar
