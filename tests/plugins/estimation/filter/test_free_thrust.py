"""Thrust in any direction: its motion against closed forms, when it is computed, and what it
finds.
"""

import numpy as np
import pytest
from opir_estimation import FreeBurn, FreeThrust, Gaussian, NewStage, Thrust
from opir_estimation.filter import burn_modes
from opir_estimation.filter.burn_modes import BurnModes
from opir_estimation.filter.estimates import BURN_SHARE, Burns, in_parts
from opir_estimation.filter.iterated_update import Updated, log_likelihoods
from opir_estimation.filter.measurement_updates import least_squares
from opir_estimation.square_root import covariance

from opir_core.flight.forces import Forces, ZonalField

#: A sphere of next to no mass: what is left is the force.
NOWHERE = Forces(zonal=(), gravity=ZonalField(mu_m3_s2=1.0))
STAGE = NewStage(20.0, 10.0, 0.01, 0.01, every_s=40.0, tilt=0.05)
FREE = FreeBurn(
    FreeThrust(2.5, 0.001, Forces(zonal=())),
    force_sigma_m_s2=22.0,
    relit=0.1,
    lasts_s=300.0,
    surprise=10.0,
)
MODES = BurnModes(Thrust(np.radians(3.0), 30.0, 0.5, 0.001, Forces(zonal=())), STAGE, FREE)
#: A coast at 1.5 km/s, 90 km high, known as after a minute of looks of two sensors.
COAST = np.array([6.47e6, 0.0, 0.0, 700.0, 472.0 + 1300.0, 0.0])
COAST_SIGMA = np.array([300.0] * 3 + [30.0] * 3)


@pytest.mark.parametrize("count", [1, 3, 7])
def test_a_constant_force_far_from_masses_is_a_parabola(count):
    rng = np.random.default_rng(1)
    state = np.concatenate([7e6 + rng.normal(size=(count, 3)), rng.normal(size=(count, 7))], axis=1)
    step = rng.uniform(0.5, 3.0, count)
    motion = FreeThrust(1.0, 0.0, NOWHERE)
    s = step[:, None]
    after = motion.propagated(state, step)
    place = state[:, :3]
    speed = state[:, 3:6]
    force = state[:, 6:9]
    assert after[:, :3] == pytest.approx(place + s * speed + 0.5 * s**2 * force, rel=1e-12)
    assert after[:, 3:6] == pytest.approx(speed + s * force, rel=1e-9)
    assert np.array_equal(after[:, 6:], state[:, 6:])
    taylor = motion.taylor(state)
    assert taylor[:, 2] == pytest.approx(force, rel=1e-9)
    assert taylor[:, 3] == pytest.approx(0.0, abs=1e-9)


def test_the_transition_is_the_slope_of_the_motion():
    motion = FreeThrust(1.0, 0.001, Forces())
    state = np.array([[6.5e6, 1e5, 2e5, 500.0, 1500.0, 100.0, -20.0, 5.0, 9.0, 0.01]])
    step = np.array([1.0])
    sizes = np.array([100.0] * 3 + [1.0] * 3 + [0.1] * 3 + [1e-3])
    slopes = np.empty((10, 10))
    for k, size in enumerate(sizes):
        moved = np.zeros(10)
        moved[k] = size
        slopes[:, k] = (
            motion.propagated(state + moved, step) - motion.propagated(state - moved, step)
        )[0] / (2 * size)
    assert motion.transition(state, step)[0] == pytest.approx(slopes, rel=1e-3, abs=1e-6)


def test_the_process_noise_is_that_of_an_integrated_random_walk():
    """After t the force has the variance q² t, the velocity q² t³ / 3, the position q² t⁵ / 20 on
    each axis.
    """
    q = 2.5
    t = 1.7
    root = FreeThrust(q, 0.002, Forces()).noise_root(np.array([t, t]), np.zeros((2, 10)))
    variance = np.diagonal(root @ root.transpose(0, 2, 1), axis1=1, axis2=2)
    known = np.repeat(q**2 * np.array([t**5 / 20.0, t**3 / 3.0, t]), 3)
    assert variance[0] == pytest.approx([*known, 0.002**2 * t])
    assert np.array_equal(variance[0], variance[1])


def old_burns(count=1):
    """Return burns before the dark, with 40 m/s² along the velocity."""
    state = np.concatenate([COAST, [19.0, 35.0, 0.0, 0.01]])
    sigma = np.concatenate([COAST_SIGMA, [2.0] * 3, [0.002]])
    root = np.tile(np.diag(1.0 / sigma), (count, 1, 1))
    share = BURN_SHARE.repeat(count, axis=0)
    return Burns(in_parts(np.tile(state, (count, 1))), in_parts(root), share)


def lit(count=1):
    root = np.tile(np.diag(1.0 / COAST_SIGMA), (count, 1, 1))
    coast = Gaussian(np.tile(COAST, (count, 1)), root)
    return MODES.lit(coast, old_burns(count))


@pytest.mark.parametrize("count", [1, 3])
def test_a_burn_after_the_dark_is_old_new_or_free(count):
    _, (mean, root, share) = lit(count)
    assert share[0] == pytest.approx([0.1, 0.8, 0.1])
    assert mean[:, :, :6] == pytest.approx(np.tile(COAST, (count, 3, 1)))
    assert mean[0, 0, 6:] == pytest.approx([19.0, 35.0, 0.0, 0.01])
    assert np.linalg.norm(mean[0, 1, 6:9]) == pytest.approx(20.0, rel=0.01)
    assert mean[0, 2, 6:9] == pytest.approx(0.0)
    sigma = np.sqrt(np.diagonal(covariance(root.reshape(-1, 10, 10)), axis1=1, axis2=2)).reshape(
        count, 3, 10
    )
    assert sigma[0, :, :6] == pytest.approx(np.tile(COAST_SIGMA, (3, 1)))
    assert sigma[0, :, 6] == pytest.approx([2.0, 10.0, 22.0])


def followed(force_of, seconds, looks_m=200.0, modes=MODES, first=None, seed=2):
    """Return burns after positions of `looks_m` each second of a target with a force, and its last
    state.
    """
    rng = np.random.default_rng(seed)
    truth = np.concatenate([COAST, np.zeros(4)])[None]
    motion = FreeThrust(1.0, 0.0, Forces(zonal=()))
    boost, burns = lit() if first is None else first
    shares = []
    for second in range(seconds):
        truth[0, 6:9] = force_of(second, truth[0])
        truth = motion.propagated(truth, np.ones(1))
        boost, burns = modes.predicted(boost, burns, 1.0)
        place = truth[0, :3] + looks_m * rng.normal(size=3)
        parts = modes.modes(boost, burns)
        after = [_seen(mode, place, looks_m) for mode in parts]
        logs = [log_likelihoods(*pair) for pair in zip(parts, after, strict=True)]
        boost, burns, _ = modes.joined(burns, after, logs)
        shares.append(burns[2][0])
    return boost, np.array(shares), truth


def _seen(mode, place_m, sigma_m):
    size = mode.mean.shape[1]
    stack = np.zeros((len(mode.mean), size + 3, size + 1))
    stack[:, :size, :size] = mode.root
    stack[:, size:, :3] = np.eye(3) / sigma_m
    stack[:, size:, -1] = (place_m - mode.mean[:, :3]) / sigma_m
    upper, step, left = least_squares(stack)
    return Updated(mode.mean + step, upper, left)


def along(size):
    return lambda _, state: (
        size * (state[3:6] - [0.0, 472.0, 0.0]) / np.linalg.norm(state[3:6] - [0.0, 472.0, 0.0])
    )


def test_a_burn_against_the_motion_is_found_and_followed():
    back = -along(30.0)(0, np.concatenate([COAST, np.zeros(4)]))
    (mean, root), shares, truth = followed(lambda *_: back, 25)
    assert shares[-1, 2] > 0.9
    error = mean[0, :6] - truth[0, :6]
    assert error @ np.linalg.solve(covariance(root)[0, :6, :6], error) < 16.8
    assert mean[0, 6:9] == pytest.approx(back, abs=12.0)


@pytest.mark.parametrize("force", [8.0, 20.0, 35.0])
def test_an_ordinary_stage_is_no_free_burn(force):
    _, shares, _ = followed(along(force), 40)
    assert shares[-1, 2] < 0.02


def test_an_improbable_free_burn_is_not_computed():
    """Once dropped, two modes are updated, as before the dark."""
    _, shares, _ = followed(along(20.0), 60)
    assert shares[-1, 2] == 0.0
    boost = burn_modes.moments(old_burns())
    burns = old_burns()
    assert len(MODES.modes(boost, burns)) == 2
    assert len(MODES.modes(*lit())) == 3
    assert MODES.predicted(boost, burns, 1.0)[1][2][0, 2] == 0.0


def test_looks_that_no_boost_explains_start_a_free_burn():
    """The force turns round in a burn, without a dark spell."""
    first = burn_modes.moments(old_burns()), old_burns()
    forward = along(40.0)(0, np.concatenate([COAST, np.zeros(4)]))
    _, shares, _ = followed(lambda *_: -forward, 15, first=first)
    assert shares[:, 2].max() > 0.5
    _, shares, _ = followed(along(40.0), 15, first=first)
    assert shares[:, 2].max() == 0.0


def test_a_burn_that_began_before_the_first_look_has_moved_its_target():
    _, burns = lit()
    boost, (mean, root, _) = MODES.burning_for(burns, np.array([2.0]), np.array([0.5]))
    force = burns[0][0, 1, 6:9]
    assert mean[0, 1, 3:6] == pytest.approx(COAST[3:] + 2.0 * force)
    assert mean[0, 1, :3] == pytest.approx(COAST[:3] + 2.0 * force)
    # Old uncertainties, that of the force, and that of the ignition.
    spread = covariance(root[:, 1])[0]
    known = 30.0**2 + (2.0 * 10.0) ** 2 + (0.5 * force[1]) ** 2
    assert spread[4, 4] == pytest.approx(known, rel=1e-9)
    assert boost[0] == pytest.approx(burn_modes.moments(Burns(mean, root, burns.share)).mean)


def test_free_burns_leave_other_tracks_unchanged():
    known = [old_burns(2), lit(2)[1], old_burns(1)]
    burns = Burns(*(np.concatenate(columns) for columns in zip(*known, strict=True)))
    _, whole = MODES.predicted(burn_modes.moments(burns), burns, 1.0)
    for row in range(5):
        part = Burns(*(column[[row]] for column in burns))
        _, alone = MODES.predicted(burn_modes.moments(part), part, 1.0)
        used = 3 if burns[2][row, 2] else 2
        assert whole[0][row, :used] == pytest.approx(alone[0][0, :used], rel=1e-9, abs=1e-9)
        assert whole[2][row] == pytest.approx(alone[2][0])
