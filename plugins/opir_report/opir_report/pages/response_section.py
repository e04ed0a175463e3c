"""The section of a study's report on its settings: main effects, interactions, and contours over
two of them.
"""

from functools import partial

from opir_report.pages.page import ReportFigure, ReportSection
from opir_report.pages.run_sections import figure_of
from opir_report.pages.sentences import words_of
from opir_report.plots.responses import (
    contour_figure,
    contour_pair,
    interaction_figure,
    interaction_pairs,
    main_effect_rows,
    main_effects_figure,
    parts_of,
)
from opir_report.saved_study import SavedStudy

_TEXT = (
    "What each setting does alone, what it does at each value of another one, and which pairs of"
    " values are enough."
    " Means are over all other settings; their intervals are over runs of the same seeds in all"
    " designs, and a run"
    " counts that has a value in all of them."
)
_MAIN = "mean at each value of a setting over all others, with 95 % intervals."
_INTERACTION = (
    "effect of a setting at each value of another one, with 95 % intervals: lines that are parallel"
    " add up."
)
_CONTOUR = "lines of equal mean over two settings, linear between the values that were run."
#: The most figures with main effects and contours.
_SHOWN = 3


def response_section(study: SavedStudy) -> ReportSection | None:
    """Return the section, or None for a study that is not of all combinations of two settings."""
    figures = [
        each for each in study.shown if study.constant(each) is None and parts_of(study, each)
    ][:_SHOWN]
    if not figures:
        return None
    parts: list[ReportFigure] = []
    for each in figures:
        draw = partial(main_effects_figure, study=study, figure=each)
        words = f"{words_of(study, each)}: {_MAIN}"
        parts.append(
            figure_of(
                f"main-effects-{each}", draw, 3.4, (words, words), main_effect_rows(study, each)
            )
        )
    if interaction_pairs(study, figures[0]):
        parts.append(_interactions(study, figures[0]))
    parts += [_contours(study, each) for each in figures if contour_pair(study, each) is not None]
    return ReportSection("settings", "What each setting does", _TEXT, parts)


def _interactions(study: SavedStudy, figure: str) -> ReportFigure:
    words = f"{words_of(study, figure)}: {_INTERACTION}"
    draw = partial(interaction_figure, study=study, figure=figure)
    height_in = 0.4 + 3.1 * len(parts_of(study, figure))
    return figure_of(f"interactions-{figure}", draw, height_in, (words, words), study.rows(figure))


def _contours(study: SavedStudy, figure: str) -> ReportFigure:
    words = f"{words_of(study, figure)}: {_CONTOUR}"
    draw = partial(contour_figure, study=study, figure=figure)
    return figure_of(f"contours-{figure}", draw, 3.8, (words, words), study.rows(figure))
