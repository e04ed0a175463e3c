"""Tracks in the focal plane of one sensor follow targets within a look's error of one another."""

import numpy as np
import pytest
from opir_estimation import LinesOfSight
from opir_trackers.association import AssociationModel
from opir_trackers.imm import focal_plane
from opir_trackers.imm.focal_plane import FocalPlaneTracks

RANGE_M = 3.7e7
SIGMA_RAD = 2e-5
PERIOD_S = 0.1
MODEL = AssociationModel(np.array([0.8]), 100.0)


def begun(place_m: np.ndarray, speed_m_s: np.ndarray) -> FocalPlaneTracks:
    """Return tracks (n, 2) across the view, known to 300 m, 30 m/s and 10 m/s²."""
    count = len(place_m)
    apart = np.column_stack([place_m, np.full(count, RANGE_M)])
    motion = apart, np.column_stack([speed_m_s, np.zeros(count)]), np.zeros((count, 3))
    roots = np.zeros((count, 3, 3, 9))
    for order, sigma in enumerate((300.0, 30.0, 10.0)):
        roots[:, order, :, 3 * order : 3 * order + 3] = sigma * np.eye(3)
    number = np.arange(count)
    return focal_plane.begun(
        number, np.zeros(count, dtype=np.int64), 0.0, motion, roots, np.zeros(count)
    )


def looks(
    place_m: np.ndarray,
    speed_m_s: np.ndarray,
    chance: float,
    rng: np.random.Generator,
    start_s: float,
):
    """Return a second of lines of targets (n, 2), and the target of each."""
    parts = []
    whose = []
    for scan in range(10):
        seen = np.flatnonzero(rng.random(len(place_m)) < chance)
        when = start_s + PERIOD_S * scan
        at = np.column_stack([place_m[seen] + when * speed_m_s[seen], np.full(len(seen), RANGE_M)])
        at[:, :2] += SIGMA_RAD * RANGE_M * rng.normal(size=(len(seen), 2))
        unit = at / np.linalg.norm(at, axis=1)[:, None]
        number = np.full(len(seen), round(10 * start_s) + scan)
        sensor = np.zeros(len(seen), dtype=np.int32)
        sigma = np.full(len(seen), SIGMA_RAD)
        parts.append(
            LinesOfSight(
                np.full(len(seen), when), sensor, number, np.zeros((len(seen), 3)), unit, sigma
            )
        )
        whose.append(seen)
    return LinesOfSight.concatenate(parts), np.concatenate(whose)


def places_m(tracks: FocalPlaneTracks) -> np.ndarray:
    unit = tracks.directions(np.arange(len(tracks)), tracks.mean[:, 0])
    return RANGE_M * unit[:, :2] / unit[:, 2:]


def followed(place_m, speed_m_s, chance: float, seconds: int, seed: int):
    """Return tracks after some seconds, their equivalent lines, and the looks and the share that is
    right by second.
    """
    rng = np.random.default_rng(seed)
    tracks = begun(place_m, speed_m_s)
    right = []
    parts = []
    seen = []
    for second in range(seconds):
        lines, whose = looks(place_m, speed_m_s, chance, rng, second + 0.05)
        near = focal_plane.candidate_pairs(tracks, lines, 1.0, 4.5)
        pairs = focal_plane.gated_pairs(tracks, lines, *near, 4.5)
        update = focal_plane.updated(tracks, lines, pairs, MODEL, 4.5)
        tracks = update.tracks.predicted(second + 1.0)
        right.append(np.mean(update.owner == whose))
        parts.append(update.equivalent)
        seen.append(len(lines))
    return tracks, LinesOfSight.concatenate(parts), np.array(seen), np.array(right)


@pytest.mark.parametrize("chance", [1.0, 0.7])
def test_a_lone_target_is_followed_as_well_as_its_covariance_says(chance: float) -> None:
    squares = []
    for seed in range(60):
        speed = np.array([[400.0, 100.0]])
        tracks = followed(np.zeros((1, 2)), speed, chance, 8, seed)[0]
        off = (places_m(tracks) - 8.0 * speed)[0] / RANGE_M
        squares.append(off @ off / tracks.covariance[0, 0, 0] / 2.0)
    # The mean of 120 squares of standard normal deviates is within 0.62 and 1.46 with 99.9 %.
    assert 0.62 < np.mean(squares) < 1.46


def test_two_that_part_keep_their_lines_and_equivalent_lines_are_no_surer_than_looks() -> None:
    place = np.array([[0.0, 0.0], [200.0, 0.0]])
    speed = np.array([[0.0, 250.0], [0.0, -250.0]])
    tracks, lines, seen, right = followed(place, speed, 0.8, 12, 1)
    assert np.linalg.norm(places_m(tracks) - (place + 12.0 * speed), axis=1).max() < 600.0
    assert right[8:].mean() > 0.97
    # In looks, by second: an equivalent line is of a few scans.
    worth = np.bincount(lines.time_s.astype(np.int64), np.square(SIGMA_RAD / lines.sigma_rad))
    assert (worth <= seen * (1.0 + 1e-9)).all()
    assert worth[0] < 0.9 * seen[0], "a shared line counts for less"
    assert worth[11] > 0.99 * seen[11]


def test_a_look_that_may_be_of_either_is_a_vague_line_of_both() -> None:
    """Ten seconds after the last look both predictions hold both lines: without a line a motor
    seems burnt out.
    """
    place = np.array([[0.0, 0.0], [2e4, 0.0]])
    speed = np.array([[900.0, 0.0], [900.0, 0.0]])
    tracks = begun(place, speed).predicted(60.0)
    lines, _ = looks(place, speed, 1.0, np.random.default_rng(3), 60.0)
    one_scan = lines.take(np.flatnonzero(lines.time_s == lines.time_s.min()))
    near = focal_plane.candidate_pairs(tracks, one_scan, 60.0, 4.5)
    pairs = focal_plane.gated_pairs(tracks, one_scan, *near, 4.5)
    assert len(pairs.row) == 4, "each line is within the gates of both"
    update = focal_plane.updated(tracks, one_scan, pairs, MODEL, 4.5)
    assert sorted(update.row.tolist()) == [0, 1]
    assert (update.equivalent.sigma_rad > 5.0 * SIGMA_RAD).all()


def test_a_track_that_begins_from_a_state_has_its_direction_rate_and_error() -> None:
    tracks = begun(np.array([[5e4, -2e4]]), np.array([[700.0, -300.0]]))
    later = tracks.predicted(2.0)
    assert np.allclose(places_m(later), [[5e4 + 1400.0, -2e4 - 600.0]], atol=5.0)
    assert np.sqrt(tracks.covariance[0, 0, 0]) * RANGE_M == pytest.approx(300.0, rel=0.01)
    assert np.sqrt(tracks.covariance[0, 1, 1]) * RANGE_M == pytest.approx(30.0, rel=0.01)
