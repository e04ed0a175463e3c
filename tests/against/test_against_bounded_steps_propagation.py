"""The onset of drag: re-entries from apogee against an integration whose steps are small
throughout.

Above the air a step controller cannot see that there will be air: it steps into it, or over it, and
reports success. The reference is the classical Runge-Kutta method with steps of 2 s down to 100 s
before 30 km height, and of 0.1 s from there on, for a thousand arcs at once, with its own gravity
and the heights of `geometry`.
"""

from functools import cache

import numpy as np
import pytest

from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.flight.altitude_events import AltitudeEvents
from opir_core.flight.atmosphere_density import density_kg_m3
from opir_core.flight.dense_output import dense_arcs
from opir_core.flight.forces import Drag, ExponentialAtmosphere, Forces, ZonalField
from opir_core.flight.propagation import impact_states_eci, propagate
from opir_core.geometry import ecef_to_geodetic

COUNT = 1000
HEIGHT_M = 30e3
FINE_S = 100.0
ATMOSPHERES = {"us76": "us_standard_1976", "exp": ExponentialAtmosphere(1.225, 7200.0)}

#: What may be asked, m: from absurdly loose to below rounding.
TOLERANCES_M = [1e6, 1.0, 1e-2, 1e-4, 1e-9]


class Reentries:
    """Arcs at their apogees, and where a bounded-step integration has them when they come to 30
    km.
    """

    def __init__(self, atmosphere):
        random = np.random.default_rng(20)
        self.beta = np.exp(random.uniform(np.log(100.0), np.log(10e3), COUNT))
        self.forces = Forces(drag=Drag(self.beta, atmosphere))
        self.position, self.velocity = apogees(random)
        self.duration = impact_states_eci(
            self.position, self.velocity, HEIGHT_M, self.forces, tolerance_m=1e-6
        ).duration_s
        assert np.isfinite(self.duration).all()
        state = np.concatenate([self.position, self.velocity], axis=1)
        coarse = np.maximum(self.duration - FINE_S, 0.0)
        rates = derivative(self.beta, atmosphere)
        state = runge_kutta(rates, state, coarse, int(coarse.max() / 2.0) + 1)
        self.end = runge_kutta(rates, state, self.duration - coarse, int(FINE_S / 0.1))


def apogees(random):
    up = random.normal(size=(COUNT, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    along = np.cross(up, random.normal(size=(COUNT, 3)))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    height = random.uniform(200e3, 1500e3, COUNT)
    speed = random.uniform(500.0, 6500.0, COUNT)
    return up * (6371e3 + height)[:, np.newaxis], along * speed[:, np.newaxis]


def derivative(beta, atmosphere):
    field = ZonalField()

    def rates(state):
        x, y, z, vx, vy, vz = state.T
        squared = x * x + y * y + z * z
        pull = -EARTH_MU_M3_S2 / squared**1.5
        oblate = 1.5 * field.j2 * field.radius_m**2 / squared
        polar = 5.0 * z * z / squared
        height = ecef_to_geodetic(state[:, :3]).height_m
        wind = np.stack([vx + EARTH_ROTATION_RAD_S * y, vy - EARTH_ROTATION_RAD_S * x, vz])
        drag = (
            density_kg_m3(height, atmosphere)
            * np.sqrt((wind * wind).sum(axis=0))
            / (2.0 * beta)
            * wind
        )
        equatorial = pull * (1.0 + oblate * (1.0 - polar))
        axial = pull * (1.0 + oblate * (3.0 - polar))
        return np.stack(
            [vx, vy, vz, equatorial * x - drag[0], equatorial * y - drag[1], axial * z - drag[2]],
            axis=1,
        )

    return rates


def runge_kutta(rates, state, duration, steps):
    h = (duration / steps)[:, np.newaxis]
    for _ in range(steps):
        k1 = rates(state)
        second = rates(state + 0.5 * h * k1)
        third = rates(state + 0.5 * h * second)
        fourth = rates(state + h * third)
        state = state + h / 6.0 * (k1 + 2.0 * second + 2.0 * third + fourth)
    return state


@cache
def reentries_through(atmosphere):
    return Reentries(ATMOSPHERES[atmosphere])


@pytest.fixture(params=list(ATMOSPHERES))
def reentries(request):
    return reentries_through(request.param)


def errors(reentries, tolerance_m):
    position, _ = propagate(
        reentries.position,
        reentries.velocity,
        reentries.duration,
        reentries.forces,
        tolerance_m=tolerance_m,
    )
    return np.linalg.norm(position - reentries.end[:, :3], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance_m", TOLERANCES_M)
def test_no_onset_is_missed_whatever_the_tolerance(reentries, tolerance_m):
    assert errors(reentries, tolerance_m).max() <= 1.0


@pytest.mark.slow
def test_the_reference_is_as_good_as_it_has_to_be(reentries):
    """The two agree to 2 cm, of which the reference, which steps across kinks, owes most; a metre
    is far outside.
    """
    assert errors(reentries, 1e-6).max() <= 2e-2


@pytest.mark.slow
def test_impacts_are_found_there_too(reentries):
    states = impact_states_eci(
        reentries.position, reentries.velocity, HEIGHT_M, reentries.forces, tolerance_m=1e6
    )
    assert np.linalg.norm(states.position_m - reentries.end[:, :3], axis=1).max() <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("tolerance_m", TOLERANCES_M[:3])
def test_without_the_seams_the_onset_is_missed(monkeypatch, tolerance_m):
    """What this file is about is real: with steps neither split at the seams nor bounded, errors
    exceed a metre.
    """
    looked_at = AltitudeEvents.shortened

    def never_shortened(self, start, step, h, candidate):
        looked_at(self, start, step, h, np.zeros_like(candidate))
        return np.empty(0, np.intp), np.empty(0)

    reentries = reentries_through("us76")
    monkeypatch.setattr(AltitudeEvents, "shortened", never_shortened)
    monkeypatch.setattr(AltitudeEvents, "lengths", lambda self, expected: (expected, expected))
    assert errors(reentries, tolerance_m).max() > 10.0


def test_steps_end_at_the_seams_and_are_bounded_in_the_air():
    """The split itself, step by step: every seam that the arc passes is an end of one of its
    steps.
    """
    position = np.array([7200e3, 0.0, 0.0])
    velocity = np.array([0.0, 3000.0, 3000.0])
    forces = Forces(drag=Drag(1000.0))
    duration = impact_states_eci(position, velocity, 1e3, forces).duration_s
    arcs = dense_arcs(position, velocity, duration, forces, tolerance_m=1e-3)
    height = ecef_to_geodetic(arcs.states[:, 0]).height_m
    for seam in (120e3, 86e3, 51412.5, 11019.0):
        assert np.abs(height - seam).min() <= 0.5
    in_air = height[height <= 120e3 + 1.0]
    assert np.abs(np.diff(in_air)).max() <= 16e3
