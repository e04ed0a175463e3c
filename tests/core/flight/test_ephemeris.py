"""Piecewise polynomials: within their tolerance, nothing outside their span, the same alone and in
a crowd.
"""

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from lone_rows import assert_rows_independent

from examples import examples
from opir_core import ModelError
from opir_core.flight import Ephemeris

RATE = np.array([1e-3, 2e-3, 5e-4])
RADIUS = np.array([7e6, 6.6e6, 4.2e7])


def circling(target, time_s):
    """Circles of three sizes and speeds."""
    angle = RATE[target] * time_s
    radius = RADIUS[target]
    position = np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), 1e3 * target + 0.0 * angle], axis=1
    )
    speed = radius * RATE[target]
    return position, np.stack([-speed * np.sin(angle), speed * np.cos(angle), 0.0 * angle], axis=1)


def falling_from(break_s):
    """Return the motion of a body that is let go at a time."""

    def motion(target, time_s):
        fall = np.maximum(time_s - break_s[target], 0.0)
        zero = np.zeros_like(fall)
        return np.stack([zero, zero, -4.9 * fall**2], axis=1), np.stack(
            [zero, zero, -9.8 * fall], axis=1
        )

    return motion


def three_circles(tolerance_m=0.01):
    return Ephemeris.build(
        circling, [0.0, -500.0, 1e4], [3000.0, 2000.0, 9e4], tolerance_m=tolerance_m
    )


def times_within(ephemeris, target, rng):
    return (
        ephemeris.start_s[target]
        + rng.random(len(target)) * (ephemeris.end_s - ephemeris.start_s)[target]
    )


@pytest.mark.parametrize("tolerance_m", [100.0, 1.0, 0.01, 1e-4, 1e-6])
def test_positions_are_within_the_tolerance(tolerance_m):
    ephemeris = three_circles(tolerance_m)
    rng = np.random.default_rng(5)
    target = rng.integers(0, 3, 200_000)
    times = times_within(ephemeris, target, rng)
    error = np.linalg.norm(ephemeris.position_m(target, times) - circling(target, times)[0], axis=1)
    assert tolerance_m / 100.0 < error.max() <= tolerance_m


def test_velocities_are_derivatives_of_the_positions():
    ephemeris = three_circles()
    rng = np.random.default_rng(6)
    target = rng.integers(0, 3, 1000)
    times = times_within(ephemeris, target, rng)
    position, velocity = ephemeris.state(target, times)
    assert position.tobytes() == ephemeris.position_m(target, times).tobytes()
    np.testing.assert_allclose(velocity, circling(target, times)[1], atol=1e-3)


def test_position_and_velocity_do_not_jump_between_segments():
    ephemeris = three_circles(1.0)
    segments = ephemeris.segments
    inner = np.flatnonzero(segments.target[1:] == segments.target[:-1])
    edge = segments.end_s[inner]
    start, end = (
        ephemeris.state(segments.target[inner], t) for t in (np.nextafter(edge, -np.inf), edge)
    )
    assert len(inner) > 5
    np.testing.assert_allclose(start[0], end[0], atol=1e-6)
    np.testing.assert_allclose(start[1], end[1], atol=1e-6)


def test_both_ends_belong_to_the_span_and_nothing_beyond():
    ephemeris = three_circles()
    everyone = np.arange(3)
    for edge, outward in ((ephemeris.start_s, -np.inf), (ephemeris.end_s, np.inf)):
        np.testing.assert_allclose(
            ephemeris.position_m(everyone, edge), circling(everyone, edge)[0], atol=1e-6
        )
        assert np.isnan(ephemeris.position_m(everyone, np.nextafter(edge, outward))).all()
    for time in (np.nan, np.inf, -np.inf, 1e300, -1e300):
        position, velocity = ephemeris.state(everyone, time)
        assert np.isnan(position).all()
        assert np.isnan(velocity).all()


def test_targets_and_times_broadcast():
    ephemeris = three_circles()
    times = np.linspace(0.0, 3000.0, 7)
    grid = ephemeris.position_m(np.arange(3)[:, None], times)
    assert grid.shape == (3, 7, 3)
    assert ephemeris.position_m(1, 5.0).shape == (3,)
    assert ephemeris.position_m(np.zeros((0,), dtype=int), 5.0).shape == (0, 3)
    assert ephemeris.position_m(np.int32(1), times[3]).tobytes() == grid[1, 3].tobytes()


def test_a_point_is_the_same_in_any_company():
    """Long runs, short runs, single points and blocks of every length give the same bytes."""
    ephemeris = three_circles()
    rng = np.random.default_rng(7)
    times = np.sort(rng.uniform(-600.0, 3100.0, 140_001))
    target = np.repeat([0, 1, 2, 0], [60_000, 40_000, 20_000, 20_001])
    rows = [slice(59_990, 59_990 + size) for size in (1, 2, 3, 17, 4097, 65537)]
    rows.append(rng.permutation(len(times)))
    assert_rows_independent(
        lambda *point: (ephemeris.position_m(*point),), target, times, rows=rows
    )


def test_a_target_is_the_same_whoever_else_is_in_the_ephemeris():
    ephemeris = three_circles()
    times = np.linspace(-500.0, 2000.0, 999)
    alone = Ephemeris.build(
        lambda target, t: circling(target + 1, t), -500.0, 2000.0, tolerance_m=0.01
    )
    assert alone.position_m(0, times).tobytes() == ephemeris.position_m(1, times).tobytes()


def test_breakpoints_keep_what_is_not_smooth_apart():
    break_s = np.array([10.0, 33.3, 90.0])
    motion = falling_from(break_s)
    with_break = Ephemeris.build(motion, np.zeros(3), 100.0, break_s[:, None], tolerance_m=1e-3)
    without = Ephemeris.build(motion, np.zeros(3), 100.0, tolerance_m=1e-3)
    assert len(with_break.segments) == 6
    assert len(without.segments) > 20
    times = np.linspace(0.0, 100.0, 10_001)
    for target in range(3):
        expected = motion(np.full(10_001, target), times)[0]
        for ephemeris in (with_break, without):
            np.testing.assert_allclose(ephemeris.position_m(target, times), expected, atol=1e-3)


def test_breakpoints_outside_the_span_do_no_harm():
    motion = falling_from(np.array([-5.0]))
    ephemeris = Ephemeris.build(motion, [0.0], [10.0], [[-5.0, 0.0, 10.0, 99.0]], tolerance_m=1e-3)
    assert len(ephemeris.segments) == 1


def test_parts_join_where_one_ends_and_the_next_starts():
    cuts = np.array([[0.0, 500.0, 3000.0], [-500.0, 0.0, 2000.0], [1e4, 1.5e4, 9e4]]).T
    ephemerides = [
        Ephemeris.build(circling, a, b, tolerance_m=t)
        for a, b, t in zip(cuts, cuts[1:], (0.01, 0.1), strict=False)
    ]
    ephemeris = Ephemeris.joined(ephemerides)
    assert ephemeris.tolerance_m == 0.1
    assert ephemeris.start_s.tolist() == cuts[0].tolist()
    assert ephemeris.end_s.tolist() == cuts[2].tolist()
    rng = np.random.default_rng(8)
    target = rng.integers(0, 3, 10_000)
    times = times_within(ephemeris, target, rng)
    np.testing.assert_allclose(
        ephemeris.position_m(target, times), circling(target, times)[0], atol=0.1
    )


def test_parts_that_do_not_meet_are_refused():
    start, end = (Ephemeris.build(circling, a, b) for a, b in ((0.0, 10.0), (10.5, 20.0)))
    with pytest.raises(ValueError, match="must start when the one before it ends"):
        Ephemeris.joined([start, end])


@pytest.mark.parametrize("span", [(1.0, 1.0), (2.0, 1.0), (np.nan, 1.0), (0.0, np.inf)])
def test_spans_that_are_none_are_refused(span):
    with pytest.raises(ValueError, match="must start before it ends"):
        Ephemeris.build(circling, *span)


@pytest.mark.parametrize("tolerance_m", [0.0, -1.0, np.nan])
def test_tolerances_that_are_none_are_refused(tolerance_m):
    with pytest.raises(ValueError, match="tolerance of an ephemeris must be above zero"):
        Ephemeris.build(circling, 0.0, 1.0, tolerance_m=tolerance_m)


def test_a_motion_that_is_not_finite_is_reported():
    def gap(target, time_s):
        position, velocity = circling(target, time_s)
        position[time_s > 70.0] = np.nan
        return position, velocity

    with pytest.raises(ModelError, match=r"motion of target 0 is not finite at 100\.0 s"):
        Ephemeris.build(gap, 0.0, 100.0)


def test_a_motion_too_rough_for_the_tolerance_is_reported():
    def jump(target, time_s):
        position, velocity = circling(target, time_s)
        return position + (time_s > 40.0)[:, None], velocity

    with pytest.raises(
        ModelError, match=r"motion of target 0 near 4\d\.\d+ s cannot be followed to within 0\.01 m"
    ):
        Ephemeris.build(jump, 0.0, 100.0)


@pytest.mark.parametrize("target", [-1, 3, [0, 1, 3]])
def test_targets_that_are_none_are_refused(target):
    with pytest.raises(IndexError, match="outside 0 to 2"):
        three_circles().position_m(target, 5.0)


def test_times_a_nanosecond_apart_are_distinguished():
    ephemeris = three_circles()
    times = 1000.0 + 1e-9 * np.arange(1000)
    step = np.diff(ephemeris.position_m(0, times)[:, 1])
    assert (step > 0.0).mean() > 0.99
    assert step.mean() == pytest.approx(7e3 * np.cos(1.0) * 1e-9, rel=1e-3)


@examples(60)
@given(
    starts=st.lists(st.floats(-1e5, 1e5), min_size=1, max_size=4),
    lengths=st.lists(st.floats(1e-3, 1e4), min_size=4, max_size=4),
    breaks=st.lists(st.floats(-1e5, 1e5), max_size=3),
    tolerance_m=st.sampled_from([1.0, 1e-2, 1e-5]),
)
@example(starts=[-2.3e-309], lengths=[1.0, 1.0, 1.0, 1.0], breaks=[0.0], tolerance_m=1.0)
@example(
    starts=[-1.0], lengths=[1.0, 1.0, 1.0, 1.0], breaks=[-2.3e-309, -5e-10, -0.5], tolerance_m=1e-5
)
@example(
    starts=[0.0],
    lengths=[1.0, 1.0, 1.0, 1.0],
    breaks=[0.3, 0.3 + 1e-12, 0.3 + 1e-10],
    tolerance_m=1e-5,
)
def test_any_spans_and_breaks(starts, lengths, breaks, tolerance_m):
    start = np.array(starts)
    end = start + np.array(lengths[: len(starts)])
    cuts = np.tile(breaks, (len(starts), 1)) if breaks else None

    def motion(target, time_s):
        return circling(target % 3, time_s)

    ephemeris = Ephemeris.build(motion, start, end, cuts, tolerance_m)
    target = np.repeat(np.arange(len(starts)), 101)
    times = (
        (start[:, None] + np.linspace(0.0, 1.0, 101) * (end - start)[:, None])
        .ravel()
        .clip(max=end[target])
    )
    error = np.linalg.norm(ephemeris.position_m(target, times) - motion(target, times)[0], axis=1)
    assert error.max() <= tolerance_m
