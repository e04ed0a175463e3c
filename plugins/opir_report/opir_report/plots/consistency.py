"""Tracks against truth over time: impact regions by area and containment, and the NEES of
states.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from opir_scoring import impact_scores, state_errors
from scipy.stats import chi2

from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_report.canvas import legend_of, log_ticks, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import INK, MUTED, PAPER
from opir_report.run_facts import RunFacts

_FREEDOM = 6
#: The share of single samples between the band's edges.
_BAND = 0.99
_PERCENT = [round(100 * each) for each in TRACK_CONTAINMENTS]


def region_history(facts: RunFacts) -> FigureData:
    """Return predicted impacts tick by tick: target_id, tick_s, since_ignition_s, impact_error_km,
    and for each of 50, 90 and 95 % the area of the region, km², and whether it contains the true
    impact (1, 0 or nan)."""
    scores = impact_scores(facts.evidence, facts.owners)
    columns = {
        "target_id": np.array([facts.ids[each] for each in scores.target.tolist()], dtype=object),
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
    known = data.where(np.isfinite(data["area_95_km2"]) & (data["area_95_km2"] > 0.0))
    if not len(known):
        return without_data(axes, "no impact was predicted")
    for target, name in enumerate(facts.ids):
        own = known.where(known["target_id"] == name)
        colour = facts.hues.of_target[target].colour
        dashes = facts.hues.of_target[target].dashes
        axes.plot(
            own["since_ignition_s"],
            own["area_95_km2"],
            color=colour,
            linestyle=dashes,
            linewidth=1.0,
            alpha=0.7,
        )
        for is_inside, face in ((1.0, colour), (0.0, PAPER)):
            here = own.where(own["contained_95"] == is_inside)
            style: dict[str, Any] = {
                "markersize": 3.2,
                "linestyle": "",
                "markerfacecolor": face,
                "markeredgewidth": 0.8,
            }
            axes.plot(
                here["since_ignition_s"], here["area_95_km2"], marker="o", color=colour, **style
            )
    axes.set(yscale="log", xlabel="time since ignition, s", ylabel="area of the 95 % region, km²")
    shares = []
    for percent in _PERCENT:
        judged = data[f"contained_{percent}"][np.isfinite(data[f"contained_{percent}"])]
        shares.append(f"{percent} %: {int(judged.sum())}/{len(judged)}")
    axes.set_title(f"impact inside: {', '.join(shares)}")
    marks = [
        Line2D(
            [],
            [],
            color=INK,
            marker="o",
            linestyle="",
            markersize=4,
            label="contains the true impact",
        ),
        Line2D(
            [],
            [],
            color=INK,
            marker="o",
            linestyle="",
            markersize=4,
            markerfacecolor=PAPER,
            label="does not",
        ),
    ]
    legend_of(axes, facts.hues.legend, marks)
    log_ticks(axes.yaxis)
    return axes


def nees_history(facts: RunFacts) -> FigureData:
    """Return the states' errors tick by tick: target_id, since_ignition_s, position and velocity
    error, NEES over 6.
    """
    errors = state_errors(facts.evidence, facts.owners)
    return FigureData(
        {
            "target_id": np.array(
                [facts.ids[each] for each in errors.target.tolist()], dtype=object
            ),
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
    known = data.where(np.isfinite(data["nees_over_6"]) & (data["nees_over_6"] > 0.0))
    if not len(known):
        return without_data(axes, "no track whose true state is known")
    low, high = (
        float(chi2.ppf(p, _FREEDOM)) / _FREEDOM for p in (0.5 - 0.5 * _BAND, 0.5 + 0.5 * _BAND)
    )
    axes.axhspan(low, high, color=MUTED, alpha=0.15, linewidth=0)
    axes.axhline(1.0, color=MUTED, linewidth=1.0)
    for target, name in enumerate(facts.ids):
        own = known.where(known["target_id"] == name)
        hue = facts.hues.of_target[target]
        axes.plot(
            own["since_ignition_s"],
            own["nees_over_6"],
            color=hue.colour,
            linestyle=hue.dashes,
            linewidth=1.1,
        )
    inside = np.count_nonzero((known["nees_over_6"] >= low) & (known["nees_over_6"] <= high))
    axes.set(yscale="log", xlabel="time since ignition, s", ylabel="NEES / 6")
    axes.set_title(
        f"{inside} of {len(known)} estimates in the band of 99 %; above 1 is overconfident"
    )
    legend_of(axes, facts.hues.legend)
    log_ticks(axes.yaxis)
    return axes
