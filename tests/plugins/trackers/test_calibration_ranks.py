"""The tests of `benchmarks/calibration_ranks.py`: uniform for draws of the stated
distribution, else not.
"""

import sys

import numpy as np
from repository import ROOT

sys.path.append(str(ROOT / "benchmarks"))
from calibration_ranks import (
    CELLS,
    START_S,
    Mixture,
    Rank,
    of_cells,
    of_probabilities,
    uniformity,
)
from foreign_flights import ecef
from opir_forecast.launch_points import EDGES_S


def test_ranks_of_draws_of_the_stated_distribution_are_uniform_and_others_are_not():
    rng = np.random.default_rng(1)
    count, _, freedom, p_value = uniformity([Rank(0, "", value) for value in rng.uniform(size=500)])
    assert (len(count), freedom) == (10, 9)
    assert p_value > 0.01
    for values in (rng.beta(2.0, 2.0, 500), rng.beta(0.5, 0.5, 500), rng.uniform(size=500) ** 1.5):
        assert uniformity([Rank(0, "", value) for value in values])[-1] < 0.01


def test_impacts_in_regions_as_often_as_stated_pass():
    rng = np.random.default_rng(2)
    drawn = [Rank(0, "", float(cell)) for cell in rng.choice(len(CELLS), 500, p=CELLS)]
    assert of_cells(drawn)[-1] > 0.01
    outside = [*drawn[50:], *[Rank(0, "", float(len(CELLS) - 1))] * 50]
    assert of_cells(outside)[-1] < 0.01


def test_events_as_often_as_stated_pass_and_what_is_too_sure_does_not():
    rng = np.random.default_rng(3)
    stated = rng.beta(0.3, 0.3, 500)
    right = rng.uniform(size=500) < stated
    assert (
        of_probabilities(
            [Rank(0, "", *each) for each in zip(stated.tolist(), right.tolist(), strict=True)]
        )[-1]
        > 0.01
    )
    sure = [Rank(0, "", 0.001, number < 20) for number in range(500)]
    assert of_probabilities(sure)[-1] < 1e-6


def test_launches_drawn_of_a_mixture_have_uniform_ranks_in_it_and_not_in_one_that_is_too_wide():
    rng = np.random.default_rng(4)
    launch = (0.3, -2.0)
    middles = 0.5 * (EDGES_S[1:] + EDGES_S[:-1])
    chance = np.exp(-EDGES_S[1:] / 4.0)
    chance /= chance.sum()
    offset = np.outer([30.0, -20.0, 10.0], middles)
    right = []
    wide = []
    for number in rng.choice(len(chance), 1000, p=chance):
        first_s = START_S + rng.uniform(*EDGES_S[number : number + 2])
        truth = offset[:, number] + 50.0 * rng.normal(size=3)
        place = ecef(*launch)[:, None] - truth[:, None] + offset
        when = first_s - middles
        for found, scale in ((right, 1.0), (wide, 3.0)):
            spread = np.tile(np.square(scale * 50.0) * np.eye(3)[:, :, None], len(chance))
            found.append(Mixture(place, spread, when, chance).ranks(launch))
    for quantity in range(3):
        assert uniformity([Rank(0, "", ranks[quantity]) for ranks in right])[-1] > 0.01
    assert uniformity([Rank(0, "", ranks[0]) for ranks in wide])[-1] < 1e-3
