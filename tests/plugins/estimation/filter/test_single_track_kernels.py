"""What is worked out for one track, number by number or by LAPACK itself, is what is worked out for
many.
"""

import numpy as np
import pytest
from attrs import evolve
from opir_estimation import (
    BOOST,
    COAST,
    AngleMeasurements,
    ImmFilter,
    LinesOfSight,
    ModeEstimates,
    Motion,
    NewStage,
    Thrust,
    candidates,
    earth_rotated,
    gated,
    tangent_axes,
)
from opir_estimation.filter.thrust import THRUST
from opir_estimation.lines_of_sight import both_earth_rotated, rotate_slightly
from opir_estimation.motion import noise_roots
from opir_estimation.square_root import solved

from opir_core.flight.forces import Forces
from opir_core.interfaces.columns import names_of

FORCES = Forces()
COUNT = 30
END_S = 40.0
FALL = Motion(COAST, 0.01, FORCES)
THRUSTING = Thrust(0.1, 30.0, 3.0, 0.002, FORCES)
STAGE = NewStage(20.0, 10.0, 0.01, 0.01, 40.0, 0.05)
FILTERS = {
    "thrust": ImmFilter(
        THRUSTING, FALL, 150.0, 1000.0, coast_detection=0.01, pause_s=2.0, stage=STAGE
    ),
    "jerk": ImmFilter(Motion(BOOST, 0.3, FORCES), FALL, 150.0, 1000.0),
}
SENSORS_M = 42164e3 * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def bank_of(size: int) -> ModeEstimates:
    """Return tracks that surely burn, surely coast, and anything between; some have been silent."""
    rng = np.random.default_rng(5)
    scale = np.repeat([1e3, 100.0, 5.0, 0.1], 3)[:size]
    root = np.linalg.qr(rng.normal(size=(COUNT, size, size)))[1] + 3.0 * np.eye(size)
    mean = rng.normal(size=(COUNT, size)) * np.repeat([1e5, 2e3, 10.0, 0.01], 3)[:size]
    mean[:, :3] += 6.6e6 * np.array([0.6, 0.64, 0.48])
    burning = np.concatenate([[1.0 - 1e-6, 1e-6], rng.random(COUNT - 2)])
    coast = mean[:, :COAST] + rng.normal(size=(COUNT, COAST))
    pace = rng.uniform([1.0, 1.0, 0.0], [100.0, 20.0, 3.0], (COUNT, 3))
    narrow = root / scale
    weight = np.stack([burning, 1.0 - burning], axis=1)
    return ModeEstimates(weight, mean, narrow, coast, np.array(narrow[:, :COAST, :COAST]), pace)


def sights_of(bank: ModeEstimates, seen: np.ndarray) -> AngleMeasurements:
    """Return ten looks each of two sensors at tracks."""
    rng = np.random.default_rng(6)
    track = np.repeat(seen, 20)
    origin = np.tile(SENSORS_M, (10 * len(seen), 1))
    apart = bank.boost_mean[track, :3] - origin
    axes = tangent_axes(apart / np.linalg.norm(apart, axis=1)[:, None])
    time_s = END_S - np.tile(np.repeat(np.linspace(1.0, 0.0, 10), 2), len(seen))
    return AngleMeasurements(
        track,
        time_s,
        origin,
        axes,
        2e-5 * rng.normal(size=(len(track), 2)),
        np.tile(5e4 * np.eye(2), (len(track), 1, 1)),
    )


def same(one: ModeEstimates, many: ModeEstimates, row: int) -> None:
    for name in names_of(ModeEstimates):
        mine = getattr(one, name)[0]
        theirs = getattr(many, name)[row]
        if name.endswith("root"):
            # Signs of rows are of no account.
            mine = mine.swapaxes(-1, -2) @ mine
            theirs = theirs.swapaxes(-1, -2) @ theirs
            scale = np.sqrt(np.diagonal(theirs, axis1=-2, axis2=-1))
            unit = scale[..., :, None] * scale[..., None, :]
            assert np.allclose(mine / unit, theirs / unit, atol=1e-9), name
        else:
            assert np.allclose(mine, theirs, rtol=1e-9, atol=1e-12), name


@pytest.mark.parametrize("model", list(FILTERS))
def test_a_track_alone_is_followed_as_among_others(model: str) -> None:
    filter_ = FILTERS[model]
    bank = bank_of(filter_.boost.size)
    # One track in three goes unseen.
    seen = np.flatnonzero(np.arange(COUNT) % 3 > 0)
    sights = sights_of(bank, seen)
    moved = filter_.predicted(bank, 1.0)
    after = filter_.updated(moved, END_S, sights, 1.0)
    outlook = filter_.predicted_measurements(after, END_S)
    moments = filter_.moments(after)
    for row in range(COUNT):
        alone = filter_.predicted(bank.take([row]), 1.0)
        same(alone, moved, row)
        mine = sights.take(np.flatnonzero(sights.track == row))
        reported = filter_.updated(
            alone, END_S, evolve(mine, track=np.zeros(len(mine), dtype=np.int64)), 1.0
        )
        same(reported, after, row)
        ahead = filter_.predicted_measurements(reported, END_S)
        known = filter_.moments(reported)
        assert np.allclose(ahead.derivative[0], outlook.derivative[row], rtol=1e-9)
        spread, others = (side @ side.T for side in (ahead.root[0], outlook.root[row]))
        unit = np.sqrt(np.outer(np.diag(others), np.diag(others))) + 1e-30
        assert np.allclose(spread / unit, others / unit, atol=1e-8)
        assert np.allclose(known[0][0], moments[0][row], rtol=1e-9)
        assert np.allclose(known[1][0], moments[1][row], rtol=1e-8, atol=1e-6)


def test_slopes_and_noise_of_one_thrust_are_those_of_many() -> None:
    state = bank_of(THRUST).boost_mean
    step = np.full(COUNT, -1.0)
    slopes = THRUSTING.slopes(state)
    noise = THRUSTING.noise_root(step, state)
    for row in range(COUNT):
        one = state[[row]]
        assert np.allclose(THRUSTING.slopes(one)[0], slopes[row], rtol=1e-10, atol=1e-16)
        assert np.allclose(THRUSTING.noise_root(step[:1], one)[0], noise[row], rtol=1e-12)


def test_rays_are_gated_for_one_track_as_among_others() -> None:
    filter_ = FILTERS["thrust"]
    bank = bank_of(THRUST)
    outlook = filter_.predicted_measurements(bank, END_S)
    rng = np.random.default_rng(7)
    time_s = END_S - np.sort(rng.uniform(0.0, 1.0, COUNT))[::-1]
    apart = outlook.positions(np.arange(COUNT), time_s) - SENSORS_M[0]
    direction = apart / np.linalg.norm(apart, axis=1)[:, None] + 2e-5 * rng.normal(size=(COUNT, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    rays = LinesOfSight(
        time_s,
        np.zeros(COUNT, dtype=np.int32),
        np.arange(COUNT),
        np.tile(SENSORS_M[0], (COUNT, 1)),
        direction,
        np.full(COUNT, 2e-5),
    )
    whole = gated(outlook, rays, *candidates(outlook, rays, 1.0, 4.5, True), 4.5, True)
    assert len(whole) > COUNT // 2
    for row in range(COUNT):
        lone = filter_.predicted_measurements(bank.take([row]), END_S)
        pairs = gated(lone, rays, *candidates(lone, rays, 1.0, 4.5, True), 4.5, True)
        mine = whole.take(np.flatnonzero(whole.track == row))
        assert np.array_equal(pairs.line, mine.line)
        assert np.allclose(pairs.distance, mine.distance, rtol=1e-6, atol=1e-9)
        assert np.allclose(pairs.log_volume, mine.log_volume, rtol=1e-9)


def test_a_slight_turn_is_that_of_a_later_time() -> None:
    rng = np.random.default_rng(11)
    place = 42164e3 * rng.normal(size=(20, 3))
    time_s = rng.uniform(0.0, 2e4, 20)
    later_s = rng.uniform(-0.1, 0.1, 20)
    both = both_earth_rotated(place, place[::-1], time_s)
    rotate_slightly(both, later_s)
    exact = both_earth_rotated(place, place[::-1], time_s + later_s)
    assert np.linalg.norm(both - exact, axis=2).max() < 4e-11 * np.linalg.norm(place, axis=1).max()
    assert np.array_equal(exact[0], earth_rotated(place, time_s + later_s))


def test_stored_noise_of_a_step_is_read_only() -> None:
    step = np.ones(1)
    with pytest.raises(ValueError, match="read-only"):
        noise_roots(step, 2)[0, 0, 0] = 0.0
    # What a motion returns is the caller's own.
    state = bank_of(THRUST).boost_mean[:1]
    for motion in (FALL, THRUSTING):
        root = motion.noise_root(step, state)
        root[:] = 0.0
        assert np.any(motion.noise_root(step, state))


@pytest.mark.parametrize("count", [1, 4])
def test_equations_are_solved_and_singular_ones_refused(count: int) -> None:
    rng = np.random.default_rng(52)
    matrix = rng.normal(size=(count, 3, 3)) + 3.0 * np.eye(3)
    right = rng.normal(size=(count, 3))
    product = np.einsum("nij,nj->ni", matrix, solved(matrix, right))
    assert product == pytest.approx(right, abs=1e-12)
    with pytest.raises(np.linalg.LinAlgError):
        solved(np.zeros_like(matrix), right)
