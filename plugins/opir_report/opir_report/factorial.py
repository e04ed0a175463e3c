"""Effects of a study of all combinations: means over the other settings, with intervals over runs
of the same seeds.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from attrs import evolve, frozen
from scipy.special import stdtrit

from opir_core.arrays import FloatArray
from opir_report.figure_data import FigureData
from opir_report.saved_study import SavedStudy


@frozen(eq=False)
class FactorialRuns:
    """The values of a figure by setting and run: `values` has an axis for each path, and a last one
    for the runs.

    Levels are in the order of the study. A run without a value is nan.
    """

    figure: str
    paths: tuple[str, ...]
    levels: tuple[list[Any], ...]
    values: FloatArray

    @classmethod
    def of(cls, study: SavedStudy, figure: str) -> "FactorialRuns | None":
        """Return the runs of a figure, or None for a study without its runs, or not of all
        combinations.
        """
        runs = study.runs
        if (
            runs is None
            or not len(runs)
            or figure not in runs.columns
            or study.definition["design"] != "factorial"
        ):
            return None
        levels = tuple(list(dict.fromkeys(runs[path].tolist())) for path in study.paths)
        shape = [*map(len, levels), int(runs["replicate"].max()) + 1]
        values = np.full(shape, np.nan)
        places = [
            np.array([own.index(value) for value in runs[path].tolist()])
            for path, own in zip(study.paths, levels, strict=True)
        ]
        values[(*places, runs["replicate"])] = runs[figure]
        return cls(figure, tuple(study.paths), levels, values)

    def at(self, path: str, level: Any) -> "FactorialRuns":
        """Return the runs at one level of a setting, which then no longer varies."""
        axis = self.paths.index(path)
        others = [place for place in range(len(self.paths)) if place != axis]
        values = np.take(self.values, self.levels[axis].index(level), axis=axis)
        paths = tuple(self.paths[place] for place in others)
        levels = tuple(self.levels[place] for place in others)
        return evolve(self, paths=paths, levels=levels, values=values)

    def averaged(self, kept: Sequence[str]) -> FloatArray:
        """Return means over the settings that are not kept: an axis for each of `kept` in its
        order, and the runs.

        A run counts only with a value at all of these settings: elsewhere it is nan.
        """
        others = tuple(place for place, path in enumerate(self.paths) if path not in kept)
        left = [path for path in self.paths if path in kept]
        means = self.values.mean(axis=others) if others else self.values
        return np.transpose(means, [*(left.index(path) for path in kept), len(left)])

    def rows(self, kept: Sequence[str]) -> FigureData:
        """Return a row for each combination of the settings kept: their values, figure, mean,
        low_95, high_95.
        """
        mean, low, high = intervals(self.averaged(kept))
        grid = np.meshgrid(*(np.arange(len(self._levels_of(path))) for path in kept), indexing="ij")
        columns = {
            path: np.array(self._levels_of(path))[place.ravel()]
            for path, place in zip(kept, grid, strict=True)
        }
        columns["figure"] = np.full(mean.size, self.figure)
        return FigureData(
            {**columns, "mean": mean.ravel(), "low_95": low.ravel(), "high_95": high.ravel()}
        )

    def change(self, path: str) -> tuple[float, float, float]:
        """Return the change from the first to the last value of a setting, paired over runs, and
        its 95 % interval.
        """
        means = self.averaged([path])
        mean, low, high = intervals(means[-1] - means[0])
        return float(mean), float(low), float(high)

    def _levels_of(self, path: str) -> list[Any]:
        return self.levels[self.paths.index(path)]


def intervals(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return means of values (..., n) over the last axis, and the ends of their 95 % intervals
    (Student's t).

    nan does not count; a mean without values is nan, as is an interval of fewer than two.
    """
    known = np.isfinite(values)
    count = known.sum(axis=-1)
    mean = np.where(known, values, 0.0).sum(axis=-1) / np.where(count > 0, count, np.nan)
    squares = np.where(known, np.square(values - mean[..., None]), 0.0).sum(axis=-1)
    freedom = np.where(count > 1, count - 1.0, np.nan)
    half = stdtrit(freedom, 0.975) * np.sqrt(squares / freedom / np.where(count > 0, count, np.nan))
    return mean, mean - half, mean + half


def ranked_settings(runs: FactorialRuns) -> list[str]:
    """Return the settings with two values or more, that which moves the mean of the figure the
    furthest first.
    """
    spans = dict[str, float]()
    for path, levels in zip(runs.paths, runs.levels, strict=True):
        mean = intervals(runs.averaged([path]))[0]
        if len(levels) > 1:
            spans[path] = float(np.ptp(mean[np.isfinite(mean)])) if np.isfinite(mean).any() else 0.0
    return sorted(spans, key=lambda path: -spans[path])
