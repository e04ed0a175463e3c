"""Confidence over time: of the detections of each target, and of its track's type."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from attrs import evolve
from matplotlib.axes import Axes
from numpy.typing import NDArray

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_report.canvas import legend_entry, legend_of, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import Hue
from opir_report.run_facts import RunFacts

_BINS = 60
_NAMES = (
    "series",
    "since_ignition_s",
    "detections",
    "low",
    "median",
    "high",
    "type_right",
    "track_type_probability",
)


def confidences(facts: RunFacts) -> FigureData:
    """Return, by series and time since ignition, the confidence of detections: quantiles 5, 50 and
    95 %.

    A series is a target, or a type where there are many targets. `type_right` is the share of
    detections that report the right type, `track_type_probability` the probability of the likeliest
    type of a track at the middle of the bin, the mean over targets; nan without a track.
    """
    return FigureData.of_rows(
        _NAMES, (row for hue in facts.hues.legend for row in _rows(facts, hue))
    )


def _rows(facts: RunFacts, hue: Hue) -> Iterator[tuple[object, ...]]:
    """Yield the rows of a series."""
    targets = [target for target in range(facts.launches) if facts.hues.of_target[target] == hue]
    rows = np.flatnonzero(np.isin(facts.run.truth.target, targets))
    if not len(rows):
        return
    detections = facts.run.detections
    since_s = detections.time_s[rows] - facts.plan.targets.ignition_s[facts.run.truth.target[rows]]
    width_s = max(float(since_s.max()) / _BINS, 1e-9)
    bins = np.minimum((since_s / width_s).astype(np.int64), _BINS - 1)
    middle_s = width_s * np.arange(0.5, _BINS)
    probability = _track_probability(facts, targets, middle_s)
    for number in np.unique(bins).tolist():
        bin_rows = rows[bins == number]
        yield (
            hue.label,
            float(middle_s[number]),
            len(bin_rows),
            *np.nanquantile(detections.confidence[bin_rows], [0.05, 0.5, 0.95]).tolist(),
            float(_is_right(facts, bin_rows).mean()),
            float(probability[number]),
        )


def _is_right(facts: RunFacts, rows: IntArray) -> BoolArray:
    """Whether detections (n,) of launches report the right type."""
    codes = facts.right_codes[facts.run.truth.target[rows]]
    return facts.run.detections.reported_type[rows] == codes


def _track_probability(
    facts: RunFacts, targets: Sequence[int], since_s: NDArray[Any]
) -> FloatArray:
    """Return the mean probability (n,) of the likeliest type of targets' tracks at times since
    ignition (n,).
    """
    total = np.zeros(len(since_s))
    count = np.zeros(len(since_s))
    for target in targets:
        tracks = facts.in_force(target)
        if not len(tracks):
            continue
        time_s = since_s + facts.plan.targets.ignition_s[target]
        row = np.searchsorted(tracks.tick_s, time_s, side="right") - 1
        probability = np.where(row >= 0, tracks.type_probability[row].max(axis=1), np.nan)
        is_known = np.isfinite(probability)
        total[is_known] += probability[is_known]
        count += is_known
    mean: FloatArray = np.divide(total, count, out=np.full(len(since_s), np.nan), where=count > 0)
    return mean


def confidence_plot(axes: Axes, facts: RunFacts, data: FigureData) -> Axes:
    """Draw the median confidence of detections with a band of 90 %, and dotted the track's type
    probability.
    """
    if not len(data):
        return without_data(axes, "no target was detected")
    for hue in facts.hues.legend:
        series = data.at("series", hue.label)
        time_s = series["since_ignition_s"]
        axes.plot(time_s, series["median"], color=hue.colour)
        axes.fill_between(
            time_s, series["low"], series["high"], color=hue.colour, alpha=0.15, linewidth=0
        )
        axes.plot(time_s, series["track_type_probability"], color=hue.colour, linestyle=":")
    axes.set(xlabel="time since ignition, s", ylabel="confidence", ylim=(-0.03, 1.03))
    marks = [legend_entry("detections: median, 5 to 95 %")]
    if np.isfinite(data["track_type_probability"]).any():
        marks.append(legend_entry("type probability of the track", linestyle=":"))
    legend_of(axes, [evolve(hue, dashes="-") for hue in facts.hues.legend], marks)
    return axes
