"""Innovations: how far detections are from where the estimate of the tick before expected them, over what it stated.

No truth is needed. The first detection of a track after each tick is taken: what an honest tracker expects of it errs
independently from tick to tick.
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.columns import Columns
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.records import Tracks
from opir_core.scoring.evidence import Evidence
from opir_core.scoring.ownership import Ownership, rows_in_force
from opir_core.tracking.rays import along, axes_across

#: Detections so long after a tick are left out, s: within it a boost of 50 m/s² strays by 25 m from a straight line.
REACH_S = 1.0


@frozen(eq=False)
class Innovations(Columns):
    """One row a tick of a target's track in force: its target, time since ignition, who saw it, and the NIS.

    The normalised innovation squared has two degrees of freedom: the two angles across the line of sight.
    """

    target: IntArray
    since_s: FloatArray
    is_stereo: BoolArray
    is_biased: BoolArray
    nis: FloatArray

    @classmethod
    def empty(cls) -> "Innovations":
        """Return the record of no rows."""
        real, truth = np.empty(0), np.empty(0, dtype=np.bool_)
        return cls(np.empty(0, dtype=np.int64), real, truth, truth, real)


def innovations(evidence: Evidence, owners: Ownership) -> Innovations:
    """Return the innovations of the tracks in force, by track."""
    told = evidence.tracks.take(rows_in_force(evidence, owners))
    told = told.take(np.isfinite(told.state).all(axis=1) & np.isfinite(told.state_covariance).all(axis=(1, 2)))
    numbers = np.unique(told.track).tolist()
    return Innovations.concatenate(_of_track(evidence, told.take(told.track == each), owners) for each in numbers)


def _of_track(evidence: Evidence, told: Tracks, owners: Ownership) -> Innovations:
    row = int(np.searchsorted(owners.track, told.track[0]))
    mine = np.flatnonzero(evidence.track == owners.track[row])
    before = np.searchsorted(told.tick_s, evidence.time_s[mine], side="right") - 1
    mine, before = mine[before >= 0], before[before >= 0]
    before, first = np.unique(before, return_index=True)
    near = evidence.time_s[mine[first]] - told.tick_s[before] <= REACH_S
    mine, told = mine[first][near], told.take(before[near])
    target = int(owners.target[row])
    return Innovations(
        target=np.full(len(mine), target, dtype=np.int64),
        since_s=told.tick_s - evidence.plan.targets.ignition_s[target],
        is_stereo=np.full(len(mine), owners.is_stereo[row]),
        is_biased=np.full(len(mine), owners.is_biased[row]),
        nis=_normalised(evidence, mine, told),
    )


def _normalised(evidence: Evidence, rows: IntArray, told: Tracks) -> FloatArray:
    """Return the NIS (n,) of detections, each against a state that goes straight on to when its light left."""
    origin, after_s = evidence.sensor_ecef_m[rows], evidence.time_s[rows] - told.tick_s
    expected = told.state[:, :3] + told.state[:, 3:] * after_s[:, None]
    if evidence.plan.scene.light_time:
        after_s = after_s - np.sqrt(np.sum((expected - origin) ** 2, axis=1)) / SPEED_OF_LIGHT_M_S
        expected = told.state[:, :3] + told.state[:, 3:] * after_s[:, None]
    apart = expected - origin
    range_m = np.sqrt(np.sum(apart * apart, axis=1))
    axes = axes_across(apart / range_m[:, None])
    seen = along(axes, evidence.direction_ecef[rows])
    seen = seen[:, :2] / seen[:, 2:]
    slope = axes[:, :2] / range_m[:, None, None]
    slope = np.concatenate([slope, slope * after_s[:, None, None]], axis=2)
    spread = slope @ told.state_covariance @ slope.transpose(0, 2, 1)
    spread[:, [0, 1], [0, 1]] += np.square(evidence.sigma_rad[rows])[:, None]
    found: FloatArray = np.sum(seen * np.linalg.solve(spread, seen[:, :, None])[:, :, 0], axis=1)
    return found
