"""Free flight through the air as `imm` moves it, against the integrator of the scene."""

import numpy as np
import pytest
from opir_estimation import COAST, AtmosphericDescent, ModeEstimates, Motion
from opir_trackers.configs import ImmConfig
from opir_trackers.track_priors import filter_of

from opir_core.flight import Drag, Forces, propagate
from opir_core.interfaces.contexts import TrackerContext

FORCES = Forces(("j2",), Drag(5000.0))


def fall(noise=0.0):
    return AtmosphericDescent(Motion(COAST, noise, Forces(("j2",))), FORCES.drag)


def states():
    """Return states (n, 6) that climb out of the air at 25 to 80 km, and some that come down
    through it.
    """
    rng = np.random.default_rng(1)
    up = rng.normal(size=(12, 3))
    up /= np.linalg.norm(up, axis=1)[:, None]
    velocity = rng.uniform(1200.0, 2500.0, (12, 1)) * np.where(np.arange(12)[:, None] < 9, up, -up)
    velocity += 700.0 * rng.normal(size=(12, 3))
    return np.concatenate([(6.378e6 + rng.uniform(25e3, 80e3, (12, 1))) * up, velocity], axis=1)


@pytest.mark.parametrize("step_s", [1.0, 4.0])
def test_falls_are_those_of_the_integrator(step_s):
    start = states()
    step = np.full(12, step_s)
    reported = fall().propagated(start, step)
    expected = np.concatenate(propagate(start[:, :3], start[:, 3:], step, FORCES), axis=1)
    slowed = np.linalg.norm(
        expected[:, 3:] - propagate(start[:, :3], start[:, 3:], step, Forces(("j2",)))[1], axis=1
    )
    assert slowed.max() > 1.0
    off = np.linalg.norm(reported[:, 3:] - expected[:, 3:], axis=1)
    assert (off < 0.02 * slowed + 1e-4).all()
    # The first half kick stands for the whole second's: of a drag that changes by a share s, s/6 of
    # its effect is left. Up to 2.8 km/s through scale heights of 6 km: 0.08.
    assert (
        np.linalg.norm(reported[:, :3] - expected[:, :3], axis=1) < 0.08 * slowed * step_s + 1e-3
    ).all()


@pytest.mark.parametrize("step_s", [1.0, 0.02])
def test_transitions_are_the_slopes_of_the_fall(step_s):
    start = states()
    step = np.full(12, step_s)
    reported = fall().transition(start, step)
    ahead = np.stack(
        [fall().propagated(start + h, step) for h in np.diag([10.0] * 3 + [0.1] * 3)], axis=2
    )
    back = np.stack(
        [fall().propagated(start - h, step) for h in np.diag([10.0] * 3 + [0.1] * 3)], axis=2
    )
    found = (ahead - back) / np.array([20.0] * 3 + [0.2] * 3)
    still = fall().fall.transition(start, step)
    scale = np.abs(found - still)[:, 3:].max(axis=(1, 2), keepdims=True)
    # A step's middle and its start differ by what the density changes by within half of it: a fifth
    # in a second.
    assert (np.abs(reported - found)[:, 3:] < 0.25 * step_s * scale + 1e-8).all()


def test_the_noise_is_that_of_the_fall_where_there_is_no_air():
    high = states()
    high[:, :3] *= 7.6e6 / np.linalg.norm(high[:, :3], axis=1)[:, None]
    root = fall(0.01).noise_root(np.ones(12), high)
    assert root == pytest.approx(
        np.broadcast_to(Motion(COAST, 0.01, FORCES).noise_root(np.ones(12)), root.shape)
    )
    assert (fall(0.01).noise_root(np.ones(12), states())[:, 3, 3] > root[:, 3, 3]).any()


def test_states_are_the_same_bits_alone_and_among_others():
    start = states()
    step = np.ones(12)
    every = fall().propagated(start, step)
    for row in range(12):
        assert np.array_equal(fall().propagated(start[row : row + 1], step[:1])[0], every[row])


def test_imm_of_a_scene_with_drag_lets_it_slow_what_coasts():
    context = TrackerContext(sensors=(), epoch_us=0, duration_s=1e3, forces=FORCES)
    filter_ = filter_of(ImmConfig(modes="coast"), context)
    start = states()[:9]
    root = np.broadcast_to(np.diag(1.0 / np.repeat([100.0, 10.0], 3)), (9, COAST, COAST))
    boost = (
        np.concatenate([start, np.zeros((9, 4))], axis=1),
        np.broadcast_to(np.eye(10), (9, 10, 10)),
    )
    bank = ModeEstimates(np.tile([0.0, 1.0], (9, 1)), *boost, start, root, np.zeros((9, 3)))
    for _ in range(20):
        bank = filter_.predicted(bank, 1.0)
    expected, free = (
        np.concatenate(propagate(start[:, :3], start[:, 3:], np.full(9, 20.0), forces), axis=1)
        for forces in (FORCES, Forces(("j2",)))
    )
    apart = np.linalg.norm((expected - free)[:, :3], axis=1)
    assert apart.max() > 200.0
    assert (
        np.linalg.norm(bank.coast_mean[:, :3] - expected[:, :3], axis=1) < 0.02 * apart + 0.1
    ).all()


def light(height_m, speed_m_s, count=8):
    """Return states (n, 6) of something light, low and fast, climbing, and its fall."""
    rng = np.random.default_rng(3)
    up = rng.normal(size=(count, 3))
    up /= np.linalg.norm(up, axis=1)[:, None]
    state = np.concatenate(
        [(6.378e6 + height_m) * up, speed_m_s * up + 50.0 * rng.normal(size=(count, 3))], axis=1
    )
    return state, AtmosphericDescent(Motion(COAST, 0.0, Forces(("j2",))), Drag(10.0))


@pytest.mark.parametrize("speed_m_s", [300.0, 3000.0])
def test_drag_stops_what_is_light_and_never_throws_it_back(speed_m_s):
    state, falling = light(8e3, speed_m_s)
    air = np.cross([0.0, 0.0, falling.drag.air_rotation_rad_s], state[:, :3])
    reported = falling.propagated(state, np.ones(8))
    before = state[:, 3:] - air
    after = reported[:, 3:] - air
    assert (np.sum(before * after, axis=1) > 0.0).all()
    assert (np.linalg.norm(after, axis=1) < 0.5 * np.linalg.norm(before, axis=1)).all()
    # w' = -k w² leaves 1 / k t of any speed that was many times as large.
    expected = np.concatenate(
        propagate(state[:, :3], state[:, 3:], np.ones(8), Forces(("j2",), falling.drag)), axis=1
    )
    assert np.linalg.norm(reported[:, 3:] - expected[:, 3:], axis=1).max() < 0.1 * speed_m_s


def test_air_is_that_of_all_heights_a_state_may_have():
    """Mean, best straight line and what it leaves, against 200 000 heights."""
    state, falling = light(40e3, 1000.0, 1)
    root = np.diag(1.0 / np.array([4e3] * 3 + [10.0] * 3))[None]
    reported = falling.about(state, root)
    assert reported.height_sigma_m == pytest.approx([4e3])
    off = np.random.default_rng(5).normal(0.0, 4e3, 200_000)
    moved = np.tile(state, (len(off), 1))
    moved[:, :3] += off[:, None] * state[:, :3] / np.linalg.norm(state[:, :3])
    rate = (
        np.linalg.norm(falling.slowed(moved), axis=1)
        / np.linalg.norm(falling._wind(moved), axis=1) ** 2
    )
    slope = np.cov(rate, off)[0, 1] / 4e3**2
    left = np.std(rate - slope * off)
    found = reported._air(state)
    assert found.rate[0] == pytest.approx(rate.mean(), rel=0.01)
    assert found.slope[0] == pytest.approx(slope, rel=0.1)
    assert found.residual[0] == pytest.approx(left, rel=0.2)


@pytest.mark.parametrize("coefficient_kg_m2", [10.0, 500.0])
def test_no_covariance_explodes_or_collapses_in_thick_air(coefficient_kg_m2):
    forces = Forces(("j2",), Drag(coefficient_kg_m2))
    context = TrackerContext(sensors=(), epoch_us=0, duration_s=1e3, forces=forces)
    filter_ = filter_of(ImmConfig(modes="coast"), context)
    (start, _) = light(9e3, 600.0)
    root = np.broadcast_to(np.diag(1.0 / np.repeat([1000.0, 100.0], 3)), (8, COAST, COAST))
    boost = (
        np.concatenate([start, np.zeros((8, 4))], axis=1),
        np.broadcast_to(np.eye(10), (8, 10, 10)),
    )
    bank = ModeEstimates(np.tile([0.0, 1.0], (8, 1)), *boost, start, root, np.zeros((8, 3)))
    for _ in range(30):
        bank = filter_.predicted(bank, 1.0)
        variance = np.linalg.eigvalsh(filter_.moments(bank)[1])
        assert variance.min() > 1e-2
        assert np.sqrt(variance.max()) < 5e4
