"""Confidence over time: of the detections of each target, and of its track's type."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from attrs import evolve
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from opir_core.arrays import FloatArray
from opir_report.canvas import legend_of, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import INK, Hue
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
    rows = [row for hue in facts.hues.legend for row in _rows(facts, hue)]
    return FigureData.of_rows(_NAMES, rows)


def _rows(facts: RunFacts, hue: Hue) -> list[tuple[object, ...]]:
    run = facts.run
    ignition_s = facts.plan.targets.ignition_s
    targets = [target for target in range(facts.launches) if facts.hues.of_target[target] == hue]
    own = np.flatnonzero(np.isin(run.truth.target, targets))
    if not len(own):
        return []
    target = run.truth.target[own]
    since_s = run.detections.time_s[own] - ignition_s[target]
    confidence = run.detections.confidence[own]
    right = np.array([facts.right_code(each) for each in range(facts.launches)])
    is_right = run.detections.reported_type[own] == right[target]
    width_s = max(float(since_s.max()) / _BINS, 1e-9)
    place = np.minimum((since_s / width_s).astype(np.int64), _BINS - 1)
    chances = _track_chances(facts, targets, (np.arange(_BINS) + 0.5) * width_s)
    rows = list[tuple[object, ...]]()
    for each in np.unique(place).tolist():
        here = place == each
        quantiles = np.nanquantile(confidence[here], [0.05, 0.5, 0.95]).tolist()
        shares = float(is_right[here].mean()), float(chances[each])
        rows.append(
            (hue.label, (each + 0.5) * width_s, int(np.count_nonzero(here)), *quantiles, *shares)
        )
    return rows


def _track_chances(facts: RunFacts, targets: Sequence[int], since_s: NDArray[Any]) -> FloatArray:
    """Return the mean probability (n,) of the likeliest type of targets' tracks at times since
    ignition (n,).
    """
    total = np.zeros(len(since_s))
    count = np.zeros(len(since_s))
    for target in targets:
        tracks = facts.in_force(target)
        if not len(tracks):
            continue
        before = (
            np.searchsorted(
                tracks.tick_s, since_s + facts.plan.targets.ignition_s[target], side="right"
            )
            - 1
        )
        chance = np.where(before >= 0, tracks.type_probability[before].max(axis=1), np.nan)
        known = np.isfinite(chance)
        total[known] += chance[known]
        count += known
    mean: FloatArray = np.divide(total, count, out=np.full(len(since_s), np.nan), where=count > 0)
    return mean


def confidence_plot(axes: Axes, facts: RunFacts, data: FigureData) -> Axes:
    """Draw the median confidence of detections with a band of 90 %, and dotted the track's type
    probability.
    """
    if not len(data):
        return without_data(axes, "no target was detected")
    has_track = bool(np.isfinite(data["track_type_probability"]).any())
    for hue in facts.hues.legend:
        own = data.where(data["series"] == hue.label)
        axes.plot(own["since_ignition_s"], own["median"], color=hue.colour)
        axes.fill_between(
            own["since_ignition_s"],
            own["low"],
            own["high"],
            color=hue.colour,
            alpha=0.15,
            linewidth=0,
        )
        axes.plot(
            own["since_ignition_s"], own["track_type_probability"], color=hue.colour, linestyle=":"
        )
    axes.set(xlabel="time since ignition, s", ylabel="confidence", ylim=(-0.03, 1.03))
    marks = [Line2D([], [], color=INK, label="detections: median, 5 to 95 %")]
    marks += (
        [Line2D([], [], color=INK, linestyle=":", label="type probability of the track")]
        if has_track
        else []
    )
    legend_of(axes, [evolve(hue, dashes="-") for hue in facts.hues.legend], marks)
    return axes
