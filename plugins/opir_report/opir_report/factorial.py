"""Effects of a study of all combinations: means over the other settings, with intervals over runs
of the same seeds.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from attrs import evolve, frozen
from scipy.special import stdtrit

from opir_core.arrays import FloatArray
from opir_report.figure_data import FigureData
from opir_report.saved_study import SavedStudy


class MeanInterval(NamedTuple):
    """Means (...,) and the ends of their 95 % intervals."""

    mean: FloatArray
    low: FloatArray
    high: FloatArray


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
        if study.definition["design"] != "factorial" or not runs or figure not in runs.columns:
            return None
        levels = tuple(runs.levels(path) for path in study.paths)
        values = np.full([*map(len, levels), int(runs["replicate"].max()) + 1], np.nan)
        places = [
            np.array([own_levels.index(value) for value in runs[path].tolist()])
            for path, own_levels in zip(study.paths, levels, strict=True)
        ]
        values[(*places, runs["replicate"])] = runs[figure]
        return cls(figure, tuple(study.paths), levels, values)

    def at(self, path: str, level: Any) -> "FactorialRuns":
        """Return the runs at one level of a setting, which then no longer varies."""
        axis = self.paths.index(path)
        return evolve(
            self,
            paths=self.paths[:axis] + self.paths[axis + 1 :],
            levels=self.levels[:axis] + self.levels[axis + 1 :],
            values=np.take(self.values, self.levels[axis].index(level), axis=axis),
        )

    def averaged(self, paths: Sequence[str]) -> FloatArray:
        """Return means over the other settings: an axis for each of `paths` in its order, and the
        runs.

        A run counts only with a value at all of the other settings: elsewhere it is nan.
        """
        others = tuple(axis for axis, path in enumerate(self.paths) if path not in paths)
        axes = [path for path in self.paths if path in paths]
        means = self.values.mean(axis=others) if others else self.values
        return np.transpose(means, [*(axes.index(path) for path in paths), len(axes)])

    def rows(self, paths: Sequence[str]) -> FigureData:
        """Return a row for each combination of some settings: their values, figure, mean, low_95,
        high_95.
        """
        mean, low, high = intervals(self.averaged(paths))
        levels = {path: np.array(self.levels_of(path)) for path in paths}
        grid = np.meshgrid(*(np.arange(len(levels[path])) for path in paths), indexing="ij")
        columns = {
            path: levels[path][place.ravel()] for path, place in zip(paths, grid, strict=True)
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

    def levels_of(self, path: str) -> list[Any]:
        """Return the levels of a setting."""
        return self.levels[self.paths.index(path)]


def intervals(values: FloatArray) -> MeanInterval:
    """Return means of values (..., n) over the last axis, and the ends of their 95 % intervals
    (Student's t).

    nan does not count; a mean without values is nan, as is an interval of fewer than two.
    """
    is_known = np.isfinite(values)
    count = is_known.sum(axis=-1)
    divisor = np.where(count > 0, count, np.nan)
    mean = np.where(is_known, values, 0.0).sum(axis=-1) / divisor
    squares = np.where(is_known, np.square(values - mean[..., None]), 0.0).sum(axis=-1)
    freedom = np.where(count > 1, count - 1.0, np.nan)
    half = stdtrit(freedom, 0.975) * np.sqrt(squares / freedom / divisor)
    return MeanInterval(mean, mean - half, mean + half)


def ranked_settings(runs: FactorialRuns) -> list[str]:
    """Return the settings with two values or more, that which moves the mean of the figure the
    furthest first.
    """
    spans = dict[str, float]()
    for path, levels in zip(runs.paths, runs.levels, strict=True):
        mean = intervals(runs.averaged([path])).mean
        mean = mean[np.isfinite(mean)]
        if len(levels) > 1:
            spans[path] = float(np.ptp(mean)) if len(mean) else 0.0
    return sorted(spans, key=lambda path: -spans[path])
