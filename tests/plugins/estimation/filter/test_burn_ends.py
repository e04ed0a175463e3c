"""The state at the last look of a burn by all of its looks, against rockets flown by a script of its
own: constant thrust and mass flow, a kick, and thrust along the velocity but for a lead.
"""

import numpy as np
import pytest
from opir_estimation import (
    AngleMeasurements,
    BurnEnd,
    BurnPrior,
    FreeBurn,
    FreeThrust,
    ImmFilter,
    ModeEstimates,
    Motion,
    NewStage,
    Thrust,
    burn_end,
    tangent_axes,
)
from opir_estimation.filter.switching import CONTRADICTION

from opir_core.flight import Forces

MU = 3.986004418e14
SPIN = np.array([0.0, 0.0, 7.292115e-5])
GEO_M = 4.2164e7
SIGMA_RAD = 20e-6
STEP_S = 0.1

MOTION = Thrust(np.radians(3.0), 30.0, 0.5, 1e-3, Forces(zonal=()))
STAGE = NewStage(20.0, 10.0, 0.01, 0.01, 40.0, np.tan(np.radians(3.0)))


def acceleration(time_s, stages):
    """Return thrust over mass, m/s², of stages: ignition, burn time, first acceleration and growth."""
    for ignition_s, burn_s, first, growth in stages:
        share = (time_s - ignition_s) / burn_s
        if 0.0 <= share <= 1.0:
            return first / (1.0 - (1.0 - 1.0 / growth) * share)
    return 0.0


def flown(stages, kick_rad=0.2, lead_rad=0.0, late_rad=0.0):
    """Return times and inertial states (n, 6) of a launch at the equator, with a lead above the
    velocity, and one more that grows over the last 15 s.
    """
    end_s = stages[-1][0] + stages[-1][1]
    time_s = np.arange(0.0, end_s + 0.5 * STEP_S, STEP_S)
    state = np.array([6.378e6, 0.0, 0.0, 0.0, 0.0, 0.0])
    state[3:] = np.cross(SPIN, state[:3])
    states = [state]

    def rates(at_s, now):
        up = now[:3] / np.linalg.norm(now[:3])
        axis = up
        air = now[3:] - np.cross(SPIN, now[:3])
        if at_s > 8.0:
            axis = air / np.linalg.norm(air)
            across = np.array([0.0, 0.6, 0.8])
            across -= axis * (across @ axis)
            turn = kick_rad * np.sin(np.pi * min((at_s - 8.0) / 10.0, 1.0)) ** 2 - lead_rad
            turn -= late_rad * max(1.0 - (end_s - at_s) / 15.0, 0.0)
            axis = axis + np.tan(turn) * across / np.linalg.norm(across)
        pull = -MU / (now[:3] @ now[:3]) ** 1.5 * now[:3]
        push = acceleration(at_s, stages) * axis / np.linalg.norm(axis)
        return np.concatenate([now[3:], pull + push])

    for at_s in time_s[:-1]:
        a = rates(at_s, state)
        b = rates(at_s + 0.5 * STEP_S, state + 0.5 * STEP_S * a)
        c = rates(at_s + 0.5 * STEP_S, state + 0.5 * STEP_S * b)
        d = rates(at_s + STEP_S, state + STEP_S * c)
        state = state + STEP_S / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        states.append(state)
    return time_s, np.array(states)


def looks_of(time_s, states, rng, sensors=(-0.5, 0.6), every=2):
    """Return the looks of fixed sensors on states, each with noise."""
    parts = []
    for longitude in sensors:
        rows = np.arange(every, len(time_s), every)
        origin = GEO_M * np.array([np.cos(longitude), np.sin(longitude), 0.0])
        line = states[rows, :3] - origin
        direction = line / np.linalg.norm(line, axis=1)[:, None]
        count = len(rows)
        parts.append(
            AngleMeasurements(
                np.zeros(count, dtype=np.int64),
                time_s[rows],
                np.tile(origin, (count, 1)),
                tangent_axes(direction),
                SIGMA_RAD * rng.normal(size=(count, 2)),
                np.tile(np.eye(2) / SIGMA_RAD, (count, 1, 1)),
            )
        )
    looks = AngleMeasurements.concatenate(parts)
    return looks.take(np.argsort(looks.time_s, kind="stable"))


def reference_of(time_s, states, rng):
    """Return states (m, 9) once a second, as far off as those of a filter."""
    rows = np.arange(0, len(time_s), round(1.0 / STEP_S))
    mean = np.zeros((len(rows), 9))
    mean[:, :6] = states[rows] + rng.normal(size=(len(rows), 6)) * np.repeat([150.0, 40.0], 3)
    mean[:, 6:] = 30.0 * states[rows, :3] / np.linalg.norm(states[rows, :3], axis=1)[:, None]
    return time_s[rows], mean


def ended(stages, seed, **how):
    """Return the end of a burn that a seed's looks give, and the true state then."""
    rng = np.random.default_rng(seed)
    time_s, states = flown(stages, **how)
    looks = looks_of(time_s, states, rng)
    end = burn_end(looks, *reference_of(time_s, states, rng), BurnPrior(MOTION, STAGE, 0.0))
    truth = states[np.argmin(np.abs(time_s - end.time_s))]
    return end, truth


def drawn(stages, rng):
    """Return stages drawn about those of small rockets."""
    drawn_stages = []
    ignition_s = 0.0
    for _ in range(stages):
        burn_s = rng.uniform(35.0, 65.0) if stages > 1 else rng.uniform(60.0, 100.0)
        stage = ignition_s, burn_s, rng.uniform(16.0, 28.0), rng.uniform(1.6, 4.0)
        drawn_stages.append(stage)
        ignition_s += burn_s
    return drawn_stages


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stages", "lead_rad", "late_rad"),
    [(1, 0.0, 0.0), (2, 0.0, 0.0), (1, 0.12, 0.0), (1, 0.0, 0.15)],
)
def test_ends_of_burns_are_as_sure_as_they_say(stages, lead_rad, late_rad):
    """With thrust along the velocity, with a lead of 7 degrees for the whole burn, and with one that
    grows to 9 degrees at its end.
    """
    rng = np.random.default_rng(3 + stages)
    scores = []
    sigmas = []
    for seed in range(8):
        end, truth = ended(drawn(stages, rng), seed, lead_rad=lead_rad, late_rad=late_rad)
        error = (end.mean - np.append(truth, [0.0] * 3))[3:6]
        velocity = end.covariance[3:6, 3:6]
        scores.append(error @ np.linalg.solve(velocity, error) / 3.0)
        sigmas.append(np.sqrt(np.trace(velocity)))
    # 99.9 % of χ² with 24 degrees of freedom, over 24, is at most 2.14.
    assert 0.1 < np.mean(scores) < 2.14
    # The filter that follows a burn has 80 m/s.
    assert np.median(sigmas) < 60.0


def test_the_force_at_the_end_is_that_of_the_last_stage():
    end, _ = ended([(0.0, 60.0, 18.0, 3.0), (60.0, 50.0, 14.0, 1.8)], 5)
    force = np.linalg.norm(end.mean[6:])
    assert force == pytest.approx(14.0 * 1.8, rel=0.25)


def test_a_look_elsewhere_does_not_move_the_end():
    rng = np.random.default_rng(1)
    time_s, states = flown([(0.0, 80.0, 22.0, 3.0)])
    looks = looks_of(time_s, states, rng)
    reference = reference_of(time_s, states, rng)
    prior = BurnPrior(MOTION, STAGE, 0.0)
    end = burn_end(looks, *reference, prior)
    looks.measured[-30] += 1e-3
    moved = burn_end(looks, *reference, prior)
    # It is 50 standard deviations off.
    sigma = np.sqrt(np.diagonal(end.covariance))
    assert np.all(np.abs(moved.mean - end.mean) < sigma)


def test_one_sensor_alone_knows_less():
    rng = np.random.default_rng(2)
    time_s, states = flown([(0.0, 80.0, 22.0, 3.0)])
    reference = reference_of(time_s, states, rng)
    prior = BurnPrior(MOTION, STAGE, 0.0)
    two, one = (
        burn_end(looks_of(time_s, states, np.random.default_rng(3), sensors), *reference, prior)
        for sensors in ((-0.5, 0.6), (-0.5,))
    )
    assert np.isfinite(one.covariance).all()
    assert np.trace(one.covariance[3:6, 3:6]) > 4.0 * np.trace(two.covariance[3:6, 3:6])
    error = (one.mean[:6] - states[np.argmin(np.abs(time_s - one.time_s))])[3:]
    assert error @ np.linalg.solve(one.covariance[3:6, 3:6], error) < 16.3


@pytest.mark.parametrize("ignition_s", [0.0, 75.0])
def test_a_short_burn_stays_as_the_filter_has_it(ignition_s):
    """80 s of looks, of which those after a late ignition count; and a few."""
    rng = np.random.default_rng(4)
    time_s, states = flown([(0.0, 80.0, 22.0, 3.0)])
    every = 2 if ignition_s else 200
    looks = looks_of(time_s, states, rng, sensors=(-0.5,), every=every)
    prior = BurnPrior(MOTION, STAGE, ignition_s)
    assert burn_end(looks, *reference_of(time_s, states, rng), prior) is None


def test_sensors_that_contradict_one_another_do_not_tell_the_end():
    """One of them points 60 standard deviations beside the target: no path is near any look."""
    rng = np.random.default_rng(6)
    time_s, states = flown([(0.0, 80.0, 22.0, 3.0)])
    looks = looks_of(time_s, states, rng)
    looks.measured[looks.origin_m[:, 1] > 0.0] += 60.0 * SIGMA_RAD
    prior = BurnPrior(MOTION, STAGE, 0.0)
    assert burn_end(looks, *reference_of(time_s, states, rng), prior) is None


def filter_and_estimates():
    """Return a filter, and two tracks that have coasted for 2 s since their last looks."""
    forces = Forces(zonal=())
    free = FreeBurn(FreeThrust(2.5, 1e-3, forces), 22.0, 0.1, 300.0, 10.0)
    kind = {"scan_s": 0.1, "coast_detection": 0.01, "residual_share": 0.05}
    imm = ImmFilter(MOTION, Motion(6, 0.01, forces), 150.0, 1e3, stage=STAGE, free=free, **kind)
    mean = np.tile([7e6, 0.0, 0.0, 0.0, 3e3, 0.0, 0.0, 40.0, 0.0, 0.01], (2, 1))
    root = np.tile(np.diag(1.0 / np.repeat([300.0, 80.0, 10.0, 0.01], [3, 3, 3, 1])), (2, 1, 1))
    coast = mean[:, :6].copy(), root[:, :6, :6].copy()
    rate = np.tile([20.0, 2.0, 2.0], (2, 1))
    return imm, ModeEstimates(np.tile([0.0, 1.0], (2, 1)), mean, root, *coast, rate)


def test_coasts_begin_at_the_end_of_their_burn_unless_it_contradicts_the_filter():
    imm, estimates = filter_and_estimates()
    covariance = np.diag(np.repeat([30.0, 20.0, 3.0], 3) ** 2)
    mean = estimates.boost_mean[0, :9].copy()
    # 2 s before, and a velocity that is off by 30 m/s.
    mean[:3] -= 2.0 * mean[3:6]
    mean[4] += 30.0
    near = BurnEnd(8.0, mean, covariance)
    far = near._replace(mean=mean + np.repeat([0.0, np.sqrt(CONTRADICTION) * 80.0, 0.0], 3))
    after = imm.with_burn_ends(estimates, {0: near, 1: far}, 10.0)
    assert np.array_equal(after.coast_mean[1], estimates.coast_mean[1])
    assert np.array_equal(after.coast_root[1], estimates.coast_root[1])
    # Half a pause of 0.1 s of thrust, and what gravity did in 2 s.
    assert after.coast_mean[0, 4] == pytest.approx(3030.0 + 0.05 * 40.0, abs=0.5)
    sigma = np.sqrt(np.diagonal(np.linalg.inv(after.coast_root[0].T @ after.coast_root[0])))
    # Along the force what is left of it acts too: 5 % of 40 m/s² over 5 s, of which 2 have passed.
    assert sigma[3] == pytest.approx(20.0, rel=0.01)
    assert sigma[4] == pytest.approx(np.hypot(20.0, 0.05 * 40.0 * np.sqrt(10.0)), rel=0.02)
