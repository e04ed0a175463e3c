"""What `imm` reports of its estimates and keeps of its lines, against closed forms and finite
differences.
"""

import numpy as np
import pytest
from attrs import evolve
from opir_estimation import (
    AngleMeasurements,
    LinesOfSight,
    ModeEstimates,
    earth_rotated,
    emission_s,
    no_lines_of_sight,
    tangent_axes,
)
from opir_estimation.lines_of_sight import rotate_slightly
from opir_forecast import LaunchForecasts
from opir_testing.doubles import stub_window
from opir_trackers.imm.report import (
    ReportedTracks,
    earth_fixed,
    mixed_with,
    tracks_of,
    type_evidence,
)
from opir_trackers.imm.state import SharedDetections, TrackTable
from opir_trackers.onset.motion_statistics import MotionStatistics
from opir_trackers.sensors import LineOfSightCache
from scipy.spatial.transform import Rotation

from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import EARTH_ROTATION_RAD_S, SPEED_OF_LIGHT_M_S
from opir_core.plugin import Detections

SPIN = np.array([0.0, 0.0, EARTH_ROTATION_RAD_S])


def covariances(count: int, size: int, seed: int = 1) -> FloatArray:
    side = np.random.default_rng(seed).normal(size=(count, size, size))
    return side @ side.transpose(0, 2, 1) + np.eye(size)


def table_of(number: IntArray, time_s: float, sensors: int) -> TrackTable:
    """Return the table of new tracks, without estimates."""
    nothing = ModeEstimates.empty(), MotionStatistics.empty()
    return TrackTable.fresh(number, time_s, sensors, *nothing)


def in_ecef(state: FloatArray, time_s: float) -> FloatArray:
    """Return an inertial state (6,) in the frame that turns with the Earth."""
    back = Rotation.from_rotvec(-SPIN * time_s)
    return np.concatenate(
        [back.apply(state[:3]), back.apply(state[3:] - np.cross(SPIN, state[:3]))]
    )


@pytest.mark.parametrize("time_s", [0.0, 700.0, 40_000.0])
def test_states_are_reported_over_the_rotating_earth(time_s: float) -> None:
    rng = np.random.default_rng(2)
    state = rng.normal(size=(4, 6)) * np.repeat([6.5e6, 3e3], 3)
    sigma = np.repeat([1e3, 10.0], 3)
    spread = covariances(4, 6) * np.outer(sigma, sigma)
    reported, covariance = earth_fixed(state, spread, time_s)
    for row in range(4):
        assert reported[row] == pytest.approx(in_ecef(state[row], time_s), rel=1e-9, abs=1e-5)
        # Linear: a difference of any length is the slope.
        slope = np.stack([in_ecef(axis, time_s) for axis in np.eye(6)], axis=1)
        assert covariance[row] == pytest.approx(slope @ spread[row] @ slope.T, rel=1e-9, abs=1e-3)


def test_tracks_have_the_numbers_and_launches_of_their_rows() -> None:
    table = table_of(np.array([3, 5, 8]), 12.0, 2)
    launch = np.arange(9.0).reshape(3, 3)
    table = evolve(table, launch=launch, launch_covariance=covariances(3, 3))
    no_track = np.zeros(3, dtype=np.bool_)
    moments = np.ones((3, 6)), covariances(3, 6)
    end = np.zeros(3, dtype=np.uint8)
    reported = ReportedTracks(20.0, table, *moments, no_track, np.zeros((3, 0)), end)
    unknown = np.full(3, np.nan)
    forecasts = LaunchForecasts.without_impacts(np.zeros((3, 0)), *[unknown] * 4)
    launched = np.array([True, True, False])
    types = {"type_probability": np.zeros((3, 4))}
    tracks = tracks_of(reported, forecasts, launched, types)
    assert tracks.track.tolist() == [3, 5, 8]
    assert np.array_equal(tracks.launch[:2], launch[:2])
    assert np.array_equal(tracks.launch_covariance[:2], covariances(3, 3)[:2])
    assert np.isnan(tracks.launch[2]).all()
    assert np.isnan(tracks.launch_covariance[2]).all()
    assert tracks.tick_s.tolist() == [20.0] * 3


def test_a_mixture_has_the_moments_of_its_parts() -> None:
    """Of rows 0 and 2 with others; row 1 stays."""
    rng = np.random.default_rng(4)
    state = rng.normal(size=(3, 6))
    other = rng.normal(size=(2, 6))
    spread = covariances(3, 6)
    other_spread = covariances(2, 6, seed=5)
    share = np.array([0.3, 0.9])
    rows = np.array([0, 2])
    mean, covariance = mixed_with(state, spread, rows, (other, other_spread), share)
    for place, row in enumerate(rows.tolist()):
        parts = np.stack([state[row], other[place]])
        weight = np.array([1.0 - share[place], share[place]])
        expected = weight @ parts
        second = np.einsum("k,kij->ij", weight, [spread[row], other_spread[place]])
        second = second + (parts - expected).T @ np.diag(weight) @ (parts - expected)
        assert mean[row] == pytest.approx(expected)
        assert covariance[row] == pytest.approx(second)
    assert np.array_equal(mean[1], state[1])
    assert np.array_equal(covariance[1], spread[1])


@pytest.mark.parametrize("count", [1, 3])
def test_a_table_counts_the_lines_of_its_rows(count: int) -> None:
    """First and last detection, hits, and what each sensor reported last."""
    table = table_of(np.arange(count) + 7, 0.0, 3)
    owner = np.array([0, 2, -1, 0, 2, 0, -1]) if count == 3 else np.array([0, -1, -1, 0, -1, 0, -1])
    time_s = np.array([1.0, 1.5, 1.7, 2.0, 2.5, 3.0, 9.0])
    sensor = np.array([2, 1, 0, 2, 0, 1, 0])
    kind = np.array([0, 1, 2, 1, 2, 0, 3])
    after = table.with_detections(owner, time_s, sensor, kind)
    for row in range(count):
        mine = np.flatnonzero(owner == row)
        assert after.hits[row] == len(mine)
        if not len(mine):
            assert (after.first_s[row], after.seen_s[row]) == (np.inf, -np.inf)
            continue
        assert (after.first_s[row], after.seen_s[row]) == (time_s[mine[0]], time_s[mine[-1]])
        reports = [-1, -1, -1]
        for line in mine.tolist():
            reports[sensor[line]] = kind[line]
        assert after.reports[row].tolist() == reports
    more = after.with_detections(np.array([0]), np.array([4.0]), np.array([2]), np.array([3]))
    assert (more.hits[0], more.seen_s[0], more.first_s[0]) == (after.hits[0] + 1, 4.0, 1.0)
    assert more.reports[0, 2] == 3


def test_sightings_are_kept_as_long_as_their_sensors_say() -> None:
    lines = lines_of(np.array([1.0, 2.0, 3.0]), np.array([0, 1, 0]))
    number = np.array([4, 9])
    owner = np.array([1, 0, -1])
    memory_s = np.array([2.0, 10.0])
    kept = SharedDetections.empty().after(
        SharedDetections.of(number, owner, lines), 3.0, memory_s, first=100
    )
    assert kept.number.tolist() == [9, 4]
    assert kept.sensor.tolist() == [0, 1]
    later = kept.after(SharedDetections.empty(), 5.0, memory_s, first=100)
    assert later.number.tolist() == [4]


def lines_of(time_s: FloatArray, sensor: np.ndarray) -> LinesOfSight:
    count = len(time_s)
    origin = np.tile([4.2e7, 0.0, 0.0], (count, 1))
    direction = np.tile([-1.0, 0.0, 0.0], (count, 1))
    return LinesOfSight(
        time_s, sensor.astype(np.int32), np.arange(count), origin, direction, np.full(count, 2e-5)
    )


def test_the_evidence_of_types_is_the_sum_over_sensors_of_their_last_reports() -> None:
    rng = np.random.default_rng(6)
    log = rng.normal(size=(3, 5, 4))
    log[:, -1] = 0.0
    reports = np.array([[0, 2, -1], [-1, -1, 3]])
    expected = [log[0, 0] + log[1, 2], log[2, 3]]
    assert type_evidence(reports, log) == pytest.approx(np.array(expected))


CHANGED = (
    "time_ns",
    "sensor",
    "scan",
    "line_of_sight_ecef",
    "sensor_ecef_m",
    "line_of_sight_sigma_rad",
)


@pytest.mark.parametrize("name", CHANGED)
def test_lines_of_sight_are_computed_anew_if_any_of_them_changes(name: str) -> None:
    detections = seen()
    cache = LineOfSightCache(LinesOfSight.of)
    first = cache.of(detections)
    assert cache.of(evolve(detections, track=detections.track + 1)) is first
    column = getattr(detections, name).copy()
    column[1] = column[1] + 1 if column.dtype.kind in "iu" else column[1] * (1.0 + 1e-9)
    changed = evolve(detections, **{name: column})
    lines = cache.of(changed)
    assert lines is not first
    for one, other in zip(values_of(lines), values_of(LinesOfSight.of(changed)), strict=True):
        assert np.array_equal(one, other)


def seen() -> Detections:
    rng = np.random.default_rng(7)
    direction = rng.normal(size=(4, 3))
    return evolve(
        stub_window(4).detections,
        line_of_sight_ecef=direction / np.linalg.norm(direction, axis=1)[:, None],
        sensor_ecef_m=4.2e7 * np.eye(3)[[0, 1, 0, 1]],
        line_of_sight_sigma_rad=np.array([2e-5, 3e-5, 4e-5, 5e-5]),
    )


def values_of(lines: LinesOfSight) -> list[np.ndarray]:
    return [
        lines.time_s,
        lines.sensor,
        lines.scan,
        lines.origin_ecef_m,
        lines.direction_ecef,
        lines.sigma_rad,
    ]


def test_lines_of_sight_are_those_of_their_detections_and_no_sharper_than_a_metre() -> None:
    detections = evolve(seen(), line_of_sight_sigma_rad=np.array([2e-5, 1e-12, 4e-5, 5e-5]))
    lines = LinesOfSight.of(detections)
    assert np.array_equal(lines.direction_ecef, detections.line_of_sight_ecef)
    assert np.array_equal(lines.origin_ecef_m, detections.sensor_ecef_m)
    assert lines.time_s == pytest.approx(detections.time_ns * 1e-9)
    assert lines.sigma_rad == pytest.approx([2e-5, 1.0 / (4.2e7 - 6378137.0), 4e-5, 5e-5])
    assert len(no_lines_of_sight()) == 0


@pytest.mark.parametrize("time_s", [0.0, 900.0, -40_000.0])
def test_vectors_turn_with_the_earth(time_s: float) -> None:
    vectors = np.random.default_rng(8).normal(size=(5, 3))
    turned = earth_rotated(vectors, np.full(5, time_s))
    assert turned == pytest.approx(Rotation.from_rotvec(SPIN * time_s).apply(vectors), abs=1e-14)
    later = turned[None].copy()
    rotate_slightly(later, np.full(5, 0.1))
    assert later[0] == pytest.approx(earth_rotated(vectors, np.full(5, time_s + 0.1)), abs=1e-9)


def test_light_leaves_earlier_than_it_comes() -> None:
    time_s = np.array([10.0, 20.0])
    range_m = np.array([0.0, 1.2 * SPEED_OF_LIGHT_M_S])
    assert emission_s(time_s, range_m, light_time=True) == pytest.approx([10.0, 18.8])
    assert np.array_equal(emission_s(time_s, range_m, light_time=False), time_s)


@pytest.mark.parametrize("count", [2, 40])
def test_residuals_fall_by_their_jacobian(count: int) -> None:
    rng = np.random.default_rng(9)
    origin = 4.2e7 * np.eye(3)[rng.integers(0, 2, count)]
    place = np.array([4e6, 3e6, 4e6]) + 1e4 * rng.normal(size=(count, 3))
    apart = place - origin
    axes = tangent_axes(apart / np.linalg.norm(apart, axis=1)[:, None])
    whitener = np.tile(np.eye(2) / 2e-5, (count, 1, 1))
    whitener[:, 0, 1] = 1e4
    none = np.zeros(count, dtype=np.int64)
    looks = AngleMeasurements(
        none, np.zeros(count), origin, axes, 1e-4 * rng.normal(size=(count, 2)), whitener
    )
    off = 2e3 * rng.normal(size=(count, 3))
    residual, slope = looks.residuals(place + off)
    local = np.einsum("nij,nj->ni", axes, place + off - origin)
    expected = np.einsum("nij,nj->ni", whitener, looks.measured - local[:, :2] / local[:, 2:])
    assert residual == pytest.approx(expected, rel=1e-9, abs=1e-9)
    for axis in range(3):
        step = 10.0 * np.eye(3)[axis]
        ahead, back = (looks.residuals(place + off + sign * step)[0] for sign in (1.0, -1.0))
        assert slope[:, :, axis] == pytest.approx(-(ahead - back) / 20.0, rel=1e-5, abs=1e-9)
