"""Impacts of burns whose ends are open, against flights drawn at random."""

import numpy as np
import pytest
from attrs import evolve
from class_flights import PRIORS
from opir_trackers.profile import fit, flight
from opir_trackers.profile.family import (
    BURN,
    EAST,
    LIFT,
    NORTH,
    PITCH,
    SHAPE,
    SPEED,
    START,
    TURN_EAST,
    TURN_NORTH,
    natural,
)
from opir_trackers.profile.report import Basis, report

from opir_core.scene.scene import TARGET_TYPES

#: Standard deviations in mid-boost as two sensors of 50 µrad leave them: of an end that is open and a speed that is not
#: known, beside what is.
SIGMAS = {EAST: 500.0, NORTH: 500.0, START: 1.0, TURN_EAST: 0.02, TURN_NORTH: 0.02, PITCH: 0.05, LIFT: 0.05}

COUNT = 20_000


def standing(kind, azimuth_deg, slower, speed_sigma, burn_sigma, growth_sigma):
    """Return a hypothesis in the middle of its class, on its way at an azimuth.

    What looks leave of its parameters has these standard deviations; the prior of its burnout speed is known beside.
    """
    number = TARGET_TYPES.index(kind)
    parameters = np.zeros((1, 10))
    turn = PRIORS.turn_rad[number] * np.array([np.sin(np.radians(azimuth_deg)), np.cos(np.radians(azimuth_deg))])
    parameters[0, [TURN_EAST, TURN_NORTH]], parameters[0, SPEED] = turn, -slower
    sigma = np.zeros(10)
    for column, value in (SIGMAS | {SPEED: speed_sigma, BURN: burn_sigma, SHAPE: growth_sigma}).items():
        sigma[column] = value
    spread = np.diag(np.square(sigma))[None]
    # A later start leaves the longer burn to come.
    spread[0, START, BURN] = spread[0, BURN, START] = -0.5 * sigma[START] * sigma[BURN]
    found = evolve(
        fit.blank(1, 2),
        kind=np.array([number]),
        anchor_latitude_rad=np.array([0.6]),
        anchor_longitude_rad=np.array([-2.0]),
        parameters=parameters,
        is_bent=np.ones(1, dtype=np.int64),
    )
    slope = slope_of(found)
    return evolve(found, spread=np.linalg.inv(np.linalg.inv(spread) + slope[:, None] * slope))


def impacts_of(hypothesis, parameters):
    """Return where boosts of parameters (n, 10) come down."""
    count = len(parameters)
    again = evolve(hypothesis.take(np.zeros(count, dtype=np.int64)), parameters=parameters)
    family = fit.family_of(again, PRIORS)
    places = family.places(np.arange(count), family.burnout_s)
    return flight.landed(np.column_stack([places.position_m, places.velocity_m_s, family.burnout_s]))


def speeds(hypothesis, parameters):
    """Return burnout speeds of parameters (n, 10), logarithms over the class's median, in its standard deviations."""
    prior = PRIORS.take(np.repeat(hypothesis.kind, len(parameters)))
    return natural(parameters, prior).parameters[:, SPEED] / prior.speed_sigma


def slope_of(hypothesis):
    """Return by how many standard deviations parameters move the burnout speed, (10,)."""
    step = 1e-4 * np.eye(10)
    here = hypothesis.parameters
    return (speeds(hypothesis, here + step) - speeds(hypothesis, here - step)) / 2e-4


def likelier(hypothesis, parameters):
    """Return how much likelier (n,) parameters are for the prior of their speeds than were it linear there."""
    stands = hypothesis.parameters
    linear = speeds(hypothesis, stands) + (parameters - stands) @ slope_of(hypothesis)
    return np.exp(-0.5 * (np.square(speeds(hypothesis, parameters)) - np.square(linear)))


def drawn(hypothesis):
    """Return what is told of a hypothesis, where flights drawn from it come down, and their shares (n,).

    That is metres east and north of the impact told, and seconds after it. The priors of their speeds are their own.
    """
    told = report(hypothesis, np.ones(1), 30.0, Basis(PRIORS, "kepler"))
    rng = np.random.default_rng(5)
    parameters = rng.multivariate_normal(hypothesis.parameters[0], hypothesis.spread[0], COUNT)
    landed, share = impacts_of(hypothesis, parameters), likelier(hypothesis, parameters)
    known = np.isfinite(landed).all(axis=1)
    assert share[known].sum() > 0.999 * share.sum()
    return told, flight.on_ground(landed[known], told.impact), share[known] / share[known].sum()


def of_size(away, covariance):
    """Return the sizes (n,) of errors (n, 2) in standard deviations of a covariance."""
    return np.sqrt(np.einsum("ni,ij,nj->n", away, np.linalg.inv(covariance), away))


#: Classes, how much slower they are than their medians, and standard deviations of the acceleration at the start, of
#: the burn's end and of the acceleration's growth. Impacts are known to a quarter of the way, or far better; of the
#: last the prior of the burnout speed, taken as linear, would have the ends that are far off too fast.
CASES = [
    ("SRBM", 0.0, 0.03, 0.05, 0.1),
    ("SRBM", 0.0, 0.02, 0.03, 0.1),
    ("IRBM", 0.0, 0.06, 0.05, 0.1),
    ("IRBM", 0.0, 0.02, 0.06, 0.1),
    ("ICBM", 0.1, 0.02, 0.03, 0.1),
    ("ICBM", 0.15, 0.02, 0.15, 0.1),
    ("IRBM", 0.0, 0.03, 0.1, 0.2),
]


@pytest.mark.parametrize(
    "azimuth_deg", [15.0, *(pytest.param(each, marks=pytest.mark.slow) for each in (110.0, 290.0))]
)
@pytest.mark.parametrize(
    "case", [CASES[0], CASES[4], *(pytest.param(case, marks=pytest.mark.slow) for case in (*CASES[1:4], *CASES[5:]))]
)
def test_impacts_of_open_ends_are_those_of_flights_drawn_at_random(case, azimuth_deg):
    kind, *rest = case
    told, away, share = drawn(standing(kind, azimuth_deg, *rest))
    count = 1.0 / np.sum(np.square(share))
    assert count > 0.3 * COUNT
    expected = told.impact_covariance[0]
    size = of_size(away[:, :2], expected[:2, :2])
    held = [np.sum(share[size <= radius]) for radius in told.impact_sigmas[0]]
    chance = 3.3 * np.sqrt(0.0475 / count)
    # To 0.6 %, root mean square, points stand for a distribution (`containing`); bends are known to second order.
    assert held[1:] == pytest.approx([0.9, 0.95], abs=0.02 + chance)
    # Means are off by hundredths of a standard deviation, and few flights far off count much in what is drawn.
    sigma, mean = np.sqrt(np.diagonal(expected)), share @ away
    assert mean / sigma == pytest.approx(np.zeros(3), abs=0.05 + 3.3 / np.sqrt(count))
    spread = np.sqrt(share @ np.square(away - mean)) / sigma
    assert np.all((spread > 0.9) & (spread < 1.6))
