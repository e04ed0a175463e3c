"""Means of studies as text: with intervals, and with the share of launches or runs that a mean is
over.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from opir_scoring import NOT_SHOWN, percent_text, share_text

from opir_studies.requirements import FigureRequirement
from opir_studies.result import StudyResult

#: The most designs that are named as meeting a requirement.
_MOST_NAMED = 3
#: The most designs whose shares are printed.
_MOST_VERDICTS = 12
#: Means from here on are printed to three digits.
_LARGE = 1e5


def cell(row: Mapping[str, Any]) -> str:
    """Return a mean with its interval, to two digits of the interval: `0.28 [0.23, 0.34]`.

    A share that has a value follows where it is not all: `0.28 [0.23, 0.34] (95 %)`.
    """
    text = _interval_text(row, "mean", "low_95", "high_95")
    return text if row["share"] == 1.0 or text == "-" else f"{text} ({percent_text(row['share'])})"


def difference_cell(row: Mapping[str, Any], reference: Mapping[str, Any]) -> str:
    """Return the difference of two means; the shares that they are of follow if one is not all."""
    text = _interval_text(row, "difference", "difference_low_95", "difference_high_95")
    if row["share"] == reference["share"] == 1.0 or text == "-":
        return text
    return f"{text} ({percent_text(row['share'])} minus {percent_text(reference['share'])})"


def share_lines(result: StudyResult, figures: Sequence[str]) -> Sequence[str]:
    """Return lines on those of some figures that launches, or runs, lack; none if all have them."""
    partial = [name for name in figures if any(row["share"] != 1.0 for row in result.rows(name))]
    with_value = {
        name: sum(row["runs_with_value"] for row in result.rows(name)) for name in partial
    }
    lines = []
    runs = result.run_count
    for of, are_of in (("launches", True), ("runs", False)):
        names = [name for name in partial if (name in result.definition["shares"]) == are_of]
        counts = ", ".join(f"{name} in {with_value[name]}" for name in names)
        if names:
            lines.append(
                f"(%): the mean is over that share of the {of}. With a value: {counts} of {runs}"
                f" runs"
            )
    return ["\n".join(lines)] if lines else []


def verdict_lines(result: StudyResult) -> Sequence[str]:
    """Return for each requirement the designs that meet it, and those whose mean is not of all."""
    designs = result.definition["designs"]
    names = np.array([", ".join(str(design[path]) for path in result.paths) for design in designs])
    lines = []
    for settings in result.definition["requirements"]:
        required = FigureRequirement(**settings)
        rows = result.rows(settings["figure"])
        means, shares = (np.array([row[key] for row in rows]) for key in ("mean", "share"))
        met = required.is_met(means, shares)
        by_others = required.is_met(means, np.ones(len(rows))) & ~met
        named = [f"({'; '.join(examples)})"] if (examples := _few(names[met].tolist())) else []
        lines.append(
            " ".join([f"{required}: met by {met.sum()} of {len(designs)} designs", *named])
        )
        if by_others.any():
            of = "launches" if required.figure in result.definition["shares"] else "runs"
            counts = [
                f"{percent_text(row['share'])} of the {of} in {row['runs']} runs" for row in rows
            ]
            words = [
                ": ".join(filter(None, pair)) for pair in zip(names.tolist(), counts, strict=True)
            ]
            examples = _few(np.array(words)[by_others].tolist())
            lines.append(
                f"  not by a mean over some, as {of} without the figure miss it: {'; '.join(examples)}"
            )
    return ["\n".join(lines)] if lines else []


def share_verdict_lines(result: StudyResult) -> Sequence[str]:
    """Return for each required share of launches the verdict on every design, over all conditions
    and in the worst.
    """
    rows = [row for row in result.shares.to_pylist() if not row["by"]]
    lines = []
    for requirement in dict.fromkeys(row["requirement"] for row in rows):
        of_design: dict[int, list[Mapping[str, Any]]] = {}
        for row in rows:
            if row["requirement"] == requirement:
                of_design.setdefault(row["design"], []).append(row)
        texts = [f"  {_verdict_text(result, shares)}" for shares in of_design.values()]
        counts = Counter(shares[0]["verdict"] for shares in of_design.values())
        more = ", ".join(f"{verdict}: {count}" for verdict, count in counts.items())
        lines += [requirement, *texts[:_MOST_VERDICTS]]
        if len(texts) > _MOST_VERDICTS:
            lines.append(f"  … of {len(texts)} designs {more}")
    return ["\n".join(lines)] if lines else []


def _verdict_text(result: StudyResult, rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the verdict on a design from its share over all conditions and those in each."""
    overall, *conditions = rows
    chosen = [path for path in result.paths if path not in result.definition["conditions"]]
    name = ", ".join(label_text(overall[path]) for path in chosen)
    verdict = overall["verdict"]
    parts = [
        f"{_share_text(overall)} of {overall['launches']} launches with {overall['runs']} seeds"
    ]
    if conditions:
        worst = min(conditions, key=lambda row: row["share"])
        parts.append(f"worst condition {worst['condition']}: {_share_text(worst)}")
    if verdict == NOT_SHOWN:
        verdict = f"{verdict} either way"
        runs = overall["deciding_runs"]
        parts.append(
            f"about {runs} runs would decide"
            if runs
            else "at this share no number of runs up to a million would decide"
        )
    return ": ".join(filter(None, (name, verdict, "; ".join(parts))))


def label_text(label: Any) -> str:
    """Return the label of a level as text, whole numbers without decimals."""
    return f"{label:g}" if isinstance(label, float) else str(label)


def _share_text(row: Mapping[str, Any]) -> str:
    return share_text(row["share"], row["low"], row["high"])


def _few(names: Sequence[str]) -> list[str]:
    shown = [name for name in names if name]
    return shown[:_MOST_NAMED] + ["…"] * (len(shown) > _MOST_NAMED)


def _interval_text(row: Mapping[str, Any], mean: str, low: str, high: str) -> str:
    if not math.isfinite(row[mean]):
        return "-"
    if not math.isfinite(row[low]) or row[low] == row[high]:
        return f"{row[mean]:.3g}" if abs(row[mean]) >= _LARGE else f"{row[mean]:.4g}"
    if abs(row[mean]) >= _LARGE:
        return f"{row[mean]:.3g} [{row[low]:.3g}, {row[high]:.3g}]"
    digits = _digits(row[mean], row[high] - row[low])
    return f"{row[mean]:.{digits}f} [{row[low]:.{digits}f}, {row[high]:.{digits}f}]"


def _digits(mean: float, width: float) -> int:
    """Return the decimals that show two digits of an interval's width, or four of the mean without
    one.
    """
    size = width if width > 0.0 else abs(mean) * 1e-2
    return min(max(0, 1 - math.floor(math.log10(size))), 9) if size > 0.0 else 0
