"""The report of a study: the figures that were asked for first, then trades, every metric, and how
it was made.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from opir_core.cli import grouped
from opir_report.figure_data import FigureData
from opir_report.pages.files import write_page
from opir_report.pages.method_section import method_section
from opir_report.pages.page import ReportFigure, ReportPage, ReportSection, ReportTable
from opir_report.pages.paper import write_figures
from opir_report.pages.response_section import response_section
from opir_report.pages.run_sections import figure_of
from opir_report.pages.sentences import answers, mean_text, range_sentence, verdicts, words_of
from opir_report.plots.effects import difference_plot, effect_figure, effect_height_in
from opir_report.plots.panels import SAMPLED, effect_panels
from opir_report.plots.trades import (
    convergence_plot,
    convergence_rows,
    path_plot,
    tornado_plot,
    tornado_rows,
    trade_plot,
)
from opir_report.saved_study import SavedStudy, joined_studies, read_study
from opir_report.words import axis_label, number_words, setting_words

#: Figures of the answer, designs whose differences are drawn, and rows of a table.
_ANSWERS = 4
_DIFFERENCES_SHOWN = 16
_ROWS_SHOWN = 60
_EFFECT = (
    "Mean over runs with its 95 % interval, cut at 0 where no run has less, and at 1 for shares of"
    " launches. All"
    " designs see the same random numbers, so differences are more precise than the intervals of"
    " the means suggest."
)
_TRADE = (
    "Each point is a design. The line joins the designs that no other one beats in both figures."
)
_TORNADO = (
    "How far each setting moves the mean, over the values that it has in the study; the values at"
    " the ends are written"
    " there."
)
_PATH = "The designs in the order of their evaluation."
_CONVERGENCE = (
    "Mean over the first runs with its 95 % interval: more runs are needed where it has not"
    " settled."
)


def write_study_report(
    folder: str | Path | Sequence[str | Path], path: Path, *, with_data: bool = True
) -> list[Path]:
    """Write the report of the study in a folder, or of several studies side by side; return the
    files written.

    The data of each figure are written as Parquet into a folder beside the report. Raises
    `SceneError` for a folder without a study or studies that vary different settings, and
    `SinkError` where a file cannot be written.
    """
    return write_page(study_page(studies_in(folder)), path, with_data=with_data)


def write_study_figures(folder: str | Path | Sequence[str | Path], figures: Path) -> list[Path]:
    """Write the figures and tables of a study, or of several side by side, as files for papers;
    return the files.

    Figures are PNG, SVG and PDF, tables LaTeX and Markdown. Raises as `write_study_report` does.
    """
    return write_figures(study_page(studies_in(folder)), figures)


def studies_in(folder: str | Path | Sequence[str | Path]) -> SavedStudy:
    """Return the study in a folder, or several as one that varies the study too; raises
    `SceneError`.
    """
    folders = [folder] if isinstance(folder, str | Path) else folder
    return joined_studies([read_study(Path(each)) for each in folders])


def study_page(study: SavedStudy) -> ReportPage:
    """Return the page of a study."""
    definition = study.definition
    runs = int(sum(study.rows(next(iter(study.units)))["runs"].tolist())) if study.units else 0
    varied = study.names()
    found = answers(study) if study.question else []
    summary = found or [*verdicts(study), *(range_sentence(study, each) for each in study.shown)]
    metrics = [
        _metric_section(study, name, figures) for name, figures in study.figures_of_metrics.items()
    ]
    responses = [each for each in (response_section(study),) if each is not None]
    sections = [
        _answer_section(study),
        *responses,
        _trade_section(study),
        *metrics,
        method_section(study),
    ]
    return ReportPage(
        title=study.question or f"Study {definition['study']}",
        subtitle=(
            f"{len(definition['designs'])} designs of the scene {definition['scene']},"
            f" {grouped(runs)} runs;"
            f" varied: {varied or 'nothing'}"
        ),
        summary=[*definition.get("notes", ()), *summary],
        sections=[each for each in sections if each.parts or each.text],
        footer="Written by opir-report. Unclassified textbook physics, notional numbers.",
    )


def _answer_section(study: SavedStudy) -> ReportSection:
    """Return the figures that were asked for: effects, a table, and differences of the first
    one.
    """
    varying = [each for each in study.shown if study.constant(each) is None][:_ANSWERS]
    parts: list[ReportFigure | ReportTable] = [_effect(study, each) for each in varying]
    if study.shown:
        parts.append(_answer_table(study, study.shown))
    if varying and 1 < len(study.definition["designs"]) <= _DIFFERENCES_SHOWN:
        words = f"{words_of(study, varying[0])}: difference from the first design"
        height_in = 1.1 + 0.26 * len(study.definition["designs"])
        caption = f"{words}, paired over runs of the same seed, with 95 % intervals."
        rows = study.rows(varying[0])
        name = f"difference-{varying[0]}"
        parts.append(
            _plot(
                name,
                lambda axes: difference_plot(axes, study, varying[0]),
                height_in,
                caption,
                rows,
            )
        )
    return ReportSection("answer", "What was asked", _EFFECT, parts)


def _plot(
    name: str,
    draw: Callable[[Axes], object],
    height_in: float,
    caption: str,
    data: FigureData | None = None,
) -> ReportFigure:
    return figure_of(
        name, lambda figure: draw(figure.add_subplot()), height_in, (caption, caption), data
    )


def _effect(study: SavedStudy, figure: str) -> ReportFigure:
    def draw(drawn: Figure) -> None:
        effect_figure(drawn, study, figure)

    caption = f"{words_of(study, figure)} over {study.names() or 'runs'}, with 95 % intervals."
    return figure_of(
        f"effect-{figure}",
        draw,
        effect_height_in(study, figure),
        (caption, caption),
        study.rows(figure),
    )


def _answer_table(study: SavedStudy, figures: Sequence[str]) -> ReportTable:
    rows = {figure: study.rows(figure) for figure in figures}
    first = rows[figures[0]]
    settings = [study.short_labels(first, [path]) for path in study.paths] or [
        ["the scene"] * len(first)
    ]
    cells = [
        (
            *(values[row] for values in settings),
            str(first["runs"][row]),
            *(mean_text(study, rows[figure], row) for figure in figures),
        )
        for row in range(len(first))
    ]
    more = f"; the first {_ROWS_SHOWN} of {len(cells)} designs" if len(cells) > _ROWS_SHOWN else ""
    names = [setting_words(path)[0] for path in study.paths] or ["design"]
    head = (*names, "runs", *(words_of(study, figure) for figure in figures))
    return ReportTable(f"Means with 95 % intervals{more}", head, cells[:_ROWS_SHOWN])


def _trade_section(study: SavedStudy) -> ReportSection:
    """Return what the designs trade: two figures against each other, the weight of each setting,
    and convergence.
    """
    varying = [each for each in study.shown if study.constant(each) is None]
    parts: list[ReportFigure | ReportTable] = []
    if "objective" in study.definition:
        parts.append(_plot("path", lambda axes: path_plot(axes, study), 4.0, _PATH))
    if len(varying) > 1 and len(study.definition["designs"]) > 2:
        figure = varying[0]
        own = next(names for names in study.figures_of_metrics.values() if figure in names)
        over = next((each for each in varying[1:] if each not in own), varying[1])
        parts.append(
            _plot("trade", lambda axes: trade_plot(axes, study, over, figure), 4.4, _TRADE)
        )
    if varying and len(study.paths) > 1 and study.definition["design"] not in SAMPLED:
        data = tornado_rows(study, varying[0])
        height_in = 1.0 + 0.4 * max(len(data), 1)
        caption = f"{words_of(study, varying[0])}. {_TORNADO}"
        parts.append(
            _plot(
                "tornado",
                lambda axes: tornado_plot(axes, study, varying[0]),
                height_in,
                caption,
                data,
            )
        )
    data = convergence_rows(study, varying[0]) if varying else FigureData.of_rows(("runs",), ())
    if len(data) and data["runs"].max() >= 3:
        caption = f"{words_of(study, varying[0])}. {_CONVERGENCE}"
        parts.append(
            _plot(
                "convergence",
                lambda axes: convergence_plot(axes, study, varying[0]),
                4.0,
                caption,
                data,
            )
        )
    return ReportSection("trades", "Trades and convergence", "", parts)


def _metric_section(study: SavedStudy, metric: str, figures: Sequence[str]) -> ReportSection:
    """Return all figures of a metric; those of the answer are not drawn twice, constants are one
    line of text.
    """
    constants = {each: value for each in figures if (value := study.constant(each)) is not None}
    same = ", ".join(
        f"{words_of(study, each)}"
        f" {axis_label(number_words(value), study.units[each]).replace(', ', ' ')}"
        for each, value in constants.items()
    )
    drawn = [
        each for each in figures if each not in constants and each not in study.shown[:_ANSWERS]
    ]
    above = [each for each in figures if each not in constants and each in study.shown[:_ANSWERS]]
    lines = [f"In every run: {same}."] if same else []
    if above:
        lines.append(f"Above: {', '.join(words_of(study, each) for each in above)}.")
    if len(drawn) > 1 and all(len(effect_panels(study, each)) == 1 for each in drawn):
        parts: list[ReportFigure | ReportTable] = [_side_by_side(study, metric, drawn)]
    else:
        parts = [_effect(study, each) for each in drawn]
    table = [_answer_table(study, drawn)] if drawn else []
    return ReportSection(
        f"metric-{metric}", metric.replace("_", " "), " ".join(lines), [*parts, *table]
    )


def _side_by_side(study: SavedStudy, metric: str, figures: Sequence[str]) -> ReportFigure:
    """Return the effects on several figures of one panel each, two beside each other."""
    count = -(-len(figures) // 2)

    def draw(drawn: Figure) -> None:
        for part, figure in zip(
            np.ravel(drawn.subfigures(count, 2, squeeze=False)), figures, strict=False
        ):
            effect_figure(part, study, figure)

    caption = f"{', '.join(words_of(study, each) for each in figures)}, with 95 % intervals."
    rows = study.results.where(np.isin(study.results["figure"], list(figures)))
    return figure_of(f"effects-{metric}", draw, 0.3 + 2.8 * count, (caption, caption), rows)
