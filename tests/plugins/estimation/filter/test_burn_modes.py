"""The modes of a burn: a new stage is found, and a steady burn stays sharp."""

import numpy as np
import pytest
from opir_estimation import Gaussian, NewStage, Thrust
from opir_estimation.filter import burn_modes
from opir_estimation.filter.burn_modes import BurnModes
from opir_estimation.filter.estimates import BURN_SHARE, Burns, in_parts
from opir_estimation.filter.iterated_update import Updated, log_likelihoods
from opir_estimation.square_root import covariance

from opir_core.flight.forces import Forces

TILT = 0.05
ALONG = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
STAGE = NewStage(20.0, 10.0, 0.01, 0.01, every_s=40.0, tilt=TILT)
MODES = BurnModes(Thrust(np.radians(3.0), 30.0, 0.5, 0.001, Forces(zonal=())), STAGE)
#: A burn at 2 km/s with 60 m/s², known well.
STATE = np.array([6.5e6, 0.0, 0.0, 1400.0, 1400.0 + 474.0, 0.0, 42.0, 42.0, 0.0, 0.015])
SIGMA = np.array([100.0] * 3 + [20.0] * 3 + [2.0] * 3 + [0.002])


def burns(share=BURN_SHARE):
    root = np.diag(1.0 / SIGMA)[None]
    return Burns(in_parts(STATE[None]), in_parts(root), share)


def predicted(known, step_s):
    """Return burns a step later."""
    return MODES.predicted(burn_modes.moments(known), known, step_s)[1]


def test_a_new_stage_has_the_prior_of_force_and_growth_and_the_position_and_velocity_of_the_old():
    mean, root, _ = burns()
    after, begun = STAGE.begun(Gaussian(mean[:, 0], root[:, 0]))
    assert after[0, :6] == pytest.approx(STATE[:6])
    assert np.linalg.norm(after[0, 6:9]) == pytest.approx(20.0, rel=2e-3)
    assert after[0, 6:9] @ [1.0, 1.0, 0.0] == pytest.approx(20.0 * np.sqrt(2.0), rel=2e-3)
    spread = covariance(begun)[0]
    assert np.sqrt(np.diag(spread)[[0, 1, 2, 3, 4, 5, 9]]) == pytest.approx(
        [*SIGMA[:6], 0.01], rel=1e-9
    )
    assert np.sqrt(ALONG @ spread[6:9, 6:9] @ ALONG) == pytest.approx(10.0, rel=2e-2)


def test_the_force_of_a_new_stage_turns_with_the_velocity_and_is_off_it_by_the_tilt():
    mean, root, _ = burns()
    root[:, 0, 5, 5] = 1.0 / 600.0
    spread = covariance(STAGE.begun(Gaussian(mean[:, 0], root[:, 0])).root)[0]
    turn = 20.0 / 1980.0
    assert spread[8, 5] / spread[5, 5] == pytest.approx(turn, rel=1e-2)
    left = spread[8, 8] - spread[8, 5] ** 2 / spread[5, 5]
    assert np.sqrt(left) == pytest.approx(20.0 * (TILT + 100.0 / 1980.0), rel=1e-2)


def test_what_is_known_of_the_velocity_with_the_force_is_kept_and_of_the_force_is_dropped():
    mean, root, _ = burns()
    root[:, 0, 3, 6] = 0.04
    before = covariance(root[:, 0])[0]
    _, begun = STAGE.begun(Gaussian(mean[:, 0], root[:, 0]))
    assert covariance(begun)[0, :6, :6] == pytest.approx(before[:6, :6], rel=1e-9)
    assert covariance(begun)[0, :6, 6:9] @ ALONG / (20.0 * 10.0) == pytest.approx(0.0, abs=1e-3)


def test_the_probability_of_a_new_stage_grows_at_its_rate():
    _, _, share = predicted(burns(), 1.0)
    assert share[0] == pytest.approx([np.exp(-1.0 / 40.0), -np.expm1(-1.0 / 40.0), 0.0], rel=1e-9)
    _, _, later = predicted(predicted(burns(), 1.0), 1.0)
    assert later[0, 0] == pytest.approx(np.exp(-2.0 / 40.0), rel=1e-9)


def test_a_step_of_no_time_changes_nothing():
    mean, root, share = predicted(burns(), 0.0)
    assert mean[0] == pytest.approx(burns()[0][0], rel=1e-12)
    assert covariance(root[:, 1]) == pytest.approx(covariance(burns()[1][:, 1]), rel=1e-9, abs=1e-9)
    assert np.array_equal(share, BURN_SHARE)


def test_a_decided_stage_is_the_steady_burn_with_the_moments_of_both():
    known = burns(np.array([[0.05, 0.95, 0.0]]))
    known[0][:, 1, 6:9] *= 0.4
    mean, _, share = predicted(known, 0.1)
    assert share[0, 0] == pytest.approx(np.exp(-0.1 / 40.0))
    assert np.linalg.norm(mean[0, 0, 6:9]) == pytest.approx(60.0 * (0.05 + 0.95 * 0.4), rel=0.02)


@pytest.mark.parametrize("force", [60.0, 20.0])
def test_positions_of_eight_seconds_show_whether_a_stage_began(force):
    """Looks of 300 m a second: a stage of 20 m/s² instead of 60 is 1.3 km behind after eight
    seconds.
    """
    truth = STATE[None].copy()
    known = burns()
    truth[0, 6:9] *= force / 60.0
    for _ in range(8):
        truth = MODES.motion.propagated(truth, np.ones(1))
        known = predicted(known, 1.0)
        modes = MODES.modes(burn_modes.moments(known), known)
        after = [_seen(mode, truth[0, :3], 300.0) for mode in modes]
        _, known, _ = MODES.joined(
            known, after, [log_likelihoods(*pair) for pair in zip(modes, after, strict=True)]
        )
    assert known[2][0].max() > 0.9
    mean, root = burn_modes.moments(known)
    assert np.linalg.norm(mean[0, 6:9]) == pytest.approx(np.linalg.norm(truth[0, 6:9]), abs=8.0)
    error = mean[0] - truth[0]
    assert error @ np.linalg.solve(covariance(root)[0], error) < 18.3


def _seen(mode, place_m, sigma_m):
    """Return a mode after a measured position."""
    from opir_estimation.filter.measurement_updates import least_squares

    size = mode.mean.shape[1]
    stack = np.zeros((len(mode.mean), size + 3, size + 1))
    stack[:, :size, :size] = mode.root
    stack[:, size:, :3] = np.eye(3) / sigma_m
    stack[:, size:, -1] = (place_m - mode.mean[:, :3]) / sigma_m
    upper, step, left = least_squares(stack)
    return Updated(mode.mean + step, upper, left)


def test_without_stages_a_burn_has_no_parts():
    alone = BurnModes(MODES.motion, None)
    boost = Gaussian(STATE[None], np.diag(1.0 / SIGMA)[None])
    (mean, root), _ = alone.predicted(boost, burns(), 1.0)
    after = burn_modes.carried(MODES.motion, boost, np.ones(1))
    assert np.array_equal(mean, after[0])
    assert np.array_equal(root, after[1])
    assert len(alone.modes(boost, burns())) == 1


@pytest.mark.parametrize("count", [1, 2])
def test_the_boost_of_a_burn_is_the_moments_of_its_parts(count):
    doubtful = burns(np.array([[0.7, 0.3, 0.0]]))
    known = Burns(*(column.repeat(count, axis=0) for column in doubtful))
    boost, parts = MODES.predicted(burn_modes.moments(known), known, 1.0)
    for reported, own in zip(boost, burn_modes.moments(parts), strict=True):
        assert np.array_equal(reported, own)
    modes = MODES.modes(boost, parts)
    after = [_seen(mode, parts[0][:, 0, :3] + 50.0, 300.0) for mode in modes]
    boost, parts, _ = MODES.joined(
        parts, after, [log_likelihoods(*pair) for pair in zip(modes, after, strict=True)]
    )
    for reported, own in zip(boost, burn_modes.moments(parts), strict=True):
        assert np.array_equal(reported, own)
