"""Trackers side by side on the same runs: errors where all of them have an estimate, and their
paired differences.

A tracker that starts late is not scored at the early, bad ticks: errors over each tracker's own
ticks say little of which is better. Here all are scored at the same ticks, launches and phases, and
coverage is a figure of its own.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import reduce
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_scoring.containments import figure, jackknife_half, mean
from opir_scoring.impacts import PHASES
from opir_scoring.scorecards import ScoredRun, ScoreSettings

#: Largest number of bins of time since ignition of a comparison: until then the width doubles.
MAX_BINS = 7

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
    """Errors (n,) by unique keys (n,)."""

    key: IntArray
    value: FloatArray

    @classmethod
    def of_runs(cls, columns: Iterable[tuple[IntArray, FloatArray]]) -> "_Values":
        """Return the finite errors of runs, each with its keys."""
        keys, values = map(np.concatenate, zip(*columns, strict=True))
        rows = np.flatnonzero(np.isfinite(values))
        unique, index = np.unique(keys[rows], return_index=True)
        return cls(unique, values[rows][index])

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
    energies = {name: _states(of_runs, DECIDING.name) for name, of_runs in runs.items()}
    compared = {name: runs[name] for name, values in energies.items() if len(values.key)}
    common = _common([energies[name] for name in compared])
    several_runs = len(next(iter(runs.values()))) > 1
    states = {
        measure.name: {name: _states(of_runs, measure.name) for name, of_runs in compared.items()}
        for measure in STATE_MEASURES
    }
    tables = _state_tables(states, common, several_runs)
    deciding = tables[DECIDING.name]
    launches = {name: _launches(of_runs) for name, of_runs in compared.items()}
    nees = {name: _states(of_runs, "nees").of(common) for name, of_runs in compared.items()}
    return {
        "compared": list(compared),
        "without_estimates": [name for name in runs if name not in compared],
        "ticks": {name: len(values.key) for name, values in energies.items()},
        "common_ticks": len(common),
        "paired_over": "runs" if several_runs else "launches",
        "best": deciding["best"],
        "certain": [
            name
            for name, difference in deciding["differences"].items()
            if difference["interval_95"][0] > 0.0
        ],
        "states": tables,
        "nees": {name: mean(values / 6.0) for name, values in nees.items()},
        "launch": _common_table(launches, LAUNCH, several_runs),
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
        measure.name: _table(states[measure.name], key, measure, several_runs)
        for measure in STATE_MEASURES
    }


def _impact_tables(
    runs: Mapping[str, Sequence[ScoredRun]], several_runs: bool
) -> list[dict[str, Any]]:
    """Return the tables of impacts that are predicted at each phase of a flight."""
    tables = []
    for number, phase in enumerate(PHASES):
        values = {name: _impacts(of_runs, number) for name, of_runs in runs.items()}
        tables.append({"phase": phase, **_common_table(values, IMPACT, several_runs)})
    return tables


def _bins(common: IntArray, width_s: float) -> list[tuple[float, float, IntArray]]:
    """Return the bins, of a width that leaves at most `MAX_BINS`, with the keys in each; empty
    ones are left out.
    """
    since_s = 1e-3 * (common % _TIMES)
    while len(np.unique(np.floor(since_s / width_s))) > MAX_BINS:
        width_s *= 2.0
    number = np.floor(since_s / width_s).astype(np.int64)
    return [
        (bin_ * width_s, (bin_ + 1) * width_s, common[number == bin_])
        for bin_ in np.unique(number).tolist()
    ]


def _keys(run: int, target: IntArray, since_s: FloatArray | None = None) -> IntArray:
    time_ms = 0 if since_s is None else np.rint(1e3 * since_s).astype(np.int64)
    return (run * _TARGETS + target.astype(np.int64)) * _TIMES + time_ms


def _clusters(key: IntArray, several_runs: bool) -> IntArray:
    """Return the clusters (n,) of keys: runs, where there are several, for a scene's launches are
    the same in each; else launches.
    """
    return key // (_TIMES * _TARGETS if several_runs else _TIMES)


def _states(runs: Sequence[ScoredRun], name: str) -> _Values:
    return _Values.of_runs(
        (_keys(number, run.states.target, run.states.since_s), getattr(run.states, name))
        for number, run in enumerate(runs)
    )


def _launches(runs: Sequence[ScoredRun]) -> _Values:
    return _Values.of_runs(
        (_keys(number, run.points.target), run.points.launch_energy_m)
        for number, run in enumerate(runs)
    )


def _impacts(runs: Sequence[ScoredRun], phase: int) -> _Values:
    impacts = [run.impacts.take(run.impact_phase == phase) for run in runs]
    return _Values.of_runs(
        (_keys(number, scores.target), scores.energy_m) for number, scores in enumerate(impacts)
    )


def _common(values: Sequence[_Values]) -> IntArray:
    if not values:
        return np.empty(0, dtype=np.int64)
    return reduce(np.intersect1d, [errors.key for errors in values])


def _common_table(
    values: Mapping[str, _Values], measure: Measure, several_runs: bool
) -> dict[str, Any]:
    """Return the table of the keys that all trackers with an estimate have."""
    estimated = {name: errors for name, errors in values.items() if len(errors.key)}
    return _table(estimated, _common(list(estimated.values())), measure, several_runs)


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
    sums: dict[str, FloatArray] = {}
    for name, errors_of in values.items():
        column = errors_of.at(key)
        weights = np.square(column) if measure.is_squared else column
        sums[name] = np.bincount(cluster, weights).astype(np.float64)
    average: Callable[[FloatArray], FloatArray] = np.sqrt if measure.is_squared else np.positive
    errors = {name: float(average(total.sum() / count.sum())) for name, total in sums.items()}
    best = min(errors, key=lambda name: errors[name])

    differences: dict[str, dict[str, Any]] = {}
    for name, total in sums.items():
        if name != best:
            difference = errors[name] - errors[best]
            half = _half_interval(total, sums[best], count, average)
            differences[name] = figure(difference, difference - half, difference + half)
    return {
        "unit": measure.unit,
        "count": len(key),
        "errors": errors,
        "best": best,
        "differences": differences,
    }


def _half_interval(
    total: FloatArray,
    best_total: FloatArray,
    count: FloatArray,
    average: Callable[[FloatArray], FloatArray],
) -> float:
    """Return half of the 95 % interval of a difference of averages, by the jackknife over clusters
    (Efron, 1982, chapter 3).

    Of sums (k,) in clusters of counts (k,); nan for one cluster.
    """
    if len(count) < 2:
        return np.nan
    remaining = count.sum() - count
    return jackknife_half(
        average((total.sum() - total) / remaining)
        - average((best_total.sum() - best_total) / remaining)
    )
