"""Shares of launches on the page of a study: whether stated regions hold, which designs meet the
required shares, and curves over time.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from opir_scoring import NOT_SHOWN, TAILS_95, LaunchShare, Tails, percent_text, share_text

from opir_report.figure_data import FigureData
from opir_report.pages.page import ReportFigure, ReportSection, ReportTable
from opir_report.pages.run_sections import figure_of
from opir_report.pages.sentences import least_costly
from opir_report.plots.share_curves import (
    curve_rows,
    curves_figure,
    never_texts,
    share_requirements_on,
)
from opir_report.saved_study import SavedStudy
from opir_report.words import figure_words

#: The most curves, designs that are named, and rows of a table.
_CURVES = 4
_NAMED = 3
_ROWS_SHOWN = 120
_TEXT = (
    "Launches of one run share sensors, weather and random numbers: intervals are exact binomial"
    " ones of the number of launches that are independent (Korn and Graubard). A design meets a"
    " requirement where the whole interval lies above the required share, misses it where it lies"
    " below, and otherwise neither is shown. At most 5 % of the verdicts on a design are wrong, over"
    " all conditions and all times at which a study may stop. A launch that is never seen, or not"
    " before the scene ends, misses every bound; runs that failed count nowhere."
)


def share_section(study: SavedStudy) -> ReportSection | None:
    """Return the section, or None for a study without rows of launches."""
    if study.launches is None or not len(study.launches):
        return None
    parts: list[ReportFigure | ReportTable] = [
        _curves(study, column) for column in _curve_columns(study)[:_CURVES]
    ]
    if study.shares is not None and len(study.shares):
        parts.append(_share_table(study, study.shares))
    return ReportSection("shares", "Launch by launch", _TEXT, parts)


def _curve_columns(study: SavedStudy) -> list[str]:
    """Return the times of launches that requirements are on, or else all that some launch has."""
    times = [name for name, unit in study.definition["launches"].items() if unit == "s"]
    requirements = study.definition.get("share_requirements", ())
    columns = dict.fromkeys(requirement["column"] for requirement in requirements)
    required = [name for name in columns if name in times]
    launches = study.launches
    assert launches is not None
    return required or [
        name
        for name in times
        if np.isfinite(launches[name]).any() and name.endswith(("detected_s", "warned_s"))
    ]


def _curves(study: SavedStudy, column: str) -> ReportFigure:
    rows = curve_rows(study, column)
    launches = ", ".join(map(str, sorted(set(rows["launches"].tolist()))))
    runs = ", ".join(map(str, sorted(set(rows["runs"].tolist()))))
    lines = "; dotted: what is required" if share_requirements_on(study, column) else ""
    caption = (
        f"{figure_words(column, 's')}: share of {launches} launches in {runs} runs of each curve by"
        f" a time since ignition, with 95 % intervals{lines}. Never: {'; '.join(never_texts(rows))}."
    )
    draw = partial(curves_figure, study=study, column=column)
    return figure_of(f"shares-{column}", draw, 3.8, caption, data=rows)


def _share_table(study: SavedStudy, shares: FigureData) -> ReportTable:
    names = study.short_labels(shares, _share_paths(study, shares))
    cells = [
        (
            str(shares["requirement"][row]),
            names[row],
            str(shares["condition"][row]) or "-",
            _part_words(shares, row),
            _share_text(shares, row),
            str(shares["verdict"][row]) or "-",
            _runs_text(shares["deciding_runs"][row], str(shares["verdict"][row])),
        )
        for row in range(len(shares))
    ]
    head = ("required", "design", "condition", "launches of", "share", "verdict", "deciding runs")
    more = f"; the first {_ROWS_SHOWN} of {len(cells)} rows" if len(cells) > _ROWS_SHOWN else ""
    return ReportTable(f"Required shares of launches{more}", head, cells[:_ROWS_SHOWN])


def _part_words(shares: FigureData, row: int) -> str:
    by = str(shares["by"][row])
    return f"{by} {shares['value'][row]}" if by else "all sites and classes"


def _share_paths(study: SavedStudy, shares: FigureData) -> list[str]:
    """Return the settings that designs of shares differ in: what varies, and is no condition."""
    return [path for path in study.varied if path in shares.columns]


def _share_text(shares: FigureData, row: int) -> str:
    """Return a share with its interval and what it is of: `12 % [5, 22] of 36 launches, 6
    seeds`.
    """
    share = share_text(*(float(shares[name][row]) for name in ("share", "low", "high")))
    return f"{share} of {shares['launches'][row]} launches, {shares['runs'][row]} seeds"


def _runs_text(runs: Any, verdict: str) -> str:
    if verdict != NOT_SHOWN:
        return "-"
    return f"about {int(runs)}" if runs is not None and runs == runs else "over a million"


def share_answers(study: SavedStudy) -> list[str]:
    """Return a sentence for each required share: the designs that meet it, the least costly of
    them, and what is not shown.
    """
    shares = study.shares
    if shares is None or not len(shares):
        return []
    # The first row of a requirement and design is that over all conditions.
    keys = list(zip(shares["requirement"].tolist(), shares["design"].tolist(), strict=True))
    overall = shares.where(
        np.array([row for row, key in enumerate(keys) if not row or key != keys[row - 1]])
    )
    return [
        _share_answer(study, overall.at("requirement", text))
        for text in overall.levels("requirement")
    ]


def _share_answer(study: SavedStudy, rows: FigureData) -> str:
    paths = _share_paths(study, rows)
    names = study.labels(rows, paths) if paths else [""] * len(rows)
    sentences = [
        _verdict_sentence(rows, names, verdict)
        for verdict in ("met", "not shown", "not met")
        if np.any(rows["verdict"] == verdict)
    ]
    met = np.flatnonzero(rows["verdict"] == "met")
    if len(met) > 1 and paths:
        cheapest = [names[row] for row in met[least_costly(rows, paths, met)]]
        sentences.append(f"the least costly that meet it: {' or '.join(cheapest[:_NAMED])}")
    return f"{rows['requirement'][0]}: {'. '.join(sentences)}."


def _verdict_sentence(rows: FigureData, names: Sequence[str], verdict: str) -> str:
    """Return the designs of a verdict: `met by sensors with LEO (98 % [95, 99] of 120)`."""
    places = np.flatnonzero(rows["verdict"] == verdict)
    examples = [
        " ".join(filter(None, (names[row], f"({_share_text(rows, row)})")))
        for row in places[:_NAMED].tolist()
    ]
    more = f" and {len(places) - _NAMED} more" if len(places) > _NAMED else ""
    text = f"{'; '.join(examples)}{more}"
    if verdict != NOT_SHOWN:
        return f"{verdict} by {text}"
    runs = rows["deciding_runs"][places].astype(np.float64)
    runs = runs[np.isfinite(runs)]
    deciding = f", which about {int(runs.max())} runs would decide" if len(runs) else ""
    return f"{verdict} either way for {text}{deciding}"


def calibration_sentences(study: SavedStudy) -> list[str]:
    """Return a sentence on designs whose stated regions hold the true impact too seldom, none where
    no such thing is shown.

    The chance of a wrong sentence is 2.5 %, over all designs, conditions and instants.
    """
    launches = study.launches
    nominals = study.definition.get("containments", {})
    if launches is None or not nominals:
        return []
    numbers = launches.levels("design")
    tail = TAILS_95.high / max(len(numbers) * len(nominals), 1)
    texts = [
        text
        for column, nominal in nominals.items()
        for text in _too_seldom(study, launches, column, nominal, Tails(tail, tail))
    ]
    if not texts:
        return []
    more = f"; and {len(texts) - _NAMED} more" if len(texts) > _NAMED else ""
    words = "Stated impact regions hold the true impact too seldom, so a small area says little"
    return [f"{words}: {'; '.join(texts[:_NAMED])}{more}."]


def _too_seldom(
    study: SavedStudy, launches: FigureData, column: str, nominal: float, tails: Tails
) -> Iterator[str]:
    """Yield the designs whose whole interval, with these tails, is below the stated containment."""
    for number in launches.levels("design"):
        rows = launches.at("design", number)
        rows = rows.where(np.isfinite(rows[column]))
        share = LaunchShare.of(rows[column] == 1.0, rows["replicate"])
        _, high = share.interval(tails)
        if high < nominal:
            name = study.labels(launches.at("design", number).where(slice(0, 1)))[0]
            words = figure_words(column, "")
            yield (
                f"{words}, {name}: {share_text(share.share, *share.interval())} of"
                f" {share.launches} launches with a region, stated {percent_text(nominal)}"
            )
