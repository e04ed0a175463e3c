"""The section of a study's report on its settings: main effects, interactions, and contours over
two of them.
"""

from functools import partial

from opir_report.pages.page import ReportSection
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
    " values are enough. Means are over all other settings; their intervals are over runs of the"
    " same seeds in all designs, and a run counts that has a value in all of them."
)
_MAIN = "mean at each value of a setting over all others, with 95 % intervals."
_INTERACTION = (
    "effect of a setting at each value of another one, with 95 % intervals: lines that are parallel"
    " add up."
)
_CONTOUR = "lines of equal mean over two settings, linear between the values that were run."


def response_section(study: SavedStudy) -> ReportSection | None:
    """Return the section, of up to three figures, or None for a study that is not of all
    combinations of two settings.
    """
    names = [figure for figure in study.varying if parts_of(study, figure)][:3]
    if not names:
        return None
    figures = [
        figure_of(
            f"main-effects-{figure}",
            partial(main_effects_figure, study=study, figure=figure),
            3.4,
            f"{words_of(study, figure)}: {_MAIN}",
            data=main_effect_rows(study, figure),
        )
        for figure in names
    ]
    if interaction_pairs(study, names[0]):
        figures.append(
            figure_of(
                f"interactions-{names[0]}",
                partial(interaction_figure, study=study, figure=names[0]),
                0.4 + 3.1 * len(parts_of(study, names[0])),
                f"{words_of(study, names[0])}: {_INTERACTION}",
                data=study.rows(names[0]),
            )
        )
    figures += [
        figure_of(
            f"contours-{figure}",
            partial(contour_figure, study=study, figure=figure),
            3.8,
            f"{words_of(study, figure)}: {_CONTOUR}",
            data=study.rows(figure),
        )
        for figure in names
        if contour_pair(study, figure) is not None
    ]
    return ReportSection("settings", "What each setting does", _TEXT, figures)
