"""The scorecard: every figure of a tracker over runs, each with its interval, mono and stereo apart."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.records import BoolArray, FloatArray
from opir_core.scene import REPORTED_TYPES, TARGET_TYPES
from opir_core.scoring.consistency import (
    CONTAINMENTS,
    Consistency,
    consistency,
    containment,
    proportion,
    root_mean_square,
)
from opir_core.scoring.errors import PointErrors, StateErrors, point_errors, state_errors
from opir_core.scoring.evidence import Evidence, true_states
from opir_core.scoring.ownership import Ownership, ownership
from opir_core.tracking.metrics import gospa

_STATE_FREEDOM = 6
_GROUND_FREEDOM = 2


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
        return _plain(self.figures)


def scorecard(evidences: Iterable[Evidence], settings: ScoreSettings = USUAL_SETTINGS) -> Scorecard:
    """Return the scorecard of runs of one scene and one tracker; runs are looked at one at a time."""
    judged = [_judged(evidence, settings) for evidence in evidences]
    states = StateErrors.concatenate(each.states for each in judged)
    points = PointErrors.concatenate(each.points for each in judged)
    biased = any(each.is_biased for each in judged)
    return Scorecard(
        {
            "runs": len(judged),
            "seeds": [each.seed for each in judged],
            "sensors_biased": biased,
            **_counts(judged),
            "mono": _geometry(states.take(~states.is_stereo), points.take(~points.is_stereo), settings),
            "stereo": _geometry(states.take(states.is_stereo), points.take(points.is_stereo), settings),
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
    owners: Ownership
    launches: int
    completeness: FloatArray
    first_track_s: FloatArray
    gospa_parts: FloatArray
    confusion: FloatArray
    detections: int
    tracking_s: float


def _judged(evidence: Evidence, settings: ScoreSettings) -> _Judged:
    owners = ownership(evidence)
    completeness, first_track_s = _coverage(evidence, owners)
    return _Judged(
        seed=evidence.plan.scene.seed,
        is_biased=evidence.plan.bias is not None,
        states=state_errors(evidence, owners),
        points=point_errors(evidence, owners),
        owners=owners,
        launches=len(evidence.plan.scene.targets),
        completeness=completeness,
        first_track_s=first_track_s,
        gospa_parts=_gospa_parts(evidence, settings),
        confusion=_types(evidence, owners),
        detections=len(evidence.time_s),
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


def _gospa_parts(evidence: Evidence, settings: ScoreSettings) -> FloatArray:
    """Return (ticks, 5): distance, the three p-th powers, and how many launches burn."""
    targets, tracks = evidence.plan.targets, evidence.tracks
    launches = np.arange(len(evidence.plan.scene.targets), dtype=np.int32)
    rows = []
    for tick_s in np.unique(tracks.tick_s).tolist():
        burning = launches[(targets.ignition_s[launches] <= tick_s) & (targets.burnout_s[launches] >= tick_s)]
        if not len(burning):
            continue
        true = true_states(evidence.plan, burning, np.full(len(burning), tick_s))[:, :3]
        told = tracks.state[(tracks.tick_s == tick_s) & np.isfinite(tracks.state[:, 0]), :3]
        found = gospa(told, true, cutoff=settings.cutoff_m, order=settings.order, alpha=settings.alpha)
        rows.append((found.distance, found.localisation, found.missed, found.false, len(burning)))
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
    false = sum(int(np.count_nonzero(each.owners.target < 0)) for each in judged)
    purity = np.concatenate([each.owners.purity[each.owners.target >= 0] for each in judged])
    completeness = np.concatenate([each.completeness for each in judged])
    first = np.concatenate([each.first_track_s for each in judged])
    detections = sum(each.detections for each in judged)
    return {
        "launches_tracked": _share(*proportion(tracked, launches)),
        "false_tracks_a_run": false / max(len(judged), 1),
        "purity": _mean(purity),
        "completeness": _mean(completeness),
        "first_track_after_s": _mean(first),
        "tracking_us_a_detection": 1e6 * sum(each.tracking_s for each in judged) / max(detections, 1),
    }


def _geometry(states: StateErrors, points: PointErrors, settings: ScoreSettings) -> dict[str, Any]:
    bins = np.floor(states.since_s / settings.bin_s).astype(np.int64)
    return {
        "by_time": [_bin(states.take(bins == number), number, settings) for number in np.unique(bins).tolist()],
        "launch_m": _rms(points.launch_m),
        "launch_time_s": _rms(points.launch_time_s),
        "impact_m": _rms(points.impact_m),
        "impact_time_s": _rms(points.impact_time_s),
        "launch_containment": _contained(points.launch_nees),
        "impact_containment": _contained(points.impact_nees),
    }


def _bin(states: StateErrors, number: int, settings: ScoreSettings) -> dict[str, Any]:
    """Return the figures of one bin of time since ignition; NEES by the last tick of each target in it alone.

    Ticks of one target are not independent of each other, which the χ² band takes them to be.
    """
    position, velocity = _rms(states.position_m), _rms(states.velocity_m_s)
    bounds = (_rms(states.position_bound_m)["value"], _rms(states.velocity_bound_m_s)["value"])
    return {
        "since_ignition_s": [number * settings.bin_s, (number + 1) * settings.bin_s],
        "samples": len(states),
        "position_m": position,
        "velocity_m_s": velocity,
        "position_over_bound": position["value"] / bounds[0],
        "velocity_over_bound": velocity["value"] / bounds[1],
        "nees": _consistent(consistency(states.nees[_last_of_each(states)], _STATE_FREEDOM)),
    }


def _last_of_each(states: StateErrors) -> BoolArray:
    """Return which rows are the last of their track in a bin; rows of a track stand together, in order of time."""
    if not len(states):
        return np.empty(0, dtype=np.bool_)
    changes = (np.diff(states.target) != 0) | (np.diff(states.since_s) <= 0.0)
    return np.append(changes, True)


def _gospa(judged: Sequence[_Judged], settings: ScoreSettings) -> dict[str, Any]:
    parts = np.concatenate([each.gospa_parts for each in judged])
    roots = (parts[:, 1:4] / np.maximum(parts[:, 4:], 1.0)).mean(axis=0) if len(parts) else np.full(3, np.nan)
    return {
        "cutoff_m": settings.cutoff_m,
        "order": settings.order,
        "alpha": settings.alpha,
        "mean_m": _mean(parts[:, 0]),
        "a_target_m": _mean(parts[:, 0] / np.maximum(parts[:, 4], 1.0)),
        "localisation_a_target": float(roots[0]),
        "missed_a_target": float(roots[1]),
        "false_a_target": float(roots[2]),
    }


def _confusion(judged: Sequence[_Judged]) -> dict[str, dict[str, int]]:
    count = sum((each.confusion for each in judged), np.zeros((len(TARGET_TYPES), len(REPORTED_TYPES))))
    return {
        true: {told: int(count[row, column]) for column, told in enumerate(REPORTED_TYPES)}
        for row, true in enumerate(TARGET_TYPES)
        if count[row].any()
    }


def _contained(values: FloatArray) -> list[dict[str, Any]]:
    return [{"nominal": nominal, **_share(*containment(values, _GROUND_FREEDOM, nominal))} for nominal in CONTAINMENTS]


def _consistent(found: Consistency) -> dict[str, Any]:
    return {
        "samples": found.samples,
        "mean": found.mean / found.freedom,
        "band_99": [found.lower / found.freedom, found.upper / found.freedom],
        "distribution_p": found.p_value,
    }


def _rms(error: FloatArray) -> dict[str, Any]:
    value, lower, upper = root_mean_square(error)
    return {"value": value, "interval_95": [lower, upper]}


def _share(value: float, lower: float, upper: float) -> dict[str, Any]:
    return {"value": value, "interval_95": [lower, upper]}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _mean(values: FloatArray) -> dict[str, Any]:
    """Return the mean of what is known, with the 95 % interval of its normal approximation."""
    values = values[np.isfinite(values)]
    if not len(values):
        return {"value": np.nan, "interval_95": [np.nan, np.nan]}
    mean = float(values.mean())
    half = 1.96 * float(values.std(ddof=1)) / np.sqrt(len(values)) if len(values) > 1 else np.nan
    return {"value": mean, "interval_95": [mean - half, mean + half]}
