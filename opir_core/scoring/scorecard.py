"""The scorecard: every figure of a tracker over runs, each with its interval, mono and stereo apart."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.records import BoolArray, FloatArray, IntArray
from opir_core.scene import REPORTED_TYPES, TARGET_TYPES
from opir_core.scoring.consistency import consistency, proportion
from opir_core.scoring.errors import PointErrors, StateErrors, point_errors, state_errors
from opir_core.scoring.evidence import Evidence, true_states
from opir_core.scoring.figures import consistent, contained, mean, over, plain, rms, share
from opir_core.scoring.innovations import Innovations, innovations
from opir_core.scoring.ownership import Ownership, ownership
from opir_core.tracking.metrics import gospa

_STATE_FREEDOM = 6
_DIRECTION_FREEDOM = 2
#: Errors are held against bounds of the position below this, m: above, directions alone say little of the place.
TOLD_M = 100e3
#: More targets than a scene can have.
_MANY = 10**9


@frozen(kw_only=True)
class ScoreSettings:
    """What a score depends on beside the runs: bins of time since ignition, and GOSPA's parameters."""

    bin_s: float = 20.0
    cutoff_m: float = 5000.0
    order: float = 2.0
    alpha: float = 2.0


#: The settings unless told otherwise.
USUAL_SETTINGS = ScoreSettings()


@frozen(eq=False)
class Scorecard:
    """A tracker's figures over runs, as plain values."""

    figures: Mapping[str, Any]

    def as_plain(self) -> Any:
        """Return the figures for JSON, where what is not known is null."""
        return plain(self.figures)


def scorecard(evidences: Iterable[Evidence], settings: ScoreSettings = USUAL_SETTINGS) -> Scorecard:
    """Return the scorecard of runs of one scene and one tracker; runs are looked at one at a time."""
    judged = [_judged(evidence, settings) for evidence in evidences]
    geometry = {name: _geometry(judged, is_stereo, settings) for name, is_stereo in (("mono", False), ("stereo", True))}
    biased = any(each.is_biased for each in judged)
    return Scorecard(
        {
            "runs": len(judged),
            "seeds": [each.seed for each in judged],
            "sensors_biased": biased,
            **_counts(judged),
            **geometry,
            "gospa": _gospa(judged, settings),
            "type_confusion": _confusion(judged),
        }
    )


@frozen(eq=False)
class _Judged:
    seed: int
    is_biased: bool
    states: StateErrors
    points: PointErrors
    innovations: Innovations
    owners: Ownership
    launches: int
    completeness: FloatArray
    first_track_s: FloatArray
    gospa_parts: FloatArray
    confusion: FloatArray
    detections: int
    track_updates: int
    tracking_s: float


def _judged(evidence: Evidence, settings: ScoreSettings) -> _Judged:
    owners = ownership(evidence)
    completeness, first_track_s = _coverage(evidence, owners)
    return _Judged(
        seed=evidence.plan.scene.seed,
        is_biased=evidence.plan.bias is not None,
        states=state_errors(evidence, owners),
        points=point_errors(evidence, owners),
        innovations=innovations(evidence, owners),
        owners=owners,
        launches=len(evidence.plan.scene.targets),
        completeness=completeness,
        first_track_s=first_track_s,
        gospa_parts=_gospa_parts(evidence, owners, settings),
        confusion=_types(evidence, owners),
        detections=len(evidence.time_s),
        track_updates=len(evidence.tracks),
        tracking_s=evidence.tracking_s,
    )


def _coverage(evidence: Evidence, owners: Ownership) -> tuple[FloatArray, FloatArray]:
    """Return, by launch that was detected, the share of ticks to burnout with a track, and when the first came, s."""
    ticks = np.unique(evidence.tracks.tick_s)
    shares, firsts = [], []
    for target in range(len(evidence.plan.scene.targets)):
        seen = evidence.time_s[evidence.target == target]
        if not len(seen):
            continue
        mine = np.isin(evidence.tracks.track, owners.track[owners.target == target])
        told = np.unique(evidence.tracks.tick_s[mine])
        due = ticks[(ticks >= seen[0]) & (ticks <= evidence.plan.targets.burnout_s[target])]
        shares.append(float(np.isin(due, told).mean()) if len(due) else np.nan)
        firsts.append(float(told[0] - seen[0]) if len(told) else np.nan)
    return np.array(shares), np.array(firsts)


def _gospa_parts(evidence: Evidence, owners: Ownership, settings: ScoreSettings) -> FloatArray:
    """Return (ticks, 5): distance, the three p-th powers, and how many launches there are whose truth is known.

    A track of a launch whose truth is no longer known, as after burnout, is neither found nor false: it is left out.
    """
    targets, tracks = evidence.plan.targets, evidence.tracks
    launches = np.arange(len(evidence.plan.scene.targets), dtype=np.int32)
    owner = owners.target[np.searchsorted(owners.track, tracks.track)]
    rows = []
    for tick_s in np.unique(tracks.tick_s).tolist():
        known = launches[(targets.ignition_s[launches] <= tick_s) & (targets.end_s[launches] >= tick_s)]
        if not len(known):
            continue
        true = true_states(evidence.plan, known, np.full(len(known), tick_s))[:, :3]
        judged = (tracks.tick_s == tick_s) & np.isfinite(tracks.state[:, 0])
        told = tracks.state[judged & ((owner < 0) | np.isin(owner, known)), :3]
        found = gospa(told, true, cutoff=settings.cutoff_m, order=settings.order, alpha=settings.alpha)
        rows.append((found.distance, found.localisation, found.missed, found.false, len(known)))
    return np.array(rows, dtype=np.float64).reshape(-1, 5)


def _types(evidence: Evidence, owners: Ownership) -> FloatArray:
    """Return counts (true types, reported types) of the last type posteriors of best tracks."""
    count = np.zeros((len(TARGET_TYPES), len(REPORTED_TYPES)))
    for row in np.flatnonzero(owners.is_best & (owners.target >= 0)).tolist():
        posterior = evidence.tracks.type_probability[evidence.tracks.track == owners.track[row]][-1]
        if np.isfinite(posterior).all():
            count[evidence.plan.targets.type_code[owners.target[row]], int(posterior.argmax())] += 1
    return count


def _counts(judged: Sequence[_Judged]) -> dict[str, Any]:
    launches = sum(each.launches for each in judged)
    tracked = sum(int(np.count_nonzero(each.owners.is_best & (each.owners.target >= 0))) for each in judged)
    purity = np.concatenate([each.owners.purity[each.owners.target >= 0] for each in judged])
    completeness = np.concatenate([each.completeness for each in judged])
    first = np.concatenate([each.first_track_s for each in judged])
    return {
        "launches_tracked": share(*proportion(tracked, launches)),
        "false_tracks_a_run": mean(np.array([np.count_nonzero(each.owners.target < 0) for each in judged])),
        "purity": mean(purity, 1.0),
        "completeness": mean(completeness, 1.0),
        "first_track_after_s": mean(first),
        "tracking_us_a_detection": _pace(judged, [each.detections for each in judged]),
        "tracking_us_a_track_update": _pace(judged, [each.track_updates for each in judged]),
    }


def _pace(judged: Sequence[_Judged], count: Sequence[int]) -> dict[str, Any]:
    """Return the time of tracking a count, µs, over runs."""
    taken = np.array([each.tracking_s for each in judged])
    return mean(1e6 * taken / np.maximum(np.array(count), 1))


def _geometry(judged: Sequence[_Judged], is_stereo: bool, settings: ScoreSettings) -> dict[str, Any]:
    """Return the figures of the targets that one sensor saw, or several."""
    states = StateErrors.concatenate(each.states for each in judged)
    points = PointErrors.concatenate(each.points for each in judged)
    found = Innovations.concatenate(each.innovations for each in judged)
    run = np.repeat(np.arange(len(judged)), [len(each.states) for each in judged])
    mine, seen = states.is_stereo == is_stereo, found.is_stereo == is_stereo
    states, run, points = states.take(mine), run[mine], points.take(points.is_stereo == is_stereo)
    nis, nis_bin = found.nis[seen], _bins(found.since_s[seen], settings)
    bins = _bins(states.since_s, settings)
    return {
        "by_time": [
            {
                "since_ignition_s": [number * settings.bin_s, (number + 1) * settings.bin_s],
                **_bin(states.take(bins == number), run[bins == number]),
                "nis": consistent(consistency(nis[nis_bin == number], _DIRECTION_FREEDOM)),
            }
            for number in np.unique(bins).tolist()
        ],
        "launch_m": rms(points.launch_m),
        "launch_time_s": rms(points.launch_time_s),
        "impact_m": rms(points.impact_m),
        "impact_time_s": rms(points.impact_time_s),
        "launch_containment": contained(points.launch_nees),
        "impact_containment": contained(points.impact_nees),
    }


def _bins(since_s: FloatArray, settings: ScoreSettings) -> IntArray:
    return np.floor(since_s / settings.bin_s).astype(np.int64)


def _bin(states: StateErrors, run: IntArray) -> dict[str, Any]:
    """Return the figures of one bin of time since ignition; NEES by the last tick of each target in it alone.

    Ticks of one target are not independent of each other, which the χ² band takes them to be.
    """
    track = run * _MANY + states.target
    return {
        "samples": len(states),
        "position_m": rms(states.position_m, track),
        "velocity_m_s": rms(states.velocity_m_s, track),
        **_over_bounds(states, track, "", states.position_bound_m, states.velocity_bound_m_s),
        **_over_bounds(states, track, "free_", states.position_free_bound_m, states.velocity_free_bound_m_s),
        "impact_m": rms(states.impact_m, track),
        "nees": consistent(consistency(states.nees[_last_of_each(states)], _STATE_FREEDOM)),
    }


def _over_bounds(
    states: StateErrors, track: IntArray, name: str, position_m: FloatArray, velocity_m_s: FloatArray
) -> dict[str, Any]:
    """Return bounds, and errors over them, at the ticks at which directions tell the place to `TOLD_M`."""
    told = position_m < TOLD_M
    figures = {}
    for what, unit, error, bound in (
        ("position", "m", states.position_m, position_m),
        ("velocity", "m_s", states.velocity_m_s, velocity_m_s),
    ):
        figures[f"{what}_{name}bound_{unit}"] = rms(bound[told])["value"]
        figures[f"{what}_over_{name}bound"] = over(rms(error[told], track[told]), rms(bound[told])["value"])
    return figures


def _last_of_each(states: StateErrors) -> BoolArray:
    """Return which rows are the last of their track in a bin; rows of a track stand together, in order of time."""
    if not len(states):
        return np.empty(0, dtype=np.bool_)
    changes = (np.diff(states.target) != 0) | (np.diff(states.since_s) <= 0.0)
    return np.append(changes, True)


def _gospa(judged: Sequence[_Judged], settings: ScoreSettings) -> dict[str, Any]:
    """Return the distances, averaged over the ticks of a run, and their parts, which are p-th powers."""
    means = np.array([_mean_gospa(each.gospa_parts) for each in judged]).reshape(-1, 5)
    names = ("mean_m", "a_target_m", "localisation_a_target", "missed_a_target", "false_a_target")
    return {
        "cutoff_m": settings.cutoff_m,
        "order": settings.order,
        "alpha": settings.alpha,
        **{name: mean(means[:, column]) for column, name in enumerate(names)},
    }


def _mean_gospa(parts: FloatArray) -> FloatArray:
    """Return a run's mean distance, the same a target, and its three parts a target; nan of a run without tracks."""
    if not len(parts):
        return np.full(5, np.nan)
    burning = np.maximum(parts[:, 4:], 1.0)
    each: FloatArray = np.concatenate([parts[:, :1], parts[:, :4] / burning], axis=1).mean(axis=0)
    return each


def _confusion(judged: Sequence[_Judged]) -> dict[str, dict[str, int]]:
    count = sum((each.confusion for each in judged), np.zeros((len(TARGET_TYPES), len(REPORTED_TYPES))))
    return {
        true: {told: int(count[row, column]) for column, told in enumerate(REPORTED_TYPES)}
        for row, true in enumerate(TARGET_TYPES)
        if count[row].any()
    }
