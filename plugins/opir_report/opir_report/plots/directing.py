"""Where a director pointed narrow fields: the targets that they followed over time."""

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np
from matplotlib.axes import Axes

from opir_core.plugin import CommandRecord, Sensor
from opir_report.canvas import legend_of, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import MUTED, Hue
from opir_report.run_facts import RunFacts

#: Sensors that are drawn: those that took the first commands.
SENSORS_SHOWN = 24
PLACE = Hue(MUTED, "-", "a place, or a track of no launch")
#: What a span is for, and its times.
SPAN_COLUMNS = ("track_id", "target_id", "reason", "start_s", "from_s", "until_s")
_COLUMNS = ("sensor_id", *SPAN_COLUMNS, "commands")


def directions(facts: RunFacts) -> FigureData:
    """Return the spans in which fields followed one track, or had one reason: sensor_id, track_id,
    target_id, reason, start_s, from_s, until_s, commands, by sensor and time.

    A field turns from `start_s` to `from_s`, and looks there until `until_s`. `track_id` is -1 for
    a command without a track, `target_id` "" for a place or a track of no launch.
    """
    commands = [record for record in facts.run.commands if not record.refusal]
    order = {sensor.id: place for place, sensor in enumerate(facts.run.sensors)}
    commands.sort(key=lambda record: (order[record.sensor], record.start_s))
    duration_s = facts.plan.scene.duration_s
    rows = [
        (sensor, track, facts.target_ids.get(track, ""), reason, *times_s, count)
        for sensor, records in groupby(commands, lambda record: record.sensor)
        for track, reason, *times_s, count in _spans(list(records), duration_s)
    ]
    return FigureData.of_rows(_COLUMNS, rows)


def _spans(
    records: list[CommandRecord], duration_s: float
) -> Iterator[tuple[int, str, float, float, float, int]]:
    """Yield track, reason, start, first look, end and number of commands of each span of a sensor."""
    groups = [
        list(group)
        for _, group in groupby(
            records, lambda record: (record.track, record.track < 0 and record.reason)
        )
    ]
    ends_s = [*(group[0].start_s for group in groups[1:]), duration_s]
    for group, end_s in zip(groups, ends_s, strict=True):
        record = group[0]
        start_s = min(record.start_s, end_s)
        from_s = min(record.from_s, end_s)
        yield record.track, record.reason, start_s, from_s, end_s, len(group)


def direction_plot(axes: Axes, facts: RunFacts, spans: FigureData) -> Axes:
    """Draw a row for each field that was pointed: a bar where it looks, a thin one where it turns,
    nothing where it is down.
    """
    if not len(spans):
        return without_data(axes, "no narrow field was pointed")
    names = spans.levels("sensor_id")[:SENSORS_SHOWN]
    hue_of = dict(zip(facts.ids, facts.hues.of_target, strict=True))
    sensors = {sensor.id: sensor for sensor in facts.run.sensors}
    for row, name in enumerate(names):
        field_spans = spans.at("sensor_id", name)
        for target in field_spans.levels("target_id"):
            target_spans = field_spans.at("target_id", target)
            colour = hue_of.get(target, PLACE).colour
            draw_bars(axes, row, target_spans, sensors[name], colour)
    omission_count = len(spans.levels("sensor_id")) - len(names)
    omission = f" ({omission_count} more fields were pointed)" if omission_count else ""
    label_rows(axes, facts, names, omission)
    has_place = "" in spans.levels("target_id")
    legend_of(axes, [*facts.hues.legend, *([PLACE] if has_place else [])])
    return axes


def draw_bars(axes: Axes, row: int, spans: FigureData, sensor: Sensor, colour: str) -> None:
    """Draw spans in a row: bars where the sensor looks, from `from_s` to `until_s`, and a thin one
    from `start_s` to `from_s`.
    """
    turn_s = spans["from_s"] - spans["start_s"]
    turns = np.stack([spans["start_s"], turn_s], axis=1)
    looks = [
        (begin_s, end_s - begin_s)
        for span_s in zip(spans["from_s"].tolist(), spans["until_s"].tolist(), strict=True)
        for begin_s, end_s in watched_parts(sensor, *span_s)
    ]
    axes.broken_barh(turns.tolist(), (-row - 0.05, 0.1), color=colour, linewidth=0.0)
    axes.broken_barh(looks, (-row - 0.35, 0.7), color=colour, linewidth=0.0)


def watched_parts(sensor: Sensor, from_s: float, until_s: float) -> Sequence[tuple[float, float]]:
    """Return the parts of a span in which a sensor looks: it may be down, or off."""
    spans = [(from_s, until_s)] if sensor.watched_s is None else sensor.watched_s
    parts = [(max(from_s, begin_s), min(until_s, end_s)) for begin_s, end_s in spans]
    return [(begin_s, end_s) for begin_s, end_s in parts if begin_s < end_s]


def label_rows(axes: Axes, facts: RunFacts, names: list[str], omission: str) -> None:
    """Label the rows of sensors, and the time below them."""
    axes.set_yticks([-float(row) for row in range(len(names))], names)
    axes.set(xlim=(0.0, facts.plan.scene.duration_s), ylim=(-len(names) + 0.4, 0.6))
    axes.set_xlabel(f"scene time, s{omission}")
    axes.grid(axis="y", visible=False)


def directions_height_in(spans: FigureData) -> float:
    """Return the height of the plot, inches."""
    rows = min(len(spans.levels("sensor_id")), SENSORS_SHOWN) if len(spans) else 3
    return 1.7 + 0.33 * rows
