"""Slices in which only some sensors looked, or none: silence counts as far as somebody looked."""

import numpy as np
from attrs import evolve
from opir_estimation import (
    COAST,
    ImmFilter,
    LookTimes,
    ModeEstimates,
    Motion,
    Thrust,
    no_measurements,
)
from opir_estimation.filter.mode_mixing import mode_update
from opir_estimation.filter.thrust import THRUST

from opir_core.flight.forces import Forces

COUNT = 3
SPELL_S = 20.0
HITS = 60.0
FILTER = ImmFilter(
    Thrust(0.1, 30.0, 3.0, 0.002, Forces()),
    Motion(COAST, 0.01, Forces()),
    150.0,
    1000.0,
    coast_detection=0.01,
)


def burning() -> ModeEstimates:
    """Return boosts that were detected three times a second for 20 s, until now."""
    mean = np.tile(np.concatenate([[6.5e6, 0, 0], [2e3, 0, 0], [30.0, 0, 0], [0.01]]), (COUNT, 1))
    root = np.tile(np.eye(THRUST), (COUNT, 1, 1))
    coast = mean[:, :COAST], np.tile(np.eye(COAST), (COUNT, 1, 1))
    rate = np.tile([HITS, SPELL_S, 0.0], (COUNT, 1))
    return ModeEstimates(np.tile([0.5, 0.5], (COUNT, 1)), mean, root, *coast, rate)


def after(watched: LookTimes | None) -> ModeEstimates:
    return FILTER.updated(burning(), 1.0, no_measurements(), 1.0, watched)


def log_odds(estimates: ModeEstimates) -> np.ndarray:
    return np.log(estimates.weight[:, 0] / estimates.weight[:, 1])


def test_a_slice_that_nobody_watched_says_nothing() -> None:
    estimates = after(LookTimes(np.zeros(COUNT), np.zeros(COUNT)))
    np.testing.assert_array_equal(estimates.weight, burning().weight)
    np.testing.assert_array_equal(estimates.detection_rate, burning().detection_rate)


def test_misses_count_by_the_share_of_detections_that_were_due() -> None:
    """A third of the detections were due: exp(-r t / 3) is the chance of none."""
    share = np.array([0.0, 1.0 / 3.0, 1.0])
    estimates = after(LookTimes(share, np.ones(COUNT)))
    np.testing.assert_allclose(log_odds(estimates), -HITS / SPELL_S * share, atol=1e-12)
    np.testing.assert_allclose(estimates.detection_rate[:, 2], 1.0)


def test_a_slice_is_watched_throughout_unless_it_is_said() -> None:
    plain = after(None)
    said = after(LookTimes(np.ones(COUNT), np.ones(COUNT)))
    np.testing.assert_array_equal(plain.weight, said.weight)
    np.testing.assert_array_equal(plain.detection_rate, said.detection_rate)


def test_pauses_count_by_the_share_of_the_sensors_that_look() -> None:
    """A look after 9 s in which sensors of a hundredth of the detections looked."""
    share = np.full(COUNT, 0.01)
    estimates = evolve(burning(), detection_rate=np.tile([HITS, SPELL_S, 9.0], (COUNT, 1)))
    watched = LookTimes(share, np.ones(COUNT))
    looks = np.ones(COUNT), np.full(COUNT, 0.5), np.zeros((COUNT, 2))
    _, rate = mode_update(estimates, *looks, 1.0, 20.0, 40.0, watched)
    faded = np.exp(-1.0 / 20.0)
    np.testing.assert_allclose(rate[:, 0], faded * HITS + 1.0)
    np.testing.assert_allclose(rate[:, 1], faded * SPELL_S + 0.01 * (1.0 + 9.0 - 0.5))
