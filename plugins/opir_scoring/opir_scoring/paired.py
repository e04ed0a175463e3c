"""Trackers side by side on the same runs: errors at what all of them estimate, and their paired
differences.

A tracker that starts late is not scored at the early, bad ticks: errors over each tracker's own
ticks say little of which is better. Here all are scored at the same ticks, launches and phases, and
coverage is a figure of its own.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from typing import Any

import numpy as np
from attrs import frozen
from scipy.stats import t as student

from opir_core.arrays import FloatArray, IntArray
from opir_scoring.containments import mean
from opir_scoring.impacts import PHASES
from opir_scoring.scorecards import ScoredRun, ScoreSettings

#: Bins of time since ignition of a comparison, at most: the width doubles until they are no more.
MOST_BINS = 7

#: Keys are run, target and time, ms, in the bits of an integer: more targets and times than a scene
#: can have.
_TARGETS = 1 << 22
_TIMES = 1 << 34


@frozen
class Measure:
    """An error of the paired comparison: its unit, and whether squares are averaged (RMS) or values
    (energy scores).
    """

    name: str
    unit: str
    is_squared: bool = False


STATE_MEASURES = (
    Measure("position_energy_m", "m"),
    Measure("position_m", "m", is_squared=True),
    Measure("velocity_energy_m_s", "m/s"),
    Measure("velocity_m_s", "m/s", is_squared=True),
)
#: The measure of which the verdict is: proper, so that neither a point without its uncertainty nor
#: a covariance that is too wide gains by it.
DECIDING = STATE_MEASURES[0]
LAUNCH = Measure("launch_energy_m", "m")
IMPACT = Measure("energy_m", "m")


@frozen(eq=False)
class _Values:
    """Errors (n,) by unique keys (n,) of what they are errors of."""

    key: IntArray
    value: FloatArray

    @classmethod
    def known(cls, key: IntArray, value: FloatArray) -> "_Values":
        known = np.flatnonzero(np.isfinite(value))
        unique, first = np.unique(key[known], return_index=True)
        return cls(unique, value[known][first])

    def of(self, key: IntArray) -> FloatArray:
        """Return the errors of those keys (n,) that there are."""
        return self.value[np.isin(self.key, key)]

    def at(self, key: IntArray) -> FloatArray:
        return self.value[np.searchsorted(self.key, key)]


def paired_figures(
    runs: Mapping[str, Sequence[ScoredRun]], settings: ScoreSettings
) -> dict[str, Any]:
    """Return the paired figures of trackers, by name, of the same runs in the same order.

    `common_ticks` counts the ticks at which all `compared` trackers estimate the state of a launch;
    those of `without_estimates` never do. `states`, `launch` and `impact_by_phase` are tables of
    what all compared trackers estimate, `by_time` the same of states in bins of time since
    ignition: the `count`, the `errors` of trackers, the `best` one, and the `differences` of the
    others to it with their intervals. `best` is the tracker with the least energy score of
    position, None where nothing is common; `certain` are the others that are worse for certain, to
    95 %.
    """
    energies = {name: _states(own, DECIDING.name) for name, own in runs.items()}
    compared = {name: runs[name] for name, own in energies.items() if len(own.key)}
    common = _common([energies[name] for name in compared])
    several_runs = len(next(iter(runs.values()))) > 1
    states = {
        each.name: {name: _states(own, each.name) for name, own in compared.items()}
        for each in STATE_MEASURES
    }
    tables = _state_tables(states, common, several_runs)
    best = tables[DECIDING.name]["best"]
    differences = tables[DECIDING.name]["differences"]
    return {
        "compared": list(compared),
        "without_estimates": [name for name in runs if name not in compared],
        "ticks": {name: len(own.key) for name, own in energies.items()},
        "common_ticks": len(common),
        "paired_over": "runs" if several_runs else "launches",
        "best": best,
        "certain": [name for name, each in differences.items() if each["interval_95"][0] > 0.0],
        "states": tables,
        "nees": {
            name: mean(_states(own, "nees").of(common) / 6.0) for name, own in compared.items()
        },
        "launch": _common_table(
            {name: _launches(own) for name, own in compared.items()}, LAUNCH, several_runs
        ),
        "impact_by_phase": _impact_tables(compared, several_runs),
        "by_time": [
            {"since_ignition_s": [start_s, end_s], **_state_tables(states, rows, several_runs)}
            for start_s, end_s, rows in _bins(common, settings.bin_s)
        ],
    }


def _state_tables(
    states: Mapping[str, Mapping[str, "_Values"]], key: IntArray, several_runs: bool
) -> dict[str, Any]:
    return {
        each.name: _table(states[each.name], key, each, several_runs) for each in STATE_MEASURES
    }


def _impact_tables(
    runs: Mapping[str, Sequence[ScoredRun]], several_runs: bool
) -> list[dict[str, Any]]:
    """Return the tables of impacts that are predicted at each phase of a flight."""
    tables = []
    for number, phase in enumerate(PHASES):
        values = {name: _impacts(own, number) for name, own in runs.items()}
        tables.append({"phase": phase, **_common_table(values, IMPACT, several_runs)})
    return tables


def _bins(common: IntArray, width_s: float) -> list[tuple[float, float, IntArray]]:
    """Return the bins, of a width that leaves at most `MOST_BINS`, with the keys in each; empty
    ones are left out.
    """
    since_s = 1e-3 * (common % _TIMES)
    while len(np.unique(np.floor(since_s / width_s))) > MOST_BINS:
        width_s *= 2.0
    number = np.floor(since_s / width_s).astype(np.int64)
    return [
        (each * width_s, (each + 1) * width_s, common[number == each])
        for each in np.unique(number).tolist()
    ]


def _keys(run: int, target: IntArray, since_s: FloatArray | None = None) -> IntArray:
    time_ms = 0 if since_s is None else np.rint(1e3 * since_s).astype(np.int64)
    return (run * _TARGETS + target.astype(np.int64)) * _TIMES + time_ms


def _clusters(key: IntArray, several_runs: bool) -> IntArray:
    """Return what keys are of: runs, where there are several, for a scene's launches are the same
    in each.
    """
    return key // (_TIMES * _TARGETS if several_runs else _TIMES)


def _joined(parts: Sequence[tuple[IntArray, FloatArray]]) -> _Values:
    return _Values.known(
        np.concatenate([key for key, _ in parts]), np.concatenate([value for _, value in parts])
    )


def _states(runs: Sequence[ScoredRun], name: str) -> _Values:
    return _joined(
        [
            (_keys(run, own.states.target, own.states.since_s), getattr(own.states, name))
            for run, own in enumerate(runs)
        ]
    )


def _launches(runs: Sequence[ScoredRun]) -> _Values:
    return _joined(
        [
            (_keys(run, own.points.target), own.points.launch_energy_m)
            for run, own in enumerate(runs)
        ]
    )


def _impacts(runs: Sequence[ScoredRun], phase: int) -> _Values:
    parts = []
    for run, own in enumerate(runs):
        here = own.impact_phase == phase
        parts.append((_keys(run, own.impacts.target[here]), own.impacts.energy_m[here]))
    return _joined(parts)


def _common(values: Sequence[_Values]) -> IntArray:
    return (
        reduce(np.intersect1d, [own.key for own in values])
        if values
        else np.empty(0, dtype=np.int64)
    )


def _common_table(
    values: Mapping[str, _Values], measure: Measure, several_runs: bool
) -> dict[str, Any]:
    """Return the table of what all trackers that have any estimate have."""
    have = {name: own for name, own in values.items() if len(own.key)}
    return _table(have, _common(list(have.values())), measure, several_runs)


def _table(
    values: Mapping[str, _Values], key: IntArray, measure: Measure, several_runs: bool
) -> dict[str, Any]:
    """Return the `count` of keys, the `errors` of trackers there, the `best` one, and the
    `differences` of the others to it with their intervals, of the trackers in `values`.
    """
    if not len(key):
        return {"unit": measure.unit, "count": 0, "errors": {}, "best": None, "differences": {}}
    cluster = np.unique(_clusters(key, several_runs), return_inverse=True)[1]
    count = np.bincount(cluster).astype(np.float64)
    columns = {name: own.at(key) for name, own in values.items()}
    sums: dict[str, FloatArray] = {
        name: np.bincount(cluster, np.square(column) if measure.is_squared else column).astype(
            np.float64
        )
        for name, column in columns.items()
    }
    average: Callable[[FloatArray], FloatArray] = np.sqrt if measure.is_squared else np.positive
    errors = {name: float(average(total.sum() / count.sum())) for name, total in sums.items()}
    best = min(errors, key=lambda name: errors[name])
    differences = {
        name: _difference(errors[name] - errors[best], total, sums[best], count, average)
        for name, total in sums.items()
        if name != best
    }
    return {
        "unit": measure.unit,
        "count": len(key),
        "errors": errors,
        "best": best,
        "differences": differences,
    }


def _difference(
    value: float,
    ours: FloatArray,
    theirs: FloatArray,
    count: FloatArray,
    average: Callable[[FloatArray], FloatArray],
) -> dict[str, Any]:
    """Return a difference of averages with its 95 % interval by the jackknife over clusters (Efron,
    1982, chapter 3).

    Of sums (k,) in clusters of counts (k,); the interval is nan for one cluster.
    """
    if len(count) < 2:
        return {"value": value, "interval_95": [np.nan, np.nan]}
    left = count.sum() - count
    left_out = average((ours.sum() - ours) / left) - average((theirs.sum() - theirs) / left)
    error = np.sqrt((len(count) - 1) * np.mean(np.square(left_out - left_out.mean())))
    half = float(student.ppf(0.975, len(count) - 1) * error)
    return {"value": value, "interval_95": [value - half, value + half]}
