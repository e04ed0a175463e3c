"""Tracks against truth over time: impact regions by area and containment, and the NEES of
states.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from opir_scoring import chi_square_quantiles, impact_scores

from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_report.canvas import legend_entry, legend_of, log_ticks, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import MUTED, PAPER, Hue
from opir_report.run_facts import RunFacts

#: Components of a state.
_FREEDOM = 6
_PERCENT = [round(100 * containment) for containment in TRACK_CONTAINMENTS]


def region_history(facts: RunFacts) -> FigureData:
    """Return predicted impacts tick by tick.

    target_id, tick_s, since_ignition_s, impact_error_km, and for each of 50, 90 and 95 % the area
    of the region, km², and whether it contains the true impact (1, 0 or nan).
    """
    scores = impact_scores(facts.evidence, facts.owners)
    columns = {
        "target_id": facts.target_names(scores.target),
        "tick_s": scores.tick_s,
        "since_ignition_s": scores.tick_s - facts.plan.targets.ignition_s[scores.target],
        "impact_error_km": 1e-3 * scores.impact_m,
    }
    for place, percent in enumerate(_PERCENT):
        columns[f"area_{percent}_km2"] = scores.area_km2[:, place]
        columns[f"contained_{percent}"] = scores.contained[:, place]
    return FigureData(columns)


def containment_plot(axes: Axes, facts: RunFacts, data: FigureData) -> Axes:
    """Draw the area of each target's 95 % region over time, filled where it contains the true
    impact.
    """
    history = _positive(data, "area_95_km2")
    if not len(history):
        return without_data(axes, "no impact was predicted")
    for hue, name in zip(facts.hues.of_target, facts.ids, strict=False):
        _draw_regions(axes, history.at("target_id", name), hue)
    axes.set(yscale="log", xlabel="time since ignition, s", ylabel="area of the 95 % region, km²")
    axes.set_title(f"impact inside: {', '.join(_share_text(data, each) for each in _PERCENT)}")
    style: dict[str, Any] = {"marker": "o", "linestyle": "", "markersize": 4}
    marks = [
        legend_entry("contains the true impact", **style),
        legend_entry("does not", markerfacecolor=PAPER, **style),
    ]
    legend_of(axes, facts.hues.legend, marks)
    log_ticks(axes.yaxis)
    return axes


def _positive(data: FigureData, name: str) -> FigureData:
    """Return the rows with a finite, positive value in a column."""
    return data.where(np.isfinite(data[name]) & (data[name] > 0.0))


def _draw_regions(axes: Axes, history: FigureData, hue: Hue) -> None:
    axes.plot(
        history["since_ignition_s"],
        history["area_95_km2"],
        linewidth=1.0,
        alpha=0.7,
        **hue.style,
    )
    for is_inside, face in ((1.0, hue.colour), (0.0, PAPER)):
        points = history.at("contained_95", is_inside)
        axes.plot(
            points["since_ignition_s"],
            points["area_95_km2"],
            marker="o",
            color=hue.colour,
            markersize=3.2,
            linestyle="",
            markerfacecolor=face,
            markeredgewidth=0.8,
        )


def _share_text(data: FigureData, percent: int) -> str:
    """Return how many of the regions of a containment contain the true impact."""
    contained = data[f"contained_{percent}"]
    contained = contained[np.isfinite(contained)]
    return f"{percent} %: {int(contained.sum())}/{len(contained)}"


def nees_history(facts: RunFacts) -> FigureData:
    """Return the states' errors tick by tick: target_id, since_ignition_s, position and velocity
    error, NEES over 6.
    """
    errors = facts.states
    return FigureData(
        {
            "target_id": facts.target_names(errors.target),
            "since_ignition_s": errors.since_s,
            "position_error_m": errors.position_m,
            "velocity_error_m_s": errors.velocity_m_s,
            "nees_over_6": errors.nees / _FREEDOM,
        }
    )


def nees_plot(axes: Axes, facts: RunFacts, data: FigureData) -> Axes:
    """Draw the NEES of each target's track over time, divided by 6, with the band of 99 % of single
    samples.
    """
    history = _positive(data, "nees_over_6")
    if not len(history):
        return without_data(axes, "no track whose true state is known")
    low, high = (
        float(chi_square_quantiles(share, _FREEDOM)) / _FREEDOM for share in (0.005, 0.995)
    )
    axes.axhspan(low, high, color=MUTED, alpha=0.15, linewidth=0)
    axes.axhline(1.0, color=MUTED, linewidth=1.0)
    for hue, name in zip(facts.hues.of_target, facts.ids, strict=False):
        track = history.at("target_id", name)
        axes.plot(track["since_ignition_s"], track["nees_over_6"], linewidth=1.1, **hue.style)
    nees = history["nees_over_6"]
    inside = np.count_nonzero((nees >= low) & (nees <= high))
    axes.set(yscale="log", xlabel="time since ignition, s", ylabel="NEES / 6")
    axes.set_title(
        f"{inside} of {len(nees)} estimates in the band of 99 %; above 1 is overconfident"
    )
    legend_of(axes, facts.hues.legend)
    log_ticks(axes.yaxis)
    return axes
