"""Sobol indices of a study: how much of the variance of a figure each setting explains, alone and with
all others.
"""

import numpy as np
from matplotlib.axes import Axes

from opir_report.canvas import legend_beside, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import series_hue
from opir_report.saved_study import SavedStudy
from opir_report.words import setting_words

#: Columns of the indices with their names in the legend.
INDICES = {"first": "alone (first order)", "total": "with all others (total)"}


def sensitivity_rows(study: SavedStudy, figure: str) -> FigureData:
    """Return the indices of a figure by setting, the largest total first; without those that are
    not known, of a figure that does not vary.
    """
    if study.sensitivity is None:
        return FigureData.of_rows(("setting", *INDICES), ())
    rows = study.sensitivity.at("figure", figure)
    rows = rows.where(np.isfinite(rows["total"]))
    return rows.where(np.argsort(-rows["total"], kind="stable"))


def sensitivity_plot(axes: Axes, study: SavedStudy, figure: str) -> Axes:
    """Draw the indices of a figure with their 95 % intervals, a row for each setting."""
    rows = sensitivity_rows(study, figure)
    if not len(rows):
        return without_data(axes, f"{figure} has no Sobol indices")
    place = -np.arange(len(rows), dtype=np.float64)
    hues = [series_hue(number, words) for number, words in enumerate(INDICES.values())]
    for name, hue, offset in zip(INDICES, hues, (0.12, -0.12), strict=True):
        axes.errorbar(
            rows[name],
            place + offset,
            xerr=rows[f"{name}_half_95"],
            fmt="o",
            color=hue.colour,
            markersize=4,
            capsize=3,
        )
    axes.set_yticks(place, [setting_words(path)[0] for path in rows["setting"].tolist()])
    axes.set_ylim(place[-1] - 0.6, 0.6)
    axes.set_xlim(min(-0.05, axes.get_xlim()[0]), max(1.05, axes.get_xlim()[1]))
    axes.set_xlabel("share of the variance over the designs")
    axes.grid(axis="y", visible=False)
    legend_beside(axes, hues)
    return axes
