"""Which panels an effect is drawn in: a setting along the axis, one as series, one as small
multiples.
"""

from collections.abc import Sequence

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray
from opir_report.figure_data import FigureData
from opir_report.saved_study import SavedStudy

#: A second setting with more values than this is drawn as small multiples instead of series.
_SERIES = 4
#: The most small multiples, and how many are beside each other.
_PANELS = 6
_BESIDE = 3
#: A figure's values over a wider range than this have a logarithmic axis, and a setting's.
WIDE_FIGURE = 30.0
WIDE_SETTING = 8.0


#: Kinds of designs that are not combinations: samples, and the way of an optimisation.
SAMPLED = ("latin-hypercube", "optimise")


@frozen(eq=False)
class EffectPanel:
    """A panel: its title, the path along the axis, the paths whose values are series, and the rows
    of its designs.
    """

    title: str
    path: str | None
    series: tuple[str, ...]
    rows: FigureData
    #: Whether designs are samples, drawn as points without lines.
    is_sampled: bool = False
    #: The settings whose values are the title.
    splits: tuple[str, ...] = ()


def usual_path(paths: Sequence[str], rows: FigureData) -> str | None:
    """Return the path along which a figure is drawn: that with the most values, numbers before
    names.
    """

    def rank(path: str) -> tuple[bool, int]:
        return rows[path].dtype.kind in "if", len(set(rows[path].tolist()))

    return max(paths, key=rank) if paths else None


def effect_panels(study: SavedStudy, figure: str) -> list[EffectPanel]:
    """Return the panels of a figure's effects, none if no design has a value.

    A one-at-a-time study and a Latin hypercube have a panel for each setting. Of all combinations
    the setting with the most values lies along the axis; the second is series, or small multiples
    if it has more than four values; a third is small multiples.
    """
    rows = study.rows(figure)
    rows = rows.where(np.isfinite(rows["mean"]))
    if not len(rows):
        return []
    paths = study.paths
    design = study.definition["design"]
    if design in SAMPLED:
        return [EffectPanel("", path, (), rows, is_sampled=True) for path in paths[:_PANELS]]
    if design == "one-at-a-time" and len(paths) > 1:
        return _one_at_a_time(study, rows)
    free = [path for path in paths if path != study.split]
    along = usual_path(free, rows)
    others = sorted(
        (each for each in free if each != along), key=lambda path: len(_levels(rows, path))
    )
    split = _split_path(rows, others)
    splits = tuple(path for path in (study.split, split) if path)
    series = tuple(each for each in others if each != split)
    found = [EffectPanel("", along, series, rows, splits=splits)]
    for path in splits:
        found = [evolve(each, rows=own) for each in found for own in _by_level(each.rows, path)]
    return [evolve(each, title=study.short_labels(each.rows, splits)[0]) for each in found]


def _by_level(rows: FigureData, path: str) -> list[FigureData]:
    return [rows.where(rows[path] == level) for level in _levels(rows, path)]


def panel_columns(panels: Sequence[EffectPanel]) -> int:
    """Return how many panels are beside each other: those of one value of the first setting in
    titles, if they fit.
    """
    first = panels[0].splits[0] if len(panels[0].splits) > 1 else None
    alike = (
        0
        if first is None
        else sum(each.rows[first][0] == panels[0].rows[first][0] for each in panels)
    )
    return alike if 1 < alike <= _BESIDE else min(len(panels), _BESIDE)


def _split_path(rows: FigureData, others: Sequence[str]) -> str | None:
    """Return the setting whose values are small multiples, if any fits."""
    fitting = [path for path in others if len(_levels(rows, path)) <= _PANELS]
    if len(others) == 1:
        return others[0] if fitting and len(_levels(rows, others[0])) > _SERIES else None
    return fitting[-1] if fitting else None


def _levels(rows: FigureData, path: str) -> list[object]:
    return list(dict.fromkeys(rows[path].tolist()))


def _one_at_a_time(study: SavedStudy, rows: FigureData) -> list[EffectPanel]:
    """Return a panel for each path: the first design and those that change this path alone."""
    first = {path: study.rows(str(rows["figure"][0]))[path][0] for path in study.paths}
    panels = list[EffectPanel]()
    for path in study.paths[:_PANELS]:
        alike = [rows[each] == first[each] for each in study.paths if each != path]
        panels.append(EffectPanel("", path, (), rows.where(np.logical_and.reduce(alike))))
    return [each for each in panels if len(each.rows)]


def is_wide(values: FloatArray, ratio: float) -> bool:
    """Return whether values (n,) are positive and span such a ratio, so that they need a
    logarithmic axis.
    """
    known = values[np.isfinite(values)]
    return bool(len(known) > 1 and known.min() > 0.0 and known.max() / known.min() >= ratio)
