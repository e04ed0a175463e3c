"""Scan patterns: phases in the period, where a sweep stands, and independence of the batch."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from lone_rows import assert_rows_independent

from opir_core.constants import GEOSTATIONARY_RADIUS_M
from opir_core.sensors import AlignedScan
from opir_core.sensors.scan_patterns import SpinSweep, StepStareSweep, scan_pattern

PERIOD_NS = 200_000_000
HALF_ANGLE_RAD = math.radians(10.0)
GEO_AT_0 = np.array([GEOSTATIONARY_RADIUS_M, 0.0, 0.0])

coordinates = st.floats(min_value=-1e9, max_value=1e9)
anything = st.one_of(
    st.floats(min_value=-1e300, max_value=1e300), st.sampled_from([np.nan, np.inf, -np.inf])
)
periods = st.integers(min_value=1, max_value=86_400_000_000_000)
uniforms = st.floats(min_value=0.0, max_value=1.0, exclude_max=True)


def all_patterns(period_ns=PERIOD_NS):
    return (
        AlignedScan(period_ns),
        SpinSweep(period_ns),
        StepStareSweep(period_ns, HALF_ANGLE_RAD, 5, 7),
        StepStareSweep(period_ns, HALF_ANGLE_RAD, 8, 8, is_staring=True),
    )


def beside_nadir(east_rad, north_rad, sensor=GEO_AT_0):
    """Return points seen from a sensor on the +x axis at these angles east and north of nadir, 36
    000 km away.
    """
    east, north = np.broadcast_arrays(np.asarray(east_rad, float), np.asarray(north_rad, float))
    down = 3.6e7
    offset = np.stack(
        [np.full(east.shape, -down), down * np.tan(east), down * np.tan(north)], axis=-1
    )
    return sensor + offset.reshape(-1, 3)


@given(
    periods,
    uniforms,
    st.tuples(coordinates, coordinates, coordinates),
    st.lists(st.tuples(anything, anything, anything), max_size=5),
)
def test_every_phase_is_a_whole_number_of_ns_in_the_period(period_ns, uniform, sensor, targets):
    positions = np.array(targets, dtype=np.float64).reshape(-1, 3)
    for pattern in all_patterns(period_ns):
        phase = pattern.phase_ns(np.array(sensor), positions, uniform)
        assert phase.dtype == np.int64
        assert phase.shape == (len(targets),)
        assert ((phase >= 0) & (phase < period_ns)).all()


@given(
    st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=2, max_size=9), st.data()
)
def test_a_phase_does_not_depend_on_the_rest_of_the_batch(targets, data):
    cut = data.draw(st.integers(min_value=1, max_value=len(targets) - 1))
    for pattern in all_patterns():
        assert_rows_independent(
            lambda positions, pattern=pattern: (pattern.phase_ns(GEO_AT_0, positions, 0.25),),
            np.array(targets),
            rows=(slice(0, cut), slice(cut, None)),
        )


def test_one_sensor_position_stands_for_a_position_each():
    targets = beside_nadir(np.linspace(-0.1, 0.1, 9), np.linspace(0.1, -0.08, 9))
    for pattern in all_patterns():
        phases = pattern.phase_ns(np.tile(GEO_AT_0, (9, 1)), targets, 0.5)
        np.testing.assert_array_equal(pattern.phase_ns(GEO_AT_0, targets, 0.5), phases)


def test_aligned_looks_fall_on_whole_periods():
    assert AlignedScan(PERIOD_NS).phase_ns(
        GEO_AT_0, beside_nadir([0.0, 0.1], 0.05), 0.7
    ).tolist() == [0, 0]


@given(uniforms, st.integers(min_value=0, max_value=3))
def test_another_start_moves_all_looks_alike(uniform, number):
    targets = beside_nadir(np.linspace(-0.1, 0.1, 9), np.linspace(0.1, -0.08, 9))
    pattern = all_patterns()[1:][number % 3]
    moved = (
        pattern.phase_ns(GEO_AT_0, targets, uniform) - pattern.phase_ns(GEO_AT_0, targets, 0.0)
    ) % PERIOD_NS
    np.testing.assert_array_equal(moved, math.floor(uniform * PERIOD_NS))


@pytest.mark.parametrize("number", [1, 2, 3])
def test_places_a_kilometre_apart_have_looks_of_their_own(number):
    pattern = all_patterns()[number]
    north = 0.03 + np.arange(24) * 28e-6
    assert len(set(pattern.phase_ns(GEO_AT_0, beside_nadir(0.02, north), 0.3).tolist())) == 24


def test_staring_arrays_are_read_at_once_from_north_to_south():
    pattern = StepStareSweep(PERIOD_NS, HALF_ANGLE_RAD, 4, 3, is_staring=True)
    share = np.array([0.01, 0.25, 0.5, 0.9])
    for row, east in ((0, -0.04), (2, 0.05), (3, 0.0)):
        north = (1.0 - 2.0 * (row + share) / 4.0) * HALF_ANGLE_RAD
        np.testing.assert_allclose(
            pattern.phase_ns(GEO_AT_0, beside_nadir(east, north), 0.0), share * PERIOD_NS, atol=2
        )


@pytest.mark.parametrize(
    ("east", "north", "turn"),
    [(0, 1, 0.0), (1, 1, 0.125), (1, 0, 0.25), (0, -1, 0.5), (-1, 0, 0.75)],
)
def test_a_spin_begins_in_the_north_and_turns_east(east, north, turn):
    phase = SpinSweep(PERIOD_NS).phase_ns(GEO_AT_0, beside_nadir(0.05 * east, 0.05 * north), 0.0)
    assert abs(int(phase[0]) - turn * PERIOD_NS) <= 1


@given(st.floats(min_value=-math.pi, max_value=math.pi), st.floats(min_value=0.01, max_value=0.15))
def test_a_spin_reaches_neighbours_one_after_another(azimuth_rad, off_nadir):
    step_rad = 1e-4
    angles = np.array([azimuth_rad, azimuth_rad + step_rad])
    targets = beside_nadir(
        np.arctan(off_nadir * np.sin(angles)), np.arctan(off_nadir * np.cos(angles))
    )
    start, end = SpinSweep(PERIOD_NS).phase_ns(GEO_AT_0, targets, 0.0).tolist()
    assert (end - start) % PERIOD_NS == pytest.approx(step_rad / (2 * math.pi) * PERIOD_NS, abs=2)


@given(st.floats(min_value=-180.0, max_value=180.0))
def test_a_spin_does_not_know_longitude(longitude_deg):
    turn = math.radians(longitude_deg)
    rotation = np.array(
        [[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]]
    )
    targets = beside_nadir([0.03, -0.08, 0.1], [0.05, 0.02, -0.11])
    phases, turned = (
        SpinSweep(PERIOD_NS).phase_ns(matrix @ GEO_AT_0, targets @ matrix.T, 0.0)
        for matrix in (np.eye(3), rotation)
    )
    assert np.abs(phases - turned).max() <= 1


def test_a_spin_over_a_pole_counts_from_minus_x():
    # Over the north pole "east" is +y, so "north" is -x.
    sensor = np.array([0.0, 0.0, 4e7])
    phase = SpinSweep(PERIOD_NS).phase_ns(
        sensor, np.array([[-1e6, 0.0, 6e6], [0.0, 1e6, 6e6]]), 0.0
    )
    np.testing.assert_allclose(phase, [0, PERIOD_NS / 4], atol=1)


def test_a_step_stare_goes_through_its_raster_like_a_serpent():
    rows = 3
    columns = 4
    pattern = StepStareSweep(12_000, HALF_ANGLE_RAD, rows, columns)
    centres = (np.arange(columns) + 0.5) / columns * 2 - 1
    heights = 1 - (np.arange(rows) + 0.5) / rows * 2
    east, north = (
        grid.ravel() for grid in np.meshgrid(centres * HALF_ANGLE_RAD, heights * HALF_ANGLE_RAD)
    )
    phase = pattern.phase_ns(GEO_AT_0, beside_nadir(east, north), 0.0).reshape(rows, columns)
    # Cells are 1000 ns long; the line through a cell's centre is read at half of that.
    begun = np.array([[0, 1000, 2000, 3000], [7000, 6000, 5000, 4000], [8000, 9000, 10000, 11000]])
    np.testing.assert_allclose(phase, begun + 500, atol=1)


def test_each_stare_lies_beside_the_one_before():
    rows = 6
    columns = 5
    pattern = StepStareSweep(30_000, HALF_ANGLE_RAD, rows, columns)
    column, row = (grid.ravel() for grid in np.meshgrid(np.arange(columns), np.arange(rows)))
    east = ((column + 0.5) / columns * 2 - 1) * HALF_ANGLE_RAD
    north = (1 - (row + 0.5) / rows * 2) * HALF_ANGLE_RAD
    order = np.argsort(pattern.phase_ns(GEO_AT_0, beside_nadir(east, north), 0.0))
    moves = np.abs(np.diff(row[order])) + np.abs(np.diff(column[order]))
    assert moves.tolist() == [1] * (rows * columns - 1)


def test_targets_off_the_raster_count_to_its_edge():
    pattern = StepStareSweep(40, HALF_ANGLE_RAD, 2, 2)
    beyond = beside_nadir([-0.5, 0.5, 0.5, -0.5], [0.5, 0.5, -0.5, -0.5])
    assert pattern.phase_ns(GEO_AT_0, beyond, 0.0).tolist() == [0, 10, 29, 39]


@pytest.mark.parametrize("phase", ["aligned", "random", "swept"])
@pytest.mark.parametrize(
    ("pattern", "swept"),
    [
        ("spin", SpinSweep(7)),
        ("step-stare", StepStareSweep(7, 0.1, 2, 3)),
        ("staring", StepStareSweep(7, 0.1, 2, 3, True)),
    ],
)
def test_pattern_and_phase_choose_the_scan(pattern, phase, swept):
    scan = scan_pattern(pattern, phase, period_ns=7, half_angle_rad=0.1, rows=2, columns=3)
    assert scan == (AlignedScan(7) if phase == "aligned" else swept)
