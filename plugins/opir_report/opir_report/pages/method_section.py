"""The last section of a study's report: its method, conditions, missing values and data."""

from collections.abc import Iterator

import numpy as np

from opir_core.cli import grouped
from opir_report.pages.page import ReportSection, ReportTable
from opir_report.pages.sentences import requirement_words, words_of
from opir_report.saved_study import SavedStudy, level_text
from opir_report.words import number_words, setting_words

_CONDITIONS = (
    "Sensors, target classes, sites and probabilities are notional defaults unless a scene cites a"
    " source: read differences between designs, not the figures of a real system. Run k of all"
    " designs has the same seed, so differences are paired. An interval holds the mean over such"
    " runs, not a single launch, and not the error of the models."
)
_DATA = (
    "results.csv: all figures of all designs; runs.parquet: every run; in the folder of the study"
)


def method_section(study: SavedStudy) -> ReportSection:
    """Return the section."""
    definition = study.definition
    designs = study.rows(next(iter(study.units)))
    seeds = (
        f"seeds {designs['first_seed'].min()} to {designs['last_seed'].max()}"
        if len(designs)
        else "-"
    )
    counts = sorted({int(count) for count in designs["runs"].tolist()})
    runs = " to ".join(map(grouped, dict.fromkeys((counts[0], counts[-1]))))
    rows = [
        ("scene", str(definition["scene"])),
        ("design", str(definition["design"])),
        *((path, ", ".join(map(level_text, designs.levels(path)))) for path in study.paths),
        ("runs", f"{runs} of each design, {seeds}; {str(definition['until']) or 'all runs'}"),
        ("intervals", "95 %, Student's t over runs"),
        *_metric_rows(study),
        *_requirement_rows(study),
        *_missing_rows(study),
        ("data", _DATA),
    ]
    table = ReportTable("The study", ("", "value"), rows)
    return ReportSection("method", "Method and conditions", _CONDITIONS, (table,))


def _metric_rows(study: SavedStudy) -> Iterator[tuple[str, str]]:
    """Yield the settings of each metric that has any."""
    for metric, settings in study.definition.get("settings", {}).items():
        if settings:
            texts = (_setting_text(*setting) for setting in settings.items())
            yield metric.replace("_", " "), ", ".join(texts)


def _setting_text(name: str, value: object) -> str:
    """Return a setting of a metric, `region 1 000 000 km²`."""
    words, unit = setting_words(name)
    if isinstance(value, list | tuple):
        return f"{words} {' and '.join(map(str, value)) or 'none'}"
    if isinstance(value, int | float) and not isinstance(value, bool):
        return f"{words} {number_words(float(value))} {unit}".rstrip()
    return f"{words} {'not required' if value is None else value}"


def _requirement_rows(study: SavedStudy) -> Iterator[tuple[str, str]]:
    """Yield for each requirement how many designs miss it."""
    for requirement in study.requirements:
        is_met = study.is_met(requirement)
        yield (
            f"required: {requirement_words(study, requirement)}",
            f"missed by {np.count_nonzero(~is_met)} of {len(is_met)} designs",
        )


def _missing_rows(study: SavedStudy) -> Iterator[tuple[str, str]]:
    """Yield the figures that some launches or runs do not have: shares of the designs, and runs
    with a value.
    """
    texts = []
    for figure in study.units:
        share = study.shares_text(figure)
        if share:
            rows = study.rows(figure)
            count, runs = (grouped(int(rows[name].sum())) for name in ("runs_with_value", "runs"))
            texts.append(f"{words_of(study, figure)} {share}, a value in {count} of {runs} runs")
    if texts:
        yield (
            "means over some",
            f"{'; '.join(texts)}; a launch or run without a value meets no requirement",
        )
