"""The report of a study: what changes and by how much, first in sentences, then as effect plots and tables."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from opir_core.cli import grouped
from opir_report.figure_data import FigureData
from opir_report.pages.files import write_page
from opir_report.pages.page import ReportFigure, ReportPage, ReportSection, ReportTable
from opir_report.pages.run_sections import figure_of
from opir_report.plots.effects import difference_plot, effect_plot
from opir_report.saved_study import SavedStudy, level_text, read_study

#: Figures of a metric that are drawn, designs whose differences are drawn, and rows of a table.
_FIGURES_SHOWN, _DIFFERENCES_SHOWN, _ROWS_SHOWN = 6, 16, 60
_EFFECT = (
    "Mean over runs with its 95 % interval. All designs see the same random numbers, so differences are more precise"
    " than the intervals of the means suggest."
)


def write_study_report(folder: str | Path, path: Path, *, with_data: bool = True) -> list[Path]:
    """Write the report of the study in a folder; return the files written.

    The data of each figure are written as Parquet into a folder beside the report. Raises `SceneError` for a folder
    without a study, and `SinkError` where a file cannot be written.
    """
    return write_page(study_page(read_study(Path(folder))), path, with_data=with_data)


def study_page(study: SavedStudy) -> ReportPage:
    """Return the page of a study."""
    definition, metrics = study.definition, study.figures_of_metrics
    runs = int(sum(study.rows(next(iter(study.units)))["runs"].tolist())) if study.units else 0
    sections = [_metric_section(study, name, figures) for name, figures in metrics.items()]
    return ReportPage(
        title=f"Study {definition['study']}",
        subtitle=(
            f"{len(definition['designs'])} designs of the scene {definition['scene']}, {grouped(runs)} runs;"
            f" varied: {', '.join(study.paths) or 'nothing'}"
        ),
        summary=[_sentence(study, figures[0]) for figures in metrics.values()],
        sections=[*sections, _design_section(study)],
        footer="Written by opir-report. Unclassified textbook physics, notional numbers.",
    )


def _sentence(study: SavedStudy, figure: str) -> str:
    """Return where the mean of a figure is lowest and highest."""
    rows = study.rows(figure)
    rows = rows.where(np.isfinite(rows["mean"]))
    labels, means = study.labels(rows), rows["mean"].tolist()
    low, high = int(np.argmin(means)), int(np.argmax(means))
    if low == high or means[low] == means[high]:
        return f"{figure}: {_mean_text(study, rows, low)}{' in all designs' if len(rows) > 1 else ''}"
    return (
        f"{figure}: from {_mean_text(study, rows, low)} ({labels[low]}) to {_mean_text(study, rows, high)}"
        f" ({labels[high]})"
    )


def _mean_text(study: SavedStudy, rows: FigureData, row: int, column: str = "mean") -> str:
    """Return a mean with unit and interval, `0.17 s [0.13, 0.21]`."""
    low, high = ("low_95", "high_95") if column == "mean" else ("difference_low_95", "difference_high_95")
    value, edges = float(rows[column][row]), (float(rows[low][row]), float(rows[high][row]))
    if not np.isfinite(value):
        return "-"
    unit = study.units[str(rows["figure"][row])]
    text = f"{value:.3g} {unit}".strip()
    return f"{text} [{edges[0]:.3g}, {edges[1]:.3g}]" if np.isfinite(edges).all() else text


def _metric_section(study: SavedStudy, metric: str, figures: Sequence[str]) -> ReportSection:
    parts: list[ReportFigure | ReportTable] = [_effects(study, metric, figures[:_FIGURES_SHOWN])]
    designs = len(study.definition["designs"])
    if 1 < designs <= _DIFFERENCES_SHOWN:
        parts.append(_differences(study, metric, figures[0]))
    parts += [_table(study, figures[0])]
    more = f" The first {_FIGURES_SHOWN} of {len(figures)} figures." if len(figures) > _FIGURES_SHOWN else ""
    return ReportSection(f"metric-{metric}", metric.replace("_", " "), _EFFECT + more, parts)


def _effects(study: SavedStudy, metric: str, figures: Sequence[str]) -> ReportFigure:
    columns = min(len(figures), 2)
    rows = -(-len(figures) // columns)

    def draw(figure: Figure) -> None:
        for place, name in enumerate(figures, start=1):
            effect_plot(figure.add_subplot(rows, columns, place), study, name)

    listed = ", ".join(figures)
    words = (f"Effect of {', '.join(study.paths)} on {listed}, with 95 % intervals", f"Effects on {listed}.")
    shown = study.results.where(np.isin(study.results["figure"], list(figures)))
    return figure_of(f"effect-{metric}", draw, 0.4 + 2.8 * rows if columns == 2 else 4.0, words, shown)


def _differences(study: SavedStudy, metric: str, figure: str) -> ReportFigure:
    words = (
        f"Difference of {figure} of each design from the first one, with 95 % intervals",
        f"Difference of {figure} from the first design, paired over runs of the same seed, with 95 % intervals.",
    )
    height_in = 1.1 + 0.26 * len(study.definition["designs"])
    return figure_of(
        f"difference-{metric}",
        lambda drawn: difference_plot(drawn.add_subplot(), study, figure),
        height_in,
        words,
        study.rows(figure),
    )


def _table(study: SavedStudy, figure: str) -> ReportTable:
    rows = study.rows(figure)
    cells = [
        (label, str(rows["runs"][row]), _mean_text(study, rows, row), _mean_text(study, rows, row, "difference"))
        for row, label in enumerate(study.labels(rows))
    ]
    more = f"; the first {_ROWS_SHOWN} of {len(cells)} designs" if len(cells) > _ROWS_SHOWN else ""
    return ReportTable(
        f"{figure}: mean and difference from the first design, with 95 % intervals{more}",
        ("design", "runs", "mean", "difference"),
        cells[:_ROWS_SHOWN],
    )


def _design_section(study: SavedStudy) -> ReportSection:
    definition, first = study.definition, study.rows(next(iter(study.units)))
    seeds = f"{first['first_seed'].min()} to {first['last_seed'].max()}" if len(first) else "-"
    rows = [
        ("scene", str(definition["scene"])),
        ("design", str(definition["design"])),
        ("seeds", f"seeds {seeds}"),
        ("until", str(definition["until"]) or "all runs"),
        *((study.short(path), ", ".join(dict.fromkeys(map(level_text, first[path].tolist())))) for path in study.paths),
    ]
    return ReportSection("design", "How it was made", "", (ReportTable("The study", ("", "value"), rows),))
