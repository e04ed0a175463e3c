"""The timeline: detections of each sensor over time, by target."""

from collections import Counter

import numpy as np
from matplotlib.axes import Axes

from opir_core.arrays import IntArray
from opir_report.canvas import legend_of, without_data
from opir_report.figure_data import FigureData
from opir_report.maps.projections import nice_step
from opir_report.palette import INK, MUTED, Hue
from opir_report.run_facts import RunFacts

#: Widths that bins of time may have, s.
_WIDTHS_S = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0, 7200.0)
#: Sensors that are drawn: those with the most detections.
_SENSORS_SHOWN = 24
FALSE_ALARM = Hue(MUTED, "-", "other source or false alarm")


def detection_counts(facts: RunFacts) -> FigureData:
    """Return detections by sensor, target and time, in up to 150 bins: sensor_id, target_id,
    start_s, stop_s, detections.

    `target_id` is "" for false alarms.
    """
    run = facts.run
    duration_s = facts.plan.scene.duration_s
    width_s = nice_step(duration_s, 150, _WIDTHS_S)
    bins = max(int(np.ceil(duration_s / width_s)), 1)
    place = np.clip((run.detections.time_s // width_s).astype(np.int64), 0, bins - 1)
    targets = len(run.target_ids) + 1
    key = (run.detections.sensor * targets + run.truth.target + 1) * bins + place
    keys, count = np.unique(key, return_counts=True)
    pair, start = np.divmod(keys, bins)
    sensor, target = np.divmod(pair, targets)
    names = ["", *run.target_ids]
    return FigureData(
        {
            "sensor_id": np.array([run.sensors[row].id for row in sensor.tolist()]),
            "target_id": np.array([names[row] for row in target.tolist()]),
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
    sensors = _sensors_by_detections(facts, counts)
    names = sorted(sensors[:_SENSORS_SHOWN], key=[sensor.id for sensor in facts.run.sensors].index)
    width_s = float(np.max(counts["stop_s"] - counts["start_s"]))
    for row, name in enumerate(names):
        _draw_sensor(axes, facts, counts.at("sensor_id", name), -row, width_s)
    top = _draw_burns(axes, facts)
    places = [0.5 * (1.0 + top), *(0.4 - row for row in range(len(names)))]
    axes.set_yticks(places, ["burns", *names])
    axes.set(xlim=(0.0, facts.plan.scene.duration_s), ylim=(-len(names) + 0.85, top + 0.1))
    axes.set_xlabel(_time_label(facts, len(sensors), len(names), width_s))
    axes.grid(axis="y", visible=False)
    has_noise = not set(counts["target_id"].tolist()) <= set(facts.ids)
    legend_of(axes, [*facts.hues.legend, *([FALSE_ALARM] if has_noise else [])])
    return axes


def _sensors_by_detections(facts: RunFacts, counts: FigureData) -> list[str]:
    """Return the sensors with detections, those with the most detections first."""
    totals = Counter[str]()
    for name, count in zip(
        counts["sensor_id"].tolist(), counts["detections"].tolist(), strict=True
    ):
        totals[name] += count
    names = [sensor.id for sensor in facts.run.sensors if sensor.id in totals]
    return sorted(names, key=lambda name: -totals[name])


def _time_label(facts: RunFacts, detecting: int, drawn: int, width_s: float) -> str:
    """Return the label of the time axis, with the numbers of sensors."""
    total = len(facts.run.sensors)
    words = f"detections in {width_s:g} s; {total - detecting} of {total} sensors without"
    omission = f"; {detecting - drawn} more sensors detected" if detecting > drawn else ""
    return f"scene time, s ({words}{omission})"


def _draw_burns(axes: Axes, facts: RunFacts) -> float:
    """Draw the burns of the launches above the sensors; return the height of their upper edge."""
    height = min(0.8, 2.4 / max(facts.launches, 1))
    for target in range(facts.launches):
        start_s = facts.plan.targets.ignition_s[target]
        duration_s = facts.plan.targets.burnout_s[target] - start_s
        bottom = 1.0 + height * (facts.launches - 1 - target)
        colour = facts.hues.of_target[target].colour
        axes.broken_barh(
            [(start_s, duration_s)], (bottom, 0.8 * height), color=colour, linewidth=0.0
        )
    return 1.0 + height * facts.launches


def _draw_sensor(
    axes: Axes, facts: RunFacts, counts: FigureData, bottom: int, width_s: float
) -> None:
    """Draw the stacked counts of a sensor; their maximum is 0.8 high."""
    bins = int(np.ceil(facts.plan.scene.duration_s / width_s))
    place = np.rint(counts["start_s"] / width_s).astype(np.int64)
    total = np.bincount(place, counts["detections"], minlength=bins)
    scale = 0.8 / float(total.max())
    base = np.zeros(bins)
    hues = [*facts.hues.legend, FALSE_ALARM]
    series = _series(facts, counts, hues)
    for number in np.unique(series).tolist():
        rows = series == number
        height = np.bincount(place[rows], counts["detections"][rows], minlength=bins)
        axes.stairs(
            bottom + scale * (base + height),
            np.arange(bins + 1) * width_s,
            baseline=bottom + scale * base,
            fill=True,
            color=hues[number].colour,
            linewidth=0,
        )
        base = base + height
    axes.axhline(bottom, color=MUTED, linewidth=0.5)
    axes.annotate(
        f"at most {int(total.max())}",
        (1.01, bottom + 0.4),
        xycoords=("axes fraction", "data"),
        fontsize=8,
        color=INK,
        ha="left",
        va="center",
    )


def _series(facts: RunFacts, counts: FigureData, hues: list[Hue]) -> IntArray:
    """Return the number of the hue (n,) of each count's target."""
    hue_of = dict(zip(facts.ids, facts.hues.of_target, strict=True))
    names = counts["target_id"].tolist()
    return np.array([hues.index(hue_of.get(name, FALSE_ALARM)) for name in names])
