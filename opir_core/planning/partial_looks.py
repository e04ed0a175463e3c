"""When sensors look at a part of their field of regard alone: then their silence says nothing."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from attrs import evolve

from opir_core.interfaces.records import CommandRecord
from opir_core.interfaces.sensors import Sensor, Spans


def stated_sensors(
    sensors: Iterable[Sensor], commands: Sequence[CommandRecord], end_s: float
) -> tuple[Sensor, ...]:
    """Return sensors with the spans in which they look at their whole field of regard, by the
    commands of a `SteeringCommands`, of a scene that ends at a time.

    A sensor that is narrow in its own settings keeps its spans.
    """
    return tuple(
        evolve(
            sensor, partial_s=(*sensor.partial_s, *partial_spans(sensor, commands, end_s))
        ).stated(end_s)
        if is_steered(sensor)
        else sensor.stated(end_s)
        for sensor in sensors
    )


class SteeringCommands:
    """What became of the commands that decide when sensors look at their whole field of regard."""

    def __init__(self, sensors: Iterable[Sensor]) -> None:
        self.commands: list[CommandRecord] = []
        #: By sensor the start of its latest command, s, and the mode.
        self._latest = {sensor.id: (-1.0, "") for sensor in sensors if is_steered(sensor)}

    def take(self, commands: Iterable[CommandRecord]) -> bool:
        """Take what became of commands; return whether any of them turns a sensor or changes its
        mode.
        """
        count = len(self.commands)
        self.commands += [
            record._replace(mode=self._latest[record.sensor][1])
            for record in commands
            if self._matters(record)
        ]
        return len(self.commands) > count

    def forget(self, before_s: float) -> None:
        """Forget what no longer matters from a time on: of each sensor all but its latest command
        before that.
        """
        latest = {record.sensor: record for record in self.commands if record.start_s <= before_s}
        self.commands = [
            record
            for record in self.commands
            if record.start_s > before_s or record is latest[record.sensor]
        ]

    def _matters(self, record: CommandRecord) -> bool:
        if record.sensor not in self._latest or record.refusal or not record.start_s >= 0.0:
            return False
        start_s, mode = self._latest[record.sensor]
        self._latest[record.sensor] = record.start_s, record.mode or mode
        is_later = record.start_s > start_s and record.mode in ("", mode)
        return not is_later or record.from_s > record.start_s


def is_steered(sensor: Sensor) -> bool:
    """Whether commands decide if a sensor looks at its whole field of regard."""
    return bool(sensor.modes) and not sensor.is_narrow


class ModeSpan(NamedTuple):
    """A sensor as it is in a mode that is in force from `start_s` to `until_s`; it looks from
    `from_s` on.
    """

    sensor: Sensor
    start_s: float
    from_s: float
    until_s: float


def mode_spans(
    sensor: Sensor, commands: Iterable[CommandRecord], end_s: float
) -> Sequence[ModeSpan]:
    """Return the modes of a sensor from the start of a scene to its end, by what became of
    commands.
    """
    mode = ""
    spans = [ModeSpan(sensor, 0.0, 0.0, end_s)]
    for record in commands:
        # A sensor that goes back to the director is not turned: its start is nan.
        if record.sensor == sensor.id and not record.refusal and record.start_s >= 0.0:
            mode = record.mode or mode
            start_s = min(record.start_s, end_s)
            # A turn that has not begun is dropped.
            while len(spans) > 1 and spans[-1].start_s >= record.start_s:
                spans.pop()
            spans[-1] = spans[-1]._replace(until_s=start_s)
            in_mode = sensor.modes.get(mode, sensor)
            spans.append(ModeSpan(in_mode, start_s, min(record.from_s, end_s), end_s))
    return spans


def partial_spans(sensor: Sensor, commands: Iterable[CommandRecord], end_s: float) -> Spans:
    """Return the spans in which a sensor turns, or has a mode whose field does not hold its whole
    field of regard.
    """
    spans = (
        (span.start_s, span.until_s if span.sensor.is_narrow else min(span.from_s, span.until_s))
        for span in mode_spans(sensor, commands, end_s)
    )
    return tuple(span for span in spans if span[0] < span[1])
