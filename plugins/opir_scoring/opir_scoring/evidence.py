"""The data of a score: a run's tracks and detections, the true states, and the target of each
track.

A track belongs to the target of most of its detections. A target may have several tracks, at the
same time or, where one was lost, one after another. At every tick one of them is *in force*: so
tracks after a loss are scored too, and simultaneous tracks count once.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen

from opir_core import Plan, Run
from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray, RowArray
from opir_core.errors import Problem, SceneError
from opir_core.notebook import html_view
from opir_core.output import read_run, unix_microseconds
from opir_core.plugin import Tracks


@frozen(eq=False)
class RunEvidence:
    """One run: its tracks by tick, and columns over its detections.

    These are times, sensors, standard deviations of direction per axis, tracks (-1: none) and
    targets (-1: false alarm).
    """

    plan: Plan
    tracks: Tracks
    time_s: FloatArray
    sensor: IndexArray
    sigma_rad: FloatArray
    track: IntArray
    target: IndexArray
    #: Measured unit vectors (n, 3) and sensor positions (n, 3), ECEF.
    direction_ecef: FloatArray
    sensor_ecef_m: FloatArray
    #: Processor time of the tracker, s, or nan if not measured.
    tracking_s: float = np.nan
    #: The tracker's estimate of each sensor's health, as plain values, or None.
    health: tuple[Mapping[str, Any] | None, ...] = ()

    def __repr__(self) -> str:
        """Return the plan with the counts, in one line."""
        rows = f"{len(self.tracks)} rows of tracks, {len(self.time_s)} detections"
        return f"<RunEvidence of {self.plan.scene.name}: {rows}>"

    def _repr_html_(self) -> str:
        """Return the first rows of tracks for a notebook."""
        return f"<div>{html_view(self, (), [])}{self.tracks._repr_html_()}</div>"

    @property
    def is_launch(self) -> BoolArray:
        """Whether each of the plan's targets is a launch, not another hot source."""
        return np.arange(len(self.plan.targets.ids)) < len(self.plan.scene.targets)


def evidence_of_run(run: Run, plan: Plan, tracking_s: float = np.nan) -> RunEvidence:
    """Return the evidence of a run in memory with the plan of its scene."""
    order: Any = slice(None)
    if run.detections.is_delayed:
        order = np.argsort(run.detections.time_ns, kind="stable")
    detections = run.detections.take(order)
    return RunEvidence(
        plan=plan,
        tracks=run.tracks,
        # As in files, so that both score alike.
        time_s=np.multiply(unix_microseconds(detections.time_ns, 0), 1e-6, dtype=np.float64),
        sensor=detections.sensor,
        sigma_rad=detections.line_of_sight_sigma_rad,
        track=final_tracks(run.tracks, detections.track),
        target=run.truth.target[order],
        direction_ecef=detections.line_of_sight_ecef,
        sensor_ecef_m=detections.sensor_ecef_m,
        tracking_s=tracking_s,
        health=tuple(row["health"] for row in run.summary["sensors"]),
    )


def final_tracks(tracks: Tracks, track: IntArray) -> IntArray:
    """Return the tracks of detections, -1 where the number is not among the reported tracks."""
    return np.where(np.isin(track, np.unique(tracks.track)), track, -1)


def true_states_ecef(plan: Plan, target: IndexArray, time_s: FloatArray) -> FloatArray:
    """Return true ECEF states (n, 6) of targets (n,) at times (n,), m and m/s relative to the
    rotating Earth.

    nan where the truth is unknown: before ignition, and after burnout unless a sensor detects the
    free flight or the plan has `opir_core.planning.whole_flights` as its `targets`. `run.plan` is
    the plan of a run.
    """
    targets = plan.targets
    start = targets.ignition_s[target]
    end = targets.end_s[target]
    inside = (time_s >= start) & (time_s <= end)
    clipped = np.clip(time_s, start, end)
    # Positions are interpolated to a centimetre and the jerk is below 2 m/s³, so with this step the
    # slope of a parabola is within 0.1 m/s, at the ends too.
    step = np.minimum(0.25, 0.5 * (end - start))
    # A parabola through three places: where the truth ends, as at burnout, they lie to one side.
    middle = np.clip(clipped, start + step, end - step)
    places_m = [targets.position_ecef_m(target, middle + side * step) for side in (-1, 0, 1)]
    slopes_m_s = _slopes(places_m, step, (clipped - middle) / step)
    states = np.hstack([targets.position_ecef_m(target, clipped), slopes_m_s])
    return np.where(inside[:, None], states, np.nan)


def _slopes(places: Sequence[FloatArray], step: FloatArray, offset: FloatArray) -> FloatArray:
    """Return the slopes (n, 3) of parabolas through three places a step apart, at offsets (n,) from
    the middle in steps.
    """
    before, middle, after = places
    per_step = (1.0 / step)[:, None]
    bend = after - 2.0 * middle + before
    curvature = bend * per_step * offset[:, None]
    return 0.5 * (after - before) * per_step + curvature


@frozen(eq=False)
class Ownership:
    """One row per track, by number: target (-1: false alarms or a source that is no launch), purity
    and geometry.

    `held` counts the track's detections from its target, and `purity` is their share of all its
    detections. `is_stereo` marks tracks with detections of several sensors, `is_biased` those with
    a sensor that has a line-of-sight bias. `source` is the row of the launch or other hot source
    among the plan's targets, -1 for false alarms.
    """

    track: IntArray
    target: IntArray
    purity: FloatArray
    held: IntArray
    is_stereo: BoolArray
    is_biased: BoolArray
    source: IntArray


def ownership(evidence: RunEvidence) -> Ownership:
    """Return the targets of all reported tracks."""
    numbers = np.unique(evidence.tracks.track)
    rows = np.flatnonzero(evidence.track >= 0)
    row = np.searchsorted(numbers, evidence.track[rows])
    # The first column counts false alarms.
    count = np.zeros((len(numbers), len(evidence.plan.targets.ids) + 1), dtype=np.int64)
    np.add.at(count, (row, evidence.target[rows] + 1), 1)
    total = count.sum(axis=1)
    source = np.where(total > 0, count.argmax(axis=1) - 1, -1)
    held = count.max(axis=1, initial=0)
    is_launch = np.append(evidence.is_launch, False)
    sensors, biased_sensors = _sensor_counts(evidence, rows, row, len(numbers))
    return Ownership(
        track=numbers,
        target=np.where(is_launch[source], source, -1),
        purity=np.where(total > 0, held / np.maximum(total, 1), 0.0),
        held=held,
        is_stereo=sensors > 1,
        is_biased=biased_sensors > 0,
        source=source,
    )


def _sensor_counts(
    evidence: RunEvidence, rows: RowArray, track: RowArray, tracks: int
) -> tuple[IntArray, IntArray]:
    """Return the numbers (tracks,) of sensors with detections `rows` of each track (n,), and of
    those with a bias.
    """
    sensors = evidence.plan.sensors
    detects = np.zeros((tracks, len(sensors)), dtype=np.bool_)
    detects[track, evidence.sensor[rows]] = True
    is_biased = np.array(
        [sensor.line_of_sight_bias_sigma_rad > 0.0 for sensor in sensors], np.bool_
    )
    return detects.sum(axis=1), (detects & is_biased).sum(axis=1)


def rows_in_force(evidence: RunEvidence, owners: Ownership) -> IntArray:
    """Return the rows of the run's tracks that are in force, one per launch and tick, by launch and
    tick.

    Of several tracks of a launch at a tick it is the one with the most detections of its target,
    the earliest of equals.
    """
    owner = np.searchsorted(owners.track, evidence.tracks.track)
    target = owners.target[owner]
    tick_s = evidence.tracks.tick_s
    order = np.lexsort((owner, -owners.held[owner], tick_s, target))
    order = order[target[order] >= 0]
    is_in_force = np.ones(len(order), dtype=np.bool_)
    is_in_force[1:] = (np.diff(target[order]) != 0) | (np.diff(tick_s[order]) != 0.0)
    return order[is_in_force]


def evidence_of_files(
    events: Path,
    *,
    truth: Path | None = None,
    tracks: Path | None = None,
    manifest: Path | None = None,
) -> RunEvidence:
    """Return the evidence of a run from its events (forge), and the truth, tracks and manifest
    beside them.

    Any of the three may lie elsewhere; such tracks may be those of another tracker from the same
    events. Raises `SceneError` with the file and line that is missing, invalid or of another run.
    """
    run = read_run(events, truth=truth, tracks=tracks, manifest=manifest)
    if tracks is None and run.plan.make_tracker().cadence_s is None:
        words = (
            "the run has no tracks: the tracker none makes none; run it again with --tracker NAME"
        )
        raise SceneError([Problem("", words)], source=str(events))
    return evidence_of_run(run, run.plan)
