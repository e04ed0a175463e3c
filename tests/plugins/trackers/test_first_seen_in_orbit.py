"""What is first seen in an orbit has been there for an unknown time: it has no launch."""

import numpy as np
import pytest
from drawn_flights import ROWS, Flown
from opir_forecast import are_in_orbit
from tracked_flights import followed, rows_of, usual

MU = 3.986004418e14
SPIN = 7.292115e-5
RADIUS_M = 6.628e6
BURN_S = 40.0
START_S = 4.0
THRUST_M_S2 = 8.0


def rates(state):
    """Return the rates (n, 6) of states that thrust along their velocity."""
    position, velocity = state[:, :3], state[:, 3:]
    radius = np.linalg.norm(position, axis=1)[:, None]
    speed = np.linalg.norm(velocity, axis=1)[:, None]
    return np.hstack([velocity, -MU / radius**3 * position + THRUST_M_S2 * velocity / speed])


def earth_fixed(state, time_s):
    """Return inertial states (n, 6) in ECEF at a time."""
    cosine, sine = np.cos(SPIN * time_s), np.sin(SPIN * time_s)
    turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    position = state[:, :3] @ turn.T
    velocity = state[:, 3:] @ turn.T - np.cross([0.0, 0.0, SPIN], position)
    return position, velocity


def burns_in_orbit(share):
    """Return burns that begin on level courses at a share of the speed of a circular orbit."""
    azimuth = np.array([[0.3], [2.0]])
    up = np.array([[1.0, 0.0, 0.0], [np.cos(0.3), np.sin(0.3), 0.0]])
    east = np.cross([0.0, 0.0, 1.0], up)
    level = np.sin(azimuth) * east + np.cos(azimuth) * np.array([0.0, 0.0, 1.0])
    state = np.hstack([RADIUS_M * up, share * np.sqrt(MU / RADIUS_M) * level])
    step_s = BURN_S / (ROWS - 1)
    rows = [earth_fixed(state, START_S)]
    for row in range(1, ROWS):
        middle = state + 0.5 * step_s * rates(state)
        state = state + step_s * rates(middle)
        rows.append(earth_fixed(state, START_S + row * step_s))
    position, velocity = (np.stack(columns, axis=1) for columns in zip(*rows, strict=True))
    count = len(position)
    spells = np.ones((count, 2, 2))
    return Flown(np.full(count, START_S), np.full(count, BURN_S), position, velocity, spells)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "has_launch"), [(1.0, False), (0.7, True)])
def test_a_burn_that_is_first_seen_in_an_orbit_has_no_launch(share, has_launch):
    *_, tick = followed(burns_in_orbit(share), usual("ICBM"), 1, 30.0)
    rows = rows_of(tick.reported, tick.shared)
    assert (tick.reported.probability_launch[rows] > 0.9).all()
    assert (np.isfinite(tick.reported.launch[rows, 2]) == has_launch).all()


@pytest.mark.parametrize(
    ("speed", "climb", "is_above"),
    [(1.0, 0.0, True), (1.2, 0.0, True), (1.5, 0.0, True), (0.97, 0.0, False), (1.0, 0.2, False)],
)
def test_an_orbit_stays_above_the_ground_if_its_perigee_does(speed, climb, is_above):
    """At 250 km the perigee of a level start at 0.97 of the speed is below the ground."""
    velocity = np.sqrt(MU / RADIUS_M) * np.array([climb, speed, 0.0])
    state = np.concatenate([[RADIUS_M, 0.0, 0.0], velocity])[None]
    assert are_in_orbit(state)[0] == is_above
