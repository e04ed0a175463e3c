"""The timeline: detections of each sensor over time, by target."""

import numpy as np
from matplotlib.axes import Axes

from opir_report.canvas import legend_of, without_data
from opir_report.figure_data import FigureData
from opir_report.maps.projections import nice_step
from opir_report.palette import INK, MUTED, Hue
from opir_report.run_facts import RunFacts

#: Most bins of time, and the widths that bins may have, s.
_BINS = 150
_WIDTHS_S = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0, 7200.0)
#: Sensors that are drawn: those with the most detections.
_SHOWN = 24
FALSE_ALARM = Hue(MUTED, "-", "other source or false alarm")


def detection_counts(facts: RunFacts) -> FigureData:
    """Return detections by sensor, target and time: sensor_id, target_id, start_s, stop_s,
    detections.

    `target_id` is "" for false alarms.
    """
    run = facts.run
    duration_s = facts.plan.scene.duration_s
    width_s = nice_step(duration_s, _BINS, _WIDTHS_S)
    bins = max(int(np.ceil(duration_s / width_s)), 1)
    place = np.clip((run.detections.time_s // width_s).astype(np.int64), 0, bins - 1)
    targets = len(run.target_ids) + 1
    key = (run.detections.sensor * targets + run.truth.target + 1) * bins + place
    found, count = np.unique(key, return_counts=True)
    pair, start = np.divmod(found, bins)
    sensor, target = np.divmod(pair, targets)
    names = ["", *run.target_ids]
    return FigureData(
        {
            "sensor_id": np.array([run.sensors[each].id for each in sensor.tolist()]),
            "target_id": np.array([names[each] for each in target.tolist()]),
            "start_s": start * width_s,
            "stop_s": np.minimum((start + 1) * width_s, duration_s),
            "detections": count,
        }
    )


def timeline(axes: Axes, facts: RunFacts, counts: FigureData) -> Axes:
    """Draw a row for each sensor with detections: their number over time, stacked by target; burns
    on top.
    """
    if not len(counts):
        return without_data(axes, "no sensor detected anything")
    names, place = np.unique(counts["sensor_id"], return_inverse=True)
    totals = dict(
        zip(
            names.tolist(),
            np.bincount(place, counts["detections"]).astype(np.int64).tolist(),
            strict=True,
        )
    )
    order = [sensor.id for sensor in facts.run.sensors if sensor.id in totals]
    shown = sorted(sorted(order, key=lambda name: -totals[name])[:_SHOWN], key=order.index)
    width_s = float(np.max(counts["stop_s"] - counts["start_s"]))
    for row, name in enumerate(shown):
        _draw_sensor(axes, facts, counts.where(counts["sensor_id"] == name), -row, width_s)
    height = min(0.8, 2.4 / max(facts.launches, 1))
    for target in range(facts.launches):
        start_s = facts.plan.targets.ignition_s[target]
        stop_s = facts.plan.targets.burnout_s[target]
        bottom = 1.0 + height * (facts.launches - 1 - target)
        spans = [(start_s, stop_s - start_s)]
        colour = facts.hues.of_target[target].colour
        axes.broken_barh(spans, (bottom, 0.8 * height), color=colour, linewidth=0.0)
    silent = len(facts.run.sensors) - len(order)
    top = 1.0 + height * facts.launches
    axes.set_yticks(
        [0.5 * (1.0 + top), *(0.4 - row for row in range(len(shown)))], ["burns", *shown]
    )
    axes.set(xlim=(0.0, facts.plan.scene.duration_s), ylim=(-len(shown) + 0.85, top + 0.1))
    more = f"; {len(order) - len(shown)} more sensors detected" if len(order) > len(shown) else ""
    words = (
        f"detections in {width_s:g} s; {silent} of {len(facts.run.sensors)} sensors without{more}"
    )
    axes.set_xlabel(f"scene time, s ({words})")
    axes.grid(axis="y", visible=False)
    noise = [FALSE_ALARM] if not set(counts["target_id"].tolist()) <= set(facts.ids) else []
    legend_of(axes, [*facts.hues.legend, *noise])
    return axes


def _draw_sensor(
    axes: Axes, facts: RunFacts, counts: FigureData, bottom: int, width_s: float
) -> None:
    """Draw the stacked counts of a sensor, as high as 0.8 where they are most."""
    place = np.rint(counts["start_s"] / width_s).astype(np.int64)
    bins = int(np.ceil(facts.plan.scene.duration_s / width_s))
    total = np.bincount(place, counts["detections"], minlength=bins)
    scale = 0.8 / float(total.max())
    below = np.zeros(bins)
    edges = np.arange(bins + 1) * width_s
    hue_of = dict(zip(facts.ids, facts.hues.of_target, strict=True))
    names, row = np.unique(counts["target_id"], return_inverse=True)
    hues = np.array([_order(facts, hue_of.get(name)) for name in names.tolist()])[row]
    for number in np.unique(hues).tolist():
        own = hues == number
        above = below + np.bincount(place[own], counts["detections"][own], minlength=bins)
        colour = [*facts.hues.legend, FALSE_ALARM][number].colour
        axes.stairs(
            bottom + scale * above,
            edges,
            baseline=bottom + scale * below,
            fill=True,
            color=colour,
            linewidth=0,
        )
        below = above
    axes.axhline(bottom, color=MUTED, linewidth=0.5)
    words = f"at most {int(total.max())}"
    axes.annotate(
        words,
        (1.01, bottom + 0.4),
        xycoords=("axes fraction", "data"),
        fontsize=8,
        color=INK,
        ha="left",
        va="center",
    )


def _order(facts: RunFacts, hue: Hue | None) -> int:
    """Return the place of a hue in the legend; of what is no launch, the place after the last."""
    return len(facts.hues.legend) if hue is None else facts.hues.legend.index(hue)
