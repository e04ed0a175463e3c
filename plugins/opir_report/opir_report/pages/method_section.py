"""The last section of a study's report: how it was made, its conditions, what it does not have, and
its data.
"""

from collections.abc import Iterator

import numpy as np

from opir_core.cli import grouped
from opir_report.pages.page import ReportSection, ReportTable
from opir_report.pages.sentences import requirement_words, words_of
from opir_report.saved_study import SavedStudy, level_text
from opir_report.words import number_words, setting_words

_CONDITIONS = (
    "Sensors, target classes, sites and probabilities are notional defaults unless a scene cites a"
    " source: read"
    " differences between designs, not the figures of a real system. Run k of all designs has the"
    " same seed, so"
    " differences are paired. An interval holds the mean over such runs, not a single launch, and"
    " not the error of the"
    " models."
)


def method_section(study: SavedStudy) -> ReportSection:
    """Return the section."""
    definition = study.definition
    first = study.rows(next(iter(study.units)))
    seeds = (
        f"seeds {first['first_seed'].min()} to {first['last_seed'].max()}" if len(first) else "-"
    )
    counts = sorted({int(each) for each in first["runs"].tolist()})
    runs = (
        grouped(counts[0]) if len(counts) == 1 else f"{grouped(counts[0])} to {grouped(counts[-1])}"
    )
    rows = [
        ("scene", str(definition["scene"])),
        ("design", str(definition["design"])),
        *(
            (path, ", ".join(dict.fromkeys(map(level_text, first[path].tolist()))))
            for path in study.paths
        ),
        ("runs", f"{runs} of each design, {seeds}; {str(definition['until']) or 'all runs'}"),
        ("intervals", "95 %, Student's t over runs"),
        *_metric_rows(study),
        *_requirement_rows(study),
        *_missing_rows(study),
        (
            "data",
            (
                "results.csv: all figures of all designs; runs.parquet: every run; in the folder of the"
                " study"
            ),
        ),
    ]
    return ReportSection(
        "method",
        "Method and conditions",
        _CONDITIONS,
        (ReportTable("The study", ("", "value"), rows),),
    )


def _metric_rows(study: SavedStudy) -> Iterator[tuple[str, str]]:
    """Yield the settings of each metric that has any."""
    for metric, settings in study.definition.get("settings", {}).items():
        if settings:
            yield (
                metric.replace("_", " "),
                ", ".join(_setting_text(*each) for each in settings.items()),
            )


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
    for each in study.requirements:
        is_met = study.is_met(each)
        missed = int(np.count_nonzero(~is_met))
        yield (
            f"required: {requirement_words(study, each)}",
            f"missed by {missed} of {len(is_met)} designs",
        )


def _missing_rows(study: SavedStudy) -> Iterator[tuple[str, str]]:
    """Yield the figures that some launches or runs do not have: shares of the designs, and runs
    with a value.
    """
    words = []
    for figure in study.units:
        rows = study.rows(figure)
        of = study.shares_text(figure)
        count, runs = (grouped(int(rows[name].sum())) for name in ("runs_with_value", "runs"))
        if of:
            words.append(f"{words_of(study, figure)} {of}, a value in {count} of {runs} runs")
    if words:
        yield (
            "means over some",
            f"{'; '.join(words)}; a launch or run without a value meets no requirement",
        )
