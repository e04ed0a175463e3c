"""The report of a study: the requested figures first, then trades, every metric, and the method."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from opir_core.cli import grouped
from opir_report.pages.citing_section import citing_section, provenance, with_provenance
from opir_report.pages.files import write_page
from opir_report.pages.method_section import method_section
from opir_report.pages.page import ReportFigure, ReportPage, ReportSection, ReportTable
from opir_report.pages.paper import write_figures
from opir_report.pages.response_section import response_section
from opir_report.pages.run_sections import figure_of, plot_of
from opir_report.pages.sentences import (
    answers,
    condition_sentences,
    mean_text,
    range_sentence,
    verdicts,
    words_of,
)
from opir_report.pages.share_section import calibration_sentences, share_answers, share_section
from opir_report.plots.effects import difference_plot, effect_figure, effect_height_in
from opir_report.plots.panels import SAMPLED, effect_panels
from opir_report.plots.sensitivity import sensitivity_plot, sensitivity_rows
from opir_report.plots.trades import (
    convergence_plot,
    convergence_rows,
    path_plot,
    tornado_plot,
    tornado_rows,
    trade_plot,
)
from opir_report.saved_study import SavedStudy, joined_studies, read_study
from opir_report.words import number_words, setting_words

#: Figures of the answer, and rows of a table.
_ANSWERS = 4
_ROWS_SHOWN = 60
_EFFECT = (
    "Mean over runs with its 95 % interval, cut at 0 where no run has less, and at 1 for shares of"
    " launches. All designs see the same random numbers, so differences are more precise than the"
    " intervals of the means suggest."
)
_TRADE = (
    "Each point is a design. The line joins the designs that no other one beats in both figures."
)
_TORNADO = (
    "How far each setting moves the mean, over the values that it has in the study; the values at"
    " the ends are written there."
)
_SENSITIVITY = (
    "Share of the variance over the designs that each setting explains, alone and with all others,"
    " with 95 % intervals (Sobol indices). A setting whose total is near 0 may be fixed."
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
    return joined_studies([read_study(Path(path)) for path in folders])


def study_page(study: SavedStudy) -> ReportPage:
    """Return the page of a study."""
    definition = study.definition
    runs = int(sum(study.rows(next(iter(study.units)))["runs"].tolist())) if study.units else 0
    answer = answers(study) if study.question else []
    summary = [
        *share_answers(study),
        *condition_sentences(study),
        *(answer or [*verdicts(study), *(range_sentence(study, figure) for figure in study.shown)]),
    ]
    sections = [
        _answer_section(study),
        share_section(study),
        response_section(study),
        _trade_section(study),
        *(_metric_section(study, *metric) for metric in study.figures_of_metrics.items()),
        method_section(study),
        citing_section(study),
    ]
    return ReportPage(
        title=study.question or f"Study {definition['study']}",
        subtitle=(
            f"{len(definition['designs'])} designs of the scene {definition['scene']},"
            f" {grouped(runs)} runs; varied: {study.names() or 'nothing'}"
        ),
        summary=[*calibration_sentences(study), *definition.get("notes", ()), *summary],
        sections=[
            with_provenance(section, provenance(study))
            for section in sections
            if section and (section.parts or section.text)
        ],
        footer="Written by opir-report. Unclassified textbook physics, notional numbers.",
    )


def _answer_section(study: SavedStudy) -> ReportSection:
    """Return the requested figures: effects, a table, and differences of the first one, of up to 16
    designs.
    """
    figures = study.varying[:_ANSWERS]
    parts: list[ReportFigure | ReportTable] = [_effect(study, figure) for figure in figures]
    if study.shown:
        parts.append(_answer_table(study, study.shown))
    designs = len(study.definition["designs"])
    if figures and 1 < designs <= 16:
        figure = figures[0]
        parts.append(
            plot_of(
                f"difference-{figure}",
                partial(difference_plot, study=study, figure=figure),
                1.1 + 0.26 * designs,
                f"{words_of(study, figure)}: difference from the first design, paired over runs of"
                " the same seed, with 95 % intervals.",
                data=study.rows(figure),
            )
        )
    return ReportSection("answer", "What was asked", _EFFECT, parts)


def _effect(study: SavedStudy, figure: str) -> ReportFigure:
    return figure_of(
        f"effect-{figure}",
        lambda drawn: effect_figure(drawn, study, figure),
        effect_height_in(study, figure),
        f"{words_of(study, figure)} over {study.names() or 'runs'}, with 95 % intervals.",
        data=study.rows(figure),
    )


def _answer_table(study: SavedStudy, figures: Sequence[str]) -> ReportTable:
    tables = {figure: study.rows(figure) for figure in figures}
    designs = tables[figures[0]]
    settings = [study.short_labels(designs, [path]) for path in study.paths] or [
        ["the scene"] * len(designs)
    ]
    cells = [
        (
            *(values[row] for values in settings),
            str(runs),
            *(mean_text(study, table, row) for table in tables.values()),
        )
        for row, runs in enumerate(designs["runs"].tolist())
    ]
    count = len(cells)
    omission = f"; the first {_ROWS_SHOWN} of {count} designs" if count > _ROWS_SHOWN else ""
    names = [setting_words(path)[0] for path in study.paths] or ["design"]
    head = (*names, "runs", *(words_of(study, figure) for figure in figures))
    return ReportTable(f"Means with 95 % intervals{omission}", head, cells[:_ROWS_SHOWN])


def _trade_section(study: SavedStudy) -> ReportSection:
    """Return the trades of the designs: two figures against each other, the weight of each setting,
    and convergence.
    """
    varying = study.varying
    figures = list[ReportFigure]()
    if "objective" in study.definition:
        figures.append(plot_of("path", partial(path_plot, study=study), 4.0, _PATH))
    if len(varying) > 1 and len(study.definition["designs"]) > 2:
        draw = partial(trade_plot, study=study, over=_traded(study), figure=varying[0])
        figures.append(plot_of("trade", draw, 4.4, _TRADE))
    if varying:
        figures += _weight_figures(study, varying[0])
    return ReportSection("trades", "Trades and convergence", "", figures)


def _traded(study: SavedStudy) -> str:
    """Return the figure against which the first one is drawn, of another metric if there is one."""
    first, *others = study.varying
    metric = next(names for names in study.figures_of_metrics.values() if first in names)
    return next((figure for figure in others if figure not in metric), others[0])


def _weight_figures(study: SavedStudy, figure: str) -> Iterator[ReportFigure]:
    """Yield the tornado of the settings and the convergence over runs of a figure."""
    name = words_of(study, figure)
    if len(study.paths) > 1 and study.definition["design"] not in SAMPLED:
        data = tornado_rows(study, figure)
        draw = partial(tornado_plot, study=study, figure=figure)
        height_in = 1.0 + 0.4 * max(len(data), 1)
        yield plot_of("tornado", draw, height_in, f"{name}. {_TORNADO}", data=data)
    yield from _sensitivity_figure(study, figure)
    data = convergence_rows(study, figure)
    if len(data) and data["runs"].max() >= 3:
        draw = partial(convergence_plot, study=study, figure=figure)
        yield plot_of("convergence", draw, 4.0, f"{name}. {_CONVERGENCE}", data=data)


def _sensitivity_figure(study: SavedStudy, figure: str) -> Iterator[ReportFigure]:
    """Yield the Sobol indices of a figure, if the study has any."""
    data = sensitivity_rows(study, figure)
    if len(data):
        draw = partial(sensitivity_plot, study=study, figure=figure)
        height_in = 1.2 + 0.45 * len(data)
        words = f"{words_of(study, figure)}. {_SENSITIVITY}"
        yield plot_of("sensitivity", draw, height_in, words, data=data)


def _metric_section(study: SavedStudy, metric: str, figures: Sequence[str]) -> ReportSection:
    """Return all figures of a metric; those of the answer are not drawn twice, constants are one
    line of text.
    """
    constants = {name: value for name in figures if (value := study.constant(name)) is not None}
    varying = [name for name in figures if name not in constants]
    answered = [name for name in varying if name in study.shown[:_ANSWERS]]
    drawn = [name for name in varying if name not in answered]
    lines = []
    if constants:
        lines.append(f"In every run: {_values_words(study, constants)}.")
    if answered:
        lines.append(f"Above: {', '.join(words_of(study, name) for name in answered)}.")
    parts: list[ReportFigure | ReportTable] = []
    if len(drawn) > 1 and all(len(effect_panels(study, name)) == 1 for name in drawn):
        parts.append(_side_by_side(study, metric, drawn))
    else:
        parts += [_effect(study, name) for name in drawn]
    if drawn:
        parts.append(_answer_table(study, drawn))
    return ReportSection(f"metric-{metric}", metric.replace("_", " "), " ".join(lines), parts)


def _values_words(study: SavedStudy, values: Mapping[str, float]) -> str:
    """Return values of figures with their units, `tracked 1, latency 0.5 s`."""
    return ", ".join(
        f"{words_of(study, name)} {number_words(value)} {study.units[name]}".rstrip()
        for name, value in values.items()
    )


def _side_by_side(study: SavedStudy, metric: str, figures: Sequence[str]) -> ReportFigure:
    """Return the effects on several figures of one panel each, two beside each other."""
    rows = -(-len(figures) // 2)

    def draw(drawn: Figure) -> None:
        panels = np.ravel(drawn.subfigures(rows, 2, squeeze=False))
        for panel, figure in zip(panels, figures, strict=False):
            effect_figure(panel, study, figure)

    return figure_of(
        f"effects-{metric}",
        draw,
        0.3 + 2.8 * rows,
        f"{', '.join(words_of(study, figure) for figure in figures)}, with 95 % intervals.",
        data=study.results.where(np.isin(study.results["figure"], list(figures))),
    )
