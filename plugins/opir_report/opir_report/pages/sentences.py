"""Sentences on a study: means with intervals, requirements that are met, and the answer to its
question.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from opir_core.arrays import BoolArray, IntArray
from opir_report.factorial import ranked_settings
from opir_report.figure_data import FigureData
from opir_report.plots.responses import Part, parts_of
from opir_report.plots.trades import is_higher_better
from opir_report.saved_study import SavedStudy, level_text
from opir_report.words import (
    axis_label,
    figure_words,
    level_value,
    level_words,
    number_words,
    setting_words,
    shown_unit,
)

#: Designs that are named where several meet a requirement.
_NAMED = 6
#: The least costly designs that an answer names.
_LEAST_COSTLY = 3


def words_of(study: SavedStudy, figure: str) -> str:
    """Return the name of a figure in words."""
    return figure_words(figure, study.units[figure])


def mean_text(study: SavedStudy, rows: FigureData, row: int) -> str:
    """Return a mean with unit and interval, `0.17 s [0.13, 0.21]`, and what it is of, if not of all
    launches.
    """
    figure = str(rows["figure"][row])
    share = float(rows["share"][row])
    ends = float(rows["low_95"][row]), float(rows["high_95"][row])
    text = interval_text(study, figure, float(rows["mean"][row]), *ends)
    of = study.share_text(figure, share, share)
    return f"{text} ({of})" if of and text != "-" else text


def interval_text(study: SavedStudy, figure: str, mean: float, low: float, high: float) -> str:
    """Return a value of a figure with unit and interval, to two digits of the interval's width."""
    shown = shown_unit(study.units[figure], study.rows(figure)["mean"])
    value, *edges = (each / shown.divisor for each in (mean, low, high))
    if not np.isfinite(value):
        return "-"
    if not np.isfinite(edges).all() or edges[0] >= edges[1]:
        return f"{number_words(value, 3)} {shown.unit}".strip()
    size = int(np.floor(np.log10(max(map(abs, edges)))) - np.floor(np.log10(edges[1] - edges[0])))
    value_words, *ends = (number_words(each, max(3, size + 2)) for each in (value, *edges))
    return f"{f'{value_words} {shown.unit}'.strip()} [{', '.join(ends)}]"


def range_sentence(study: SavedStudy, figure: str) -> str:
    """Return where the mean of a figure is lowest and highest."""
    rows = study.rows(figure)
    rows = rows.where(np.isfinite(rows["mean"]))
    labels = study.labels(rows)
    means = rows["mean"].tolist()
    words = words_of(study, figure)
    low = int(np.argmin(means))
    high = int(np.argmax(means))
    if low == high or means[low] == means[high]:
        return f"{words}: {mean_text(study, rows, low)}{' in all designs' if len(rows) > 1 else ''}"
    ends = (f"{mean_text(study, rows, each)} ({labels[each]})" for each in (low, high))
    return f"{words}: from {' to '.join(ends)}"


def requirement_words(study: SavedStudy, requirement: Mapping[str, Any]) -> str:
    """Return a requirement in words, `warning time at least 900 s`."""
    figure = requirement["figure"]
    limit = requirement["limit"]
    unit = shown_unit(study.units[figure], np.array([limit]))
    value = axis_label(number_words(limit / unit.divisor), unit.unit).replace(", ", " ")
    return (
        f"{words_of(study, figure)} {'at least' if requirement['is_least'] else 'at most'} {value}"
    )


def verdicts(study: SavedStudy) -> list[str]:
    """Return for each requirement the designs whose mean meets it."""
    lines = []
    for each in study.requirements:
        rows = study.rows(each["figure"])
        met = [
            label
            for label, good in zip(study.labels(rows), study.is_met(each).tolist(), strict=True)
            if good
        ]
        which = (
            f": {'; '.join(met[:_NAMED])}{' …' if len(met) > _NAMED else ''}"
            if met and any(met)
            else ""
        )
        head = f"{requirement_words(study, each)}: met by {len(met)} of {len(rows)} designs{which}"
        by_some = study.is_met_by_mean(each) & ~study.is_met(each)
        labels = study.labels(rows)
        own = np.flatnonzero(by_some).tolist()[:_NAMED]
        few = [": ".join(filter(None, (labels[row], mean_text(study, rows, row)))) for row in own]
        lines.append(f"{head}; not by a mean over some ({'; '.join(few)})" if few else head)
    return lines


def answers(study: SavedStudy) -> list[str]:
    """Return the answer to a study's question, a paragraph for each value of the setting that
    splits it.

    None for a study whose designs are not all combinations of two settings.
    """
    figures = study.shown
    return (
        [_answer(study, part, figures) for part in parts_of(study, figures[0])] if figures else []
    )


def _answer(study: SavedStudy, part: Part, figures: Sequence[str]) -> str:
    name = f"{part.name[0].upper()}{part.name[1:]}: " if part.name else ""
    own = _designs_of(study, part)
    lines = [
        f"{name}{_requirements_sentence(study, own, figures[0])}.",
        f"{_settings_sentence(study, part, figures[0])}.",
    ]
    ends = [text for each in figures[1:] if (text := _ends_words(study, own, each))]
    if ends:
        lines.append(f"From the least to the most costly design {', '.join(ends)}.")
    return " ".join(lines)


def _designs_of(study: SavedStudy, part: Part) -> IntArray:
    """Return the rows of a part's designs."""
    rows = study.rows(next(iter(study.units)))
    if not study.split:
        return np.arange(len(rows))
    values = [level_value(study.split, level_text(value)) for value in rows[study.split].tolist()]
    return np.flatnonzero([value == part.name for value in values])


def is_surely_met(study: SavedStudy, requirement: Mapping[str, Any]) -> BoolArray:
    """Return whether the whole 95 % interval of each design's mean meets a requirement; one run has
    no interval.
    """
    rows = study.rows(requirement["figure"])
    limit = requirement["limit"]
    # A figure that is the same in all runs has an interval without width.
    ends = rows["low_95" if requirement["is_least"] else "high_95"]
    is_beyond = np.asarray(ends >= limit if requirement["is_least"] else ends <= limit)
    return is_beyond & study.is_whole(requirement["figure"])


def _requirements_sentence(study: SavedStudy, own: IntArray, figure: str) -> str:
    """Return how many designs meet all requirements, and which is the least costly or comes
    nearest.
    """
    if not study.requirements:
        return f"{words_of(study, figure)} is {_best_words(study, own, figure)}"
    is_met, is_sure, by_some = np.ones((3, len(study.rows(figure))), dtype=np.bool_)
    for each in study.requirements:
        by_some &= study.is_met_by_mean(each)
        is_met &= study.is_met(each)
        is_sure &= is_surely_met(study, each)
    asked = ", ".join(requirement_words(study, each) for each in study.requirements)
    sure = int(is_sure[own].sum())
    in_mean = int((is_met & ~is_sure)[own].sum())
    more = f" ({in_mean} more by the mean alone)" if in_mean else ""
    words = f"{sure} of {len(own)} designs meet {asked} with the whole 95 % interval{more}"
    if not sure:
        words = (
            f"no design meets {asked} with the whole 95 % interval, {in_mean} of {len(own)} do by"
            f" the mean alone"
        )
    few = int((by_some & ~is_met)[own].sum())
    some = f"; {few} would by means over some of the launches, which do not count" if few else ""
    if not is_met[own].any():
        return (
            f"no design meets {asked}{some}; {words_of(study, figure)} is"
            f" {_best_words(study, own, figure)}"
        )
    good = own[(is_sure if sure else is_met)[own]]
    least = good[least_costly(study, good)][:_LEAST_COSTLY]
    rows = study.rows(figure)
    labels = _labels(study, rows)
    named = "; or ".join(
        f"{labels[row]}, with {words_of(study, figure)} {mean_text(study, rows, row)}"
        for row in least
    )
    return f"{words}{some}; the least costly: {named}"


def _labels(study: SavedStudy, rows: FigureData) -> list[str]:
    return study.labels(rows, [path for path in study.paths if path != study.split])


def _best_words(study: SavedStudy, own: IntArray, figure: str) -> str:
    rows = study.rows(figure)
    sign = -1.0 if is_higher_better(study, figure) else 1.0
    # A mean over fewer launches is worse than any over more.
    means, shares = (np.nan_to_num(rows[name][own], nan=np.inf) for name in ("mean", "share"))
    best = int(own[np.lexsort((sign * means, -np.where(np.isfinite(means), shares, 0.0)))[0]])
    return f"at best {mean_text(study, rows, best)} ({_labels(study, rows)[best]})"


def least_costly(study: SavedStudy, rows: IntArray) -> BoolArray:
    """Return which designs (n,) no other one of them undercuts; values are listed from the least
    costly on.
    """
    every = study.rows(next(iter(study.units)))
    ranks = []
    for path in study.paths:
        levels = list(dict.fromkeys(every[path].tolist()))
        ranks.append([levels.index(value) for value in every[path][rows].tolist()])
    place = np.array(ranks).T
    undercuts = np.all(place[None] <= place[:, None], axis=2) & np.any(
        place[None] < place[:, None], axis=2
    )
    return np.asarray(~undercuts.any(axis=1))


def _settings_sentence(study: SavedStudy, part: Part, figure: str) -> str:
    """Return by how much each setting changes a figure, from its first to its last value, over the
    others.
    """
    changes = []
    for path in ranked_settings(part.runs):
        levels = part.runs.levels[part.runs.paths.index(path)]
        mean, low, high = part.runs.change(path)
        ends = (
            f"from {level_words(path, level_text(levels[0]))} to"
            f" {level_value(path, level_text(levels[-1]))}"
        )
        text = interval_text(study, figure, mean, low, high)
        if not np.isfinite(mean):
            changes.append(f"of {setting_words(path)[0]} nothing is known: designs lack a value")
        elif low <= 0.0 <= high:
            changes.append(f"no difference shown {ends} ({text})")
        else:
            changes.append(f"{'+' if mean > 0.0 else ''}{text} {ends}")
    of = study.shares_text(figure)
    name = f"{words_of(study, figure)} ({of})" if of else words_of(study, figure)
    return f"Change of {name}, averaged over the other settings: {'; '.join(changes)}"


def _ends_words(study: SavedStudy, own: IntArray, figure: str) -> str:
    """Return how a figure goes from the first to the last design of some, "" where it has no
    value.
    """
    rows = study.rows(figure)
    first = int(own[0])
    last = int(own[-1])
    if not np.isfinite(rows["mean"][[first, last]]).all():
        return ""
    return (
        f"{words_of(study, figure)} goes from {mean_text(study, rows, first)} to"
        f" {mean_text(study, rows, last)}"
    )
