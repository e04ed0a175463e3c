"""Which panels an effect is drawn in: a setting along the axis, one as series, one as small multiples."""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_report.figure_data import FigureData
from opir_report.saved_study import SavedStudy

#: A second setting with more values than this is drawn as small multiples instead of series.
_SERIES = 4
#: The most small multiples.
_PANELS = 6
#: A figure's values over a wider range than this have a logarithmic axis, and a setting's.
WIDE_FIGURE, WIDE_SETTING = 30.0, 8.0


#: Kinds of designs that are not combinations: samples, and the way of an optimisation.
SAMPLED = ("latin-hypercube", "optimise")


@frozen(eq=False)
class EffectPanel:
    """A panel: its title, the path along the axis, the paths whose values are series, and the rows of its designs."""

    title: str
    path: str | None
    series: tuple[str, ...]
    rows: FigureData
    #: Whether designs are samples, drawn as points without lines.
    is_sampled: bool = False
    #: The setting whose value is the title, "" for none.
    split: str = ""


def usual_path(study: SavedStudy, rows: FigureData) -> str | None:
    """Return the path along which a figure is drawn: that with the most values, numbers before names."""

    def rank(path: str) -> tuple[bool, int]:
        return rows[path].dtype.kind in "if", len(set(rows[path].tolist()))

    return max(study.paths, key=rank) if study.paths else None


def effect_panels(study: SavedStudy, figure: str) -> list[EffectPanel]:
    """Return the panels of a figure's effects, none if no design has a value.

    A one-at-a-time study and a Latin hypercube have a panel for each setting. Of all combinations the setting with the
    most values lies along the axis; the second is series, or small multiples if it has more than four values; a third
    is small multiples.
    """
    rows = study.rows(figure)
    rows = rows.where(np.isfinite(rows["mean"]))
    if not len(rows):
        return []
    paths, design = study.paths, study.definition["design"]
    if design in SAMPLED:
        return [EffectPanel("", path, (), rows, is_sampled=True) for path in paths[:_PANELS]]
    if design == "one-at-a-time" and len(paths) > 1:
        return _one_at_a_time(study, rows)
    along = usual_path(study, rows)
    others = sorted((each for each in paths if each != along), key=lambda path: len(_levels(rows, path)))
    split = _split_path(rows, others)
    if split is None:
        return [EffectPanel("", along, tuple(others), rows)]
    series = tuple(each for each in others if each != split)
    parts = [rows.where(rows[split] == level) for level in _levels(rows, split)]
    return [EffectPanel(study.short_labels(part, [split])[0], along, series, part, split=split) for part in parts]


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
    """Return whether values (n,) are positive and span such a ratio, so that they need a logarithmic axis."""
    known = values[np.isfinite(values)]
    return bool(len(known) > 1 and known.min() > 0.0 and known.max() / known.min() >= ratio)
