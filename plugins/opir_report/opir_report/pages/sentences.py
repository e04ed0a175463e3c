"""Sentences on a study: means with intervals, verdicts on requirements, the answer to its question."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from opir_core.arrays import BoolArray, IntArray
from opir_report.factorial import ranked_settings
from opir_report.figure_data import FigureData
from opir_report.plots.panels import rows_with_mean
from opir_report.plots.responses import Part, parts_of
from opir_report.plots.trades import is_higher_better
from opir_report.saved_study import CONDITION, SavedStudy, level_text
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


def words_of(study: SavedStudy, figure: str) -> str:
    """Return the name of a figure in words."""
    return figure_words(figure, study.units[figure])


def mean_text(study: SavedStudy, rows: FigureData, row: int) -> str:
    """Return a mean with unit and interval, `0.17 s [0.13, 0.21]`, and its share, if not over all
    launches.
    """
    figure = str(rows["figure"][row])
    interval = (float(rows[name][row]) for name in ("mean", "low_95", "high_95"))
    text = interval_text(study, figure, *interval)
    share = float(rows["share"][row])
    share_text = study.share_text(figure, share, share)
    return f"{text} ({share_text})" if share_text and text != "-" else text


def interval_text(study: SavedStudy, figure: str, mean: float, low: float, high: float) -> str:
    """Return a value of a figure with unit and interval, to two digits of the interval's width."""
    shown = shown_unit(study.units[figure], study.rows(figure)["mean"])
    value, *edges = (number / shown.divisor for number in (mean, low, high))
    if not np.isfinite(value):
        return "-"
    if not np.isfinite(edges).all() or edges[0] >= edges[1]:
        return f"{number_words(value, 3)} {shown.unit}".strip()
    size = int(np.floor(np.log10(max(map(abs, edges)))) - np.floor(np.log10(edges[1] - edges[0])))
    words, *ends = (number_words(number, max(3, size + 2)) for number in (value, *edges))
    return f"{f'{words} {shown.unit}'.strip()} [{', '.join(ends)}]"


def range_sentence(study: SavedStudy, figure: str) -> str:
    """Return the lowest and the highest mean of a figure, with their designs."""
    rows = rows_with_mean(study, figure)
    labels = study.labels(rows)
    means = rows["mean"].tolist()
    words = words_of(study, figure)
    low = int(np.argmin(means))
    high = int(np.argmax(means))
    if means[low] == means[high]:
        return f"{words}: {mean_text(study, rows, low)}{' in all designs' if len(rows) > 1 else ''}"
    ends = (f"{mean_text(study, rows, row)} ({labels[row]})" for row in (low, high))
    return f"{words}: from {' to '.join(ends)}"


def requirement_words(study: SavedStudy, requirement: Mapping[str, Any]) -> str:
    """Return a requirement in words, `warning time at least 900 s`."""
    figure = requirement["figure"]
    limit = requirement["limit"]
    shown = shown_unit(study.units[figure], np.array([limit]))
    value = axis_label(number_words(limit / shown.divisor), shown.unit).replace(", ", " ")
    sense = "at least" if requirement["is_least"] else "at most"
    return f"{words_of(study, figure)} {sense} {value}"


def verdicts(study: SavedStudy) -> list[str]:
    """Return for each requirement the designs whose mean meets it."""
    return [_verdict(study, requirement) for requirement in study.requirements]


def _verdict(study: SavedStudy, requirement: Mapping[str, Any]) -> str:
    rows = study.rows(requirement["figure"])
    labels = study.labels(rows)
    is_met = study.is_met(requirement)
    met = [labels[row] for row in np.flatnonzero(is_met).tolist()]
    names = f": {'; '.join(met[:_NAMED])}{' …' if len(met) > _NAMED else ''}" if any(met) else ""
    words = requirement_words(study, requirement)
    sentence = f"{words}: met by {len(met)} of {len(rows)} designs{names}"
    partial = np.flatnonzero(study.is_met_by_mean(requirement) & ~is_met).tolist()[:_NAMED]
    means = [": ".join(filter(None, (labels[row], mean_text(study, rows, row)))) for row in partial]
    return f"{sentence}; not by a mean over some ({'; '.join(means)})" if means else sentence


def answers(study: SavedStudy) -> list[str]:
    """Return the answer to a study's question, a paragraph for each value of the setting that
    splits it.

    None for a study whose designs are not all combinations of two settings.
    """
    figures = study.shown
    return (
        [_answer(study, part, figures) for part in parts_of(study, figures[0])] if figures else []
    )


def condition_sentences(study: SavedStudy) -> list[str]:
    """Return a sentence on the designs that meet all requirements on means in every condition, none
    for a study without conditions or such requirements.
    """
    if study.split != CONDITION or not study.requirements:
        return []
    rows = study.rows(next(iter(study.units)))
    names = np.array(
        study.labels(rows, study.choices) if study.choices else ["the scene"] * len(rows)
    )
    verdicts_of_all = Verdicts.of(study, np.arange(len(rows)))
    groups = {name: names == name for name in dict.fromkeys(names.tolist())}
    required = ", ".join(requirement_words(study, each) for each in study.requirements)
    texts = [
        _names_text(groups, is_met, how)
        for is_met, how in (
            (verdicts_of_all.is_sure, "with the whole 95 % intervals"),
            (verdicts_of_all.is_met, "by the means alone"),
        )
    ]
    return [f"In every condition {required} is met by {', '.join(texts)}."]


def _names_text(groups: Mapping[str, BoolArray], is_met: BoolArray, how: str) -> str:
    """Return how many groups of designs are met as a whole, and which."""
    meeting = [name for name, of_design in groups.items() if is_met[of_design].all()]
    more = f"; and {len(meeting) - _NAMED} more" if len(meeting) > _NAMED else ""
    names = f": {'; '.join(meeting[:_NAMED])}{more}" if meeting else ""
    return f"{len(meeting)} of {len(groups)} {how}{names}"


def _answer(study: SavedStudy, part: Part, figures: Sequence[str]) -> str:
    name = f"{part.name[0].upper()}{part.name[1:]}: " if part.name else ""
    designs = _designs_of(study, part)
    lines = [
        f"{name}{_requirements_sentence(study, designs, figures[0])}.",
        f"{_settings_sentence(study, part, figures[0])}.",
    ]
    ends = [text for figure in figures[1:] if (text := _ends_words(study, designs, figure))]
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
    """Whether the whole 95 % interval of each design's mean meets a requirement; one run has no
    interval.
    """
    rows = study.rows(requirement["figure"])
    limit = requirement["limit"]
    # A figure that is the same in all runs has an interval without width.
    is_beyond = rows["low_95"] >= limit if requirement["is_least"] else rows["high_95"] <= limit
    return np.asarray(is_beyond) & study.is_whole(requirement["figure"])


class Verdicts(NamedTuple):
    """Whether designs (n,) meet all requirements: with their whole intervals, in the mean, and by
    means over some of the launches too.
    """

    is_sure: BoolArray
    is_met: BoolArray
    is_met_by_mean: BoolArray

    @classmethod
    def of(cls, study: SavedStudy, designs: IntArray) -> "Verdicts":
        """Return the verdicts on designs by their rows (n,)."""
        tests = (is_surely_met, SavedStudy.is_met, SavedStudy.is_met_by_mean)
        return cls(
            *(
                np.logical_and.reduce([test(study, each)[designs] for each in study.requirements])
                for test in tests
            )
        )


def _requirements_sentence(study: SavedStudy, designs: IntArray, figure: str) -> str:
    """Return how many designs meet all requirements, and which is the least costly or comes
    nearest.
    """
    best = f"{words_of(study, figure)} is {_best_words(study, designs, figure)}"
    if not study.requirements:
        return best
    is_sure, is_met, is_met_by_mean = Verdicts.of(study, designs)
    partial = np.count_nonzero(is_met_by_mean & ~is_met)
    omission = (
        f"; {partial} would by means over some of the launches, which do not count"
        if partial
        else ""
    )
    required = ", ".join(requirement_words(study, each) for each in study.requirements)
    if not is_met.any():
        return f"no design meets {required}{omission}; {best}"
    sure = np.count_nonzero(is_sure)
    by_mean = np.count_nonzero(is_met & ~is_sure)
    whole = f"{required} with the whole 95 % interval"
    if sure:
        others = f" ({by_mean} more by the mean alone)" if by_mean else ""
        words = f"{sure} of {len(designs)} designs meet {whole}{others}"
    else:
        words = f"no design meets {whole}, {by_mean} of {len(designs)} do by the mean alone"
    names = _least_costly_words(study, designs[is_sure if sure else is_met], figure)
    return f"{words}{omission}; the least costly: {names}"


def _least_costly_words(study: SavedStudy, designs: IntArray, figure: str) -> str:
    """Return up to three designs that no other one of them undercuts."""
    rows = study.rows(figure)
    labels = _labels(study, rows)
    return "; or ".join(
        f"{labels[row]}, with {words_of(study, figure)} {mean_text(study, rows, row)}"
        for row in designs[least_costly(rows, study.paths, designs)][:3]
    )


def _labels(study: SavedStudy, rows: FigureData) -> list[str]:
    return study.labels(rows, [path for path in study.paths if path != study.split])


def _best_words(study: SavedStudy, designs: IntArray, figure: str) -> str:
    rows = study.rows(figure)
    sign = -1.0 if is_higher_better(study, figure) else 1.0
    # A mean over fewer launches is worse than any over more.
    means, shares = (np.nan_to_num(rows[name][designs], nan=np.inf) for name in ("mean", "share"))
    order = np.lexsort((sign * means, -np.where(np.isfinite(means), shares, 0.0)))
    best = int(designs[order[0]])
    return f"at best {mean_text(study, rows, best)} ({_labels(study, rows)[best]})"


def least_costly(designs: FigureData, paths: Sequence[str], rows: IntArray) -> BoolArray:
    """Whether each of some designs (n,) is undercut by no other one of them; values are listed from
    the least costly on.
    """
    levels = [designs.levels(path) for path in paths]
    ranks = [
        [values.index(value) for value in designs[path][rows].tolist()]
        for path, values in zip(paths, levels, strict=True)
    ]
    rank = np.array(ranks).T
    undercuts = np.all(rank[None] <= rank[:, None], axis=2) & np.any(
        rank[None] < rank[:, None], axis=2
    )
    return np.asarray(~undercuts.any(axis=1))


def _settings_sentence(study: SavedStudy, part: Part, figure: str) -> str:
    """Return by how much each setting changes a figure, from its first to its last value, over the
    others.
    """
    changes = [_change_words(study, part, figure, path) for path in ranked_settings(part.runs)]
    share = study.shares_text(figure)
    name = f"{words_of(study, figure)} ({share})" if share else words_of(study, figure)
    return f"Change of {name}, averaged over the other settings: {'; '.join(changes)}"


def _change_words(study: SavedStudy, part: Part, figure: str, path: str) -> str:
    levels = part.runs.levels_of(path)
    mean, low, high = part.runs.change(path)
    if not np.isfinite(mean):
        return f"of {setting_words(path)[0]} nothing is known: designs lack a value"
    start = level_words(path, level_text(levels[0]))
    end = level_value(path, level_text(levels[-1]))
    text = interval_text(study, figure, mean, low, high)
    if low <= 0.0 <= high:
        return f"no difference shown from {start} to {end} ({text})"
    return f"{'+' if mean > 0.0 else ''}{text} from {start} to {end}"


def _ends_words(study: SavedStudy, designs: IntArray, figure: str) -> str:
    """Return the change of a figure from the first to the last of some designs, "" where it has no
    value.
    """
    rows = study.rows(figure)
    ends = designs[[0, -1]].tolist()
    if not np.isfinite(rows["mean"][ends]).all():
        return ""
    start, end = (mean_text(study, rows, row) for row in ends)
    return f"{words_of(study, figure)} goes from {start} to {end}"
