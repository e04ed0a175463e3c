"""What a tracker is shown: what sensors measured, and nothing of which target it was of."""

import numpy as np
import pytest
from attrs import evolve, fields

from opir_core import compile_plan, run_of_plan
from opir_core.plugin import Detections, Tracks
from opir_core.reading import scene_from_mapping
from opir_core.simulation.tracker_clock import rows_of

SCENE = {
    "scene": "shown",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 20.0,
    "seed": 3,
    # Aligned scans: looks at both targets are at the same time.
    "sensors": [
        {"model": "SBIRS-GEO", "id": "A", "orbital_slot_deg": -150.0, "scan_phase": "aligned"}
    ],
    "targets": [
        {
            "id": name,
            "type": "ICBM",
            "launch": {"lat_deg": 34.0 + number, "lon_deg": -120.0, "time_s": 1.0},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
        }
        for number, name in enumerate(("T1", "T2"))
    ],
    "tracker": "imm",
}


class Spy:
    """A tracker that keeps what it is shown."""

    cadence_s = 1.0

    def __init__(self):
        self.asked = []
        self.shown = []

    def associate(self, detections):
        self.asked.append(detections)
        return np.full(len(detections), -1, dtype=np.int64)

    def step(self, tick_s, detections):
        self.shown.append(detections)
        return Tracks.empty()


def test_a_tracker_is_shown_no_count_and_no_confidence():
    spy = Spy()
    run = run_of_plan(evolve(compile_plan(scene_from_mapping(SCENE)), make_tracker=lambda: spy))
    for pieces in (spy.asked, spy.shown):
        detections_read = Detections.concatenate(pieces)
        assert len(detections_read) == len(run.detections) > 100
        assert not detections_read.detection_count.any()
        assert np.isnan(detections_read.confidence).all()
    # What sinks get is whole.
    assert run.detections.detection_count.max() > 10
    assert (run.detections.confidence > 0.0).all()


def test_trackers_see_nothing_of_the_true_target():
    """Every column but the directions, the reported types and the ids is the same for two targets
    seen in one scan.
    """
    spy = Spy()
    run = run_of_plan(evolve(compile_plan(scene_from_mapping(SCENE)), make_tracker=lambda: spy))
    shown = Detections.concatenate(spy.shown)
    pairs = np.flatnonzero(np.diff(shown.time_ns) == 0)
    assert len(pairs) > 20
    assert (run.truth.target[pairs] != run.truth.target[pairs + 1]).all()
    differs = {"line_of_sight_ecef", "detection_id", "reported_type"}
    for name in (item.name for item in fields(Detections) if item.name not in differs):
        column = getattr(shown, name)
        assert np.array_equal(column[pairs], column[pairs + 1], equal_nan=True), name


class Watched:
    """A tracker that counts its steps; reported `never_idle`, it is stepped at every tick."""

    def __init__(self, tracker, never_idle):
        self._tracker = tracker
        self._never_idle = never_idle
        self.steps = []
        self.cadence_s = tracker.cadence_s
        self.associate = tracker.associate

    def is_idle(self):
        return not self._never_idle and self._tracker.is_idle()

    def step(self, tick_s, detections):
        self.steps.append(tick_s)
        return self._tracker.step(tick_s, detections)


@pytest.mark.parametrize("tracker", ["imm", pytest.param("kepler-arc", marks=pytest.mark.slow)])
def test_an_idle_tracker_is_not_stepped_and_misses_nothing(tracker):
    """Two short flights, long apart: the same tracks, in any windows."""
    delayed = {
        "id": "T3",
        "type": "SRBM",
        "launch": {"lat_deg": 36.0, "lon_deg": -120.0, "time_s": 1501.0},
    }
    targets = [{**delayed, "id": "T1", "launch": {**delayed["launch"], "time_s": 31.0}}, delayed]
    aim = {"lat_deg": 38.0, "lon_deg": -120.0}
    scene = {
        **SCENE,
        "duration_s": 1530.5,
        "targets": [{**target_value, "aim": aim} for target_value in targets],
        "tracker": tracker,
    }
    plan = compile_plan(scene_from_mapping(scene))
    runs = []
    steps = []
    for never_idle, window_s in ((True, None), (False, None), (False, 37.3)):
        watched = Watched(plan.make_tracker(), never_idle)
        runs.append(
            run_of_plan(evolve(plan, make_tracker=lambda watched=watched: watched), window_s)
        )
        steps.append(len(watched.steps))
    assert len(runs[0].tracks) > 20
    for run in runs[1:]:
        for item in fields(Tracks):
            first_run = getattr(runs[0].tracks, item.name)
            second_run = getattr(run.tracks, item.name)
            assert np.array_equal(first_run, second_run, equal_nan=first_run.dtype.kind == "f"), (
                item.name
            )
        assert np.array_equal(runs[0].detections.track, run.detections.track)
    assert steps[0] > 1500
    # Boosts, and until the tracks are lost; then the one step before the next detection, and that
    # at the scene's end.
    assert steps[1] < 800


def test_a_year_with_a_launch_at_its_end_takes_few_steps():
    launch = {"lat_deg": 36.0, "lon_deg": -120.0, "time_s": 3.09e7}
    target = {
        "id": "T1",
        "type": "SRBM",
        "launch": launch,
        "aim": {"lat_deg": 38.0, "lon_deg": -120.0},
    }
    scene = {**SCENE, "duration_s": 3.1e7, "targets": [target], "tracker": "imm"}
    plan = compile_plan(scene_from_mapping(scene))
    watched = Watched(plan.make_tracker(), False)
    run = run_of_plan(evolve(plan, make_tracker=lambda: watched))
    assert 3.09e7 < run.tracks.tick_s[0] < 3.09e7 + 20.0
    assert len(watched.steps) < 500


def test_rows_are_those_of_the_numbers_and_of_no_others():
    assert rows_of(np.array([2, 5]), np.array([5, 2, 1, 3, 9, -1]), 10).tolist() == [
        11,
        10,
        -1,
        -1,
        -1,
        -1,
    ]
    assert rows_of(np.empty(0, dtype=np.int64), np.array([1, 2]), 10).tolist() == [-1, -1]
