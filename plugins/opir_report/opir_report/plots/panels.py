"""Panels of an effect: a setting along the axis, one as series, one as small multiples."""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_report.figure_data import FigureData
from opir_report.saved_study import SavedStudy

#: A second setting with more values than this is drawn as small multiples instead of series.
_SERIES = 4
#: The most small multiples, and the most beside each other.
_PANELS = 6
_BESIDE = 3
#: A figure's values over a wider range than this have a logarithmic axis, and a setting's.
WIDE_FIGURE = 30.0
WIDE_SETTING = 8.0


#: Kinds of designs that are not combinations: samples, and the way of an optimisation.
SAMPLED = ("latin-hypercube", "sobol", "optimise")


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
    return max(paths, key=lambda path: axis_rank(rows, path)) if paths else None


def axis_rank(rows: FigureData, path: str) -> tuple[bool, int]:
    """Return how well a path fits along an axis: whether it has numbers, and how many values."""
    return rows[path].dtype.kind in "if", len(set(rows[path].tolist()))


def rows_with_mean(study: SavedStudy, figure: str) -> FigureData:
    """Return the rows of the designs that have a value of a figure."""
    rows = study.rows(figure)
    return rows.where(np.isfinite(rows["mean"]))


def effect_panels(study: SavedStudy, figure: str) -> list[EffectPanel]:
    """Return the panels of a figure's effects, none if no design has a value.

    A one-at-a-time study and a Latin hypercube have a panel for each setting. Of all combinations
    the setting with the most values lies along the axis; the second is series, or small multiples
    if it has more than four values; a third is small multiples.
    """
    rows = rows_with_mean(study, figure)
    if not len(rows):
        return []
    design = study.definition["design"]
    if design in SAMPLED:
        return [EffectPanel("", path, (), rows, is_sampled=True) for path in study.paths[:_PANELS]]
    if design == "one-at-a-time" and len(study.paths) > 1:
        return _one_at_a_time(study, rows)
    return _combinations(study, rows)


def _combinations(study: SavedStudy, rows: FigureData) -> list[EffectPanel]:
    """Return the panels of a study of all combinations."""
    paths = [path for path in study.paths if path != study.split]
    axis_path = usual_path(paths, rows)
    others = sorted(
        (path for path in paths if path != axis_path), key=lambda path: len(rows.levels(path))
    )
    split = _split_path(rows, others)
    splits = tuple(path for path in (study.split, split) if path)
    series = tuple(path for path in others if path != split)
    tables = _split_rows(rows, splits)
    titles = [study.short_labels(table, splits)[0] for table in tables]
    return [
        EffectPanel(title, axis_path, series, table, splits=splits)
        for title, table in zip(titles, tables, strict=True)
    ]


def _split_rows(rows: FigureData, paths: Sequence[str]) -> list[FigureData]:
    """Return the rows of each combination of some settings."""
    tables = [rows]
    for path in paths:
        tables = [table.at(path, level) for table in tables for level in table.levels(path)]
    return tables


def panel_columns(panels: Sequence[EffectPanel]) -> int:
    """Return how many panels are beside each other: those of one value of the first setting in
    titles, if they fit.
    """
    splits = panels[0].splits
    count = 0
    if len(splits) > 1:
        levels = [panel.rows[splits[0]][0] for panel in panels]
        count = levels.count(levels[0])
    return count if 1 < count <= _BESIDE else min(len(panels), _BESIDE)


def _split_path(rows: FigureData, paths: Sequence[str]) -> str | None:
    """Return the setting whose values are small multiples, if any fits."""
    fitting = [path for path in paths if len(rows.levels(path)) <= _PANELS]
    if not fitting or (len(paths) == 1 and len(rows.levels(paths[0])) <= _SERIES):
        return None
    return fitting[-1]


def _one_at_a_time(study: SavedStudy, rows: FigureData) -> list[EffectPanel]:
    """Return a panel for each path: the first design and those that change this path alone."""
    designs = study.rows(str(rows["figure"][0]))
    panels = list[EffectPanel]()
    for path in study.paths[:_PANELS]:
        panel_rows = rows
        for other in study.paths:
            if other != path:
                panel_rows = panel_rows.at(other, designs[other][0])
        panels.append(EffectPanel("", path, (), panel_rows))
    return [panel for panel in panels if len(panel.rows)]


def is_wide(values: FloatArray, ratio: float) -> bool:
    """Whether values (n,) are positive and span such a ratio, so that they need a logarithmic
    axis.
    """
    finite = values[np.isfinite(values)]
    return bool(len(finite) > 1 and finite.min() > 0.0 and finite.max() / finite.min() >= ratio)
