"""The modes of sensors over time, and why they were in them."""

from collections.abc import Iterator
from itertools import groupby
from math import degrees
from typing import NamedTuple

from matplotlib.axes import Axes

from opir_core.planning import ModeSpan, mode_spans
from opir_core.plugin import CommandRecord, Sensor
from opir_report.canvas import legend_of, panel_width_in, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import MUTED, PAPER, Hue, series_hue
from opir_report.plots.directing import (
    SENSORS_SHOWN,
    SPAN_COLUMNS,
    draw_bars,
    label_rows,
    watched_parts,
)
from opir_report.run_facts import RunFacts

OWN = "own settings"
#: Width of a letter in a bar, and of what stands beside the rows, inches.
_LETTER_IN = 0.068
_BESIDE_IN = 1.4
_COLUMNS = ("sensor_id", "mode", "half_angle_deg", *SPAN_COLUMNS, "looked_s")


def modes_over_time(facts: RunFacts) -> FigureData:
    """Return the spans in which sensors that have modes were in one, or in their own settings,
    followed one track or had one reason: sensor_id, mode, half_angle_deg, track_id, target_id,
    reason, start_s, from_s, until_s, looked_s.

    A sensor changes or turns from `start_s` to `from_s`, and looks so until `until_s`, for
    `looked_s` without its turns and outages; half_angle_deg is that of the field, the reason the first one.
    Nothing for a run in which no command named a mode.
    """
    if not any(record.mode and not record.refusal for record in facts.run.commands):
        return FigureData.of_rows(_COLUMNS, [])
    sensors = [sensor for sensor in facts.run.sensors if sensor.modes]
    return FigureData.of_rows(_COLUMNS, [row for sensor in sensors for row in _rows(facts, sensor)])


class CommandedSpan(NamedTuple):
    """A sensor in a mode, by name, from the command that it follows; None before the first one."""

    span: ModeSpan
    mode: str
    record: CommandRecord | None

    @property
    def track(self) -> int:
        """The track that the sensor follows, -1 for none."""
        return -1 if self.record is None else self.record.track

    @property
    def reason(self) -> str:
        """Why the sensor looks so, "" before the first command."""
        return "" if self.record is None else self.record.reason


def commanded_spans(facts: RunFacts, sensor: Sensor) -> list[CommandedSpan]:
    """Return what a sensor does from the start of the scene to its end, by its commands."""
    commands = facts.run.commands
    records = {
        record.start_s: record
        for record in commands
        if record.sensor == sensor.id and not record.refusal
    }
    modes = {id(in_mode): name for name, in_mode in sensor.modes.items()}
    spans = mode_spans(sensor, commands, facts.plan.scene.duration_s)
    return [
        CommandedSpan(span, modes.get(id(span.sensor), OWN), records.get(span.start_s))
        for span in spans
    ]


def purpose(commanded: CommandedSpan) -> tuple[str, int, str]:
    """Return the mode and the track of a span; without a track the reason too."""
    track = commanded.track
    return commanded.mode, track, "" if track >= 0 else commanded.reason


def _rows(facts: RunFacts, sensor: Sensor) -> Iterator[tuple[object, ...]]:
    """Yield the rows of a sensor."""
    for (mode, track, _), group in groupby(commanded_spans(facts, sensor), purpose):
        merged = list(group)
        begin = merged[0]
        yield (
            sensor.id,
            mode,
            _half_angle_deg(begin.span.sensor),
            track,
            facts.target_ids.get(track, ""),
            begin.reason,
            begin.span.start_s,
            begin.span.from_s,
            merged[-1].span.until_s,
            sum(_watched_s(sensor, commanded.span) for commanded in merged),
        )


def _watched_s(sensor: Sensor, span: ModeSpan) -> float:
    """Return how long a sensor looks in a span."""
    parts = watched_parts(sensor, span.from_s, span.until_s)
    return sum(end_s - begin_s for begin_s, end_s in parts)


def _half_angle_deg(sensor: Sensor) -> float:
    """Return the half angle of the field of a sensor in a mode: its field of regard, if it sees all
    of that.
    """
    if sensor.pointing is None or not sensor.is_narrow:
        return degrees(sensor.field_of_regard_half_angle_rad)
    return degrees(sensor.pointing.half_angle_rad)


def modes_plot(axes: Axes, facts: RunFacts, spans: FigureData) -> Axes:
    """Draw a row for each sensor with modes: a bar of a colour for each mode, with the reason of its
    command where that fits, thin while it changes, and nothing where it is down.
    """
    if not len(spans):
        return without_data(axes, "no command named a mode")
    names = spans.levels("sensor_id")[:SENSORS_SHOWN]
    hues = mode_hues(spans)
    in_per_s = (panel_width_in(axes) - _BESIDE_IN) / facts.plan.scene.duration_s
    sensors = {sensor.id: sensor for sensor in facts.run.sensors}
    for row, name in enumerate(names):
        of_sensor = spans.at("sensor_id", name)
        for mode in of_sensor.levels("mode"):
            draw_bars(axes, row, of_sensor.at("mode", mode), sensors[name], hues[mode].colour)
        for label, middle_s in _labels(of_sensor, sensors[name], in_per_s):
            axes.text(middle_s, -row, label, color=PAPER, fontsize=8, ha="center", va="center")
    omission_count = len(spans.levels("sensor_id")) - len(names)
    omission = f" ({omission_count} more sensors have modes)" if omission_count else ""
    label_rows(axes, facts, names, omission)
    legend_of(axes, list(hues.values()))
    return axes


def mode_hues(spans: FigureData) -> dict[str, Hue]:
    """Return the hue of each mode, by name, the sensors' own settings first."""
    named = [mode for mode in spans.levels("mode") if mode != OWN]
    settings = {OWN: Hue(MUTED, "-", OWN)} if len(named) < len(spans.levels("mode")) else {}
    return settings | {mode: series_hue(number, mode) for number, mode in enumerate(named)}


def _labels(spans: FigureData, sensor: Sensor, in_per_s: float) -> Iterator[tuple[str, float]]:
    """Yield the label of each bar, what it follows and why, or the part that fits into it, and its
    middle, s.
    """
    names = ("target_id", "track_id", "reason", "from_s", "until_s")
    for target, track, reason, from_s, until_s in zip(
        *(spans[name].tolist() for name in names), strict=True
    ):
        followed = target or (f"track {track}" if track >= 0 else "")
        parts = watched_parts(sensor, from_s, until_s)
        begin_s, end_s = max(parts, key=lambda part: part[1] - part[0], default=(from_s, from_s))
        letters = (end_s - begin_s) * in_per_s / _LETTER_IN
        texts = (": ".join(filter(None, (target, reason))), reason, followed)
        label = next((text for text in texts if text and len(text) < letters), "")
        if label:
            yield label, 0.5 * (begin_s + end_s)
