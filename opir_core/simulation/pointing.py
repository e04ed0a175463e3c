"""Where the narrow fields of sensors are pointed, from time to time, and what is inside of them."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from attrs import evolve, frozen
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.geometry import dot
from opir_core.geometry.vectors import angle_between_rad
from opir_core.interfaces.directors import Command
from opir_core.interfaces.sensors import Pointing, Sensor
from opir_core.planning.keep_out import KeepOut

if TYPE_CHECKING:
    from opir_core.planning.plan import Plan
    from opir_core.planning.sensor_modes import SensorModes

_NOWHERE = np.full(3, np.nan)


@frozen(eq=False)
class FieldAim:
    """A direction of a sensor and its mode: the turn to it begins at `start_s`, looks in it at
    `from_s`.

    The point at `position_ecef_m` (3,) at `time_s` moves evenly; nan is nadir.
    """

    start_s: float
    from_s: float
    time_s: float
    position_ecef_m: FloatArray
    velocity_m_s: FloatArray
    mode: str = ""
    track: int = -1
    reason: str = ""

    def position_at(self, time_s: ArrayLike) -> FloatArray:
        """Return the point (n, 3) at times (n,), ECEF, m."""
        since_s = np.subtract(time_s, self.time_s)[:, None]
        return self.position_ecef_m + self.velocity_m_s * since_s

    def point_in_axis(self, time_s: float) -> tuple[float, ...]:
        """Return a point in the axis of the field at a time, ECEF, m; at nadir the Earth's centre."""
        return tuple(np.nan_to_num(self.position_at([time_s]))[0].tolist())

    def direction(self, sensor_ecef_m: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return directions (n, 3) from positions of the sensor (n, 3) at times (n,), not of unit
        length.
        """
        if np.isnan(self.position_ecef_m[0]):
            return -sensor_ecef_m
        return self.position_at(time_s) - sensor_ecef_m


@frozen(eq=False)
class NarrowField:
    """Where the narrow field of a sensor is at a time.

    `aim` is the last one begun, `position_ecef_m` (3,) its point at that time, nan for nadir.
    `is_tasked` says whether an operator has the sensor; `refusal` is why it did not take the last
    command, "" if it did.
    """

    half_angle_rad: float
    aim: FieldAim
    position_ecef_m: FloatArray
    is_tasked: bool = False
    refusal: str = ""


class PointedFields:
    """The aims of a run's sensors with a narrow field, in order of time, by the sensors' numbers.

    `sensors` are those with a narrow field, by number, each mode as a sensor of its own.
    """

    def __init__(self, plan: "Plan", modes: "SensorModes | None" = None) -> None:
        sensors = plan.sensors if modes is None else modes.plan.sensors
        self.sensors = {
            number: sensor for number, sensor in enumerate(sensors) if sensor.pointing is not None
        }
        #: All looks before this time of the scene have been made, s.
        self.observed_s = 0.0
        #: By number of a sensor in a mode that of the sensor, and the mode.
        self._modes = {
            number: (number, "")
            if modes is None
            else (int(modes.sensor[number]), modes.names[number])
            for number in self.sensors
        }
        self._keep_outs = {
            number: KeepOut.of(_pointing(sensor), plan.scene.epoch_us)
            for number, sensor in self.sensors.items()
        }
        self._aims = {
            number: [_standing_aim(_pointing(self.sensors[number]))]
            for number, mode in self._modes.values()
            if not mode
        }

    def take_over(self, former: "PointedFields") -> None:
        """Go on with the aims of a run of the same sensors, in their modes as far as they have them."""
        for number, aims in former._aims.items():
            modes = self.sensors[number].modes
            self._aims[number] = [
                evolve(aim, mode=aim.mode if aim.mode in modes else "") for aim in aims
            ]

    def point(self, number: int, command: Command, time_s: float) -> FieldAim:
        """Point a sensor; return the aim, with the times at which it leaves the former and reaches
        this one.

        A command whose turn has not begun is dropped, but for what this one leaves open: direction
        or mode. One whose turn goes on is finished first. A change of mode settles as a turn does,
        at the rate of the mode to come.
        """
        sensor = self.sensors[number]
        ready_s = time_s + _pointing(sensor).delay_s
        *_, latest = self._aims[number]
        aims = [aim for aim in self._aims[number] if aim.start_s < ready_s]
        start_s = max(ready_s, aims[-1].from_s)
        aim = _commanded(command, latest, start_s, time_s)
        pointing = _pointing(sensor.modes.get(aim.mode, sensor))
        at_s = np.array([start_s])
        at_m = sensor.orbit.position_ecef_m(at_s)
        former, wanted = (each.direction(at_m, at_s) for each in (aims[-1], aim))
        angle_rad = float(angle_between_rad(former, wanted)[0])
        if angle_rad > pointing.half_angle_rad or aim.mode != aims[-1].mode:
            turn_s = angle_rad / pointing.slew_rad_s + pointing.settle_s
            aim = evolve(aim, from_s=start_s + turn_s)
        # What ended before the looks to come is asked of no more.
        asked_s = min(time_s, self.observed_s)
        ends_s = [*(later.start_s for later in aims[1:]), start_s]
        recent = [each for each, end_s in zip(aims, ends_s, strict=True) if end_s >= asked_s]
        self._aims[number] = [*recent, aim]
        return aim

    @property
    def numbers(self) -> tuple[int, ...]:
        """The sensors' numbers."""
        return tuple(self._aims)

    def field_at(self, number: int, time_s: float) -> NarrowField:
        """Return where the field of a sensor, by its number, is at a time."""
        aims = self._aims[number]
        begun = [aim for aim in aims if aim.start_s <= time_s]
        aim = begun[-1] if begun else aims[0]
        sensor = self.sensors[number]
        half_angle_rad = _pointing(sensor.modes.get(aim.mode, sensor)).half_angle_rad
        return NarrowField(half_angle_rad, aim, aim.position_at([time_s])[0])

    def keep_out(self, number: int) -> KeepOut | None:
        """Return where a sensor must not look, None without a limit."""
        return self._keep_outs[number]

    def is_inside(
        self,
        number: int,
        sensor_ecef_m: FloatArray,
        point_ecef_m: FloatArray,
        time_s: FloatArray,
        most_rad: float = np.pi,
    ) -> BoolArray:
        """Return which points (n, 3) a sensor in a mode, by its number, has in its field at
        positions (n, 3) and times (n,), while that mode is in force and it may look there.

        Of the field counts what is at most `most_rad` from its axis.
        """
        least_cosine = np.cos(min(_pointing(self.sensors[number]).half_angle_rad, most_rad))
        keep_out = self._keep_outs[number]
        inside = np.zeros(len(time_s), dtype=np.bool_)
        for aim, rows in self._in_force(number, time_s):
            sensor_m = sensor_ecef_m[rows]
            wanted = aim.direction(sensor_m, time_s[rows])
            seen = point_ecef_m[rows] - sensor_m
            lengths = np.sqrt(dot(wanted, wanted) * dot(seen, seen))
            inside[rows] = dot(wanted, seen) >= least_cosine * lengths
            if keep_out is not None:
                inside[rows] &= keep_out.is_clear(sensor_m, sensor_m + wanted, time_s[rows])
        return inside

    def idle(self, start_ns: int, end_ns: int) -> list[int]:
        """Return the sensors in modes, by number, whose mode is never in force in a window."""
        start_s = start_ns * 1e-9
        end_s = end_ns * 1e-9
        return [
            number
            for number, (sensor, mode) in self._modes.items()
            if not any(
                aim.mode == mode and aim.start_s <= end_s and until_s >= start_s
                for aim, until_s in self._until_s(sensor)
            )
        ]

    def is_in_mode(self, number: int, time_s: FloatArray) -> BoolArray:
        """Return at which times (n,) the mode of a sensor, by its number, is the last one begun."""
        sensor, mode = self._modes[number]
        aims = self._aims[sensor]
        begun = np.searchsorted([aim.start_s for aim in aims], time_s, side="right") - 1
        return np.array([aim.mode == mode for aim in aims], dtype=np.bool_)[np.maximum(begun, 0)]

    def _in_force(self, number: int, time_s: FloatArray) -> Iterator[tuple[FieldAim, IntArray]]:
        """Yield the aims of a sensor in a mode with the rows of the times (n,) at which it looks
        there.
        """
        sensor, mode = self._modes[number]
        for aim, end_s in self._until_s(sensor):
            rows = np.flatnonzero((time_s >= aim.from_s) & (time_s < end_s))
            if len(rows) and aim.mode == mode:
                yield aim, rows

    def _until_s(self, sensor: int) -> Iterator[tuple[FieldAim, float]]:
        """Return the aims of a sensor with the times at which it leaves them."""
        aims = self._aims[sensor]
        return zip(aims, [*(later.start_s for later in aims[1:]), np.inf], strict=True)


def _commanded(command: Command, former: FieldAim, start_s: float, time_s: float) -> FieldAim:
    """Return the aim of a command after a former one; its turn takes no time yet."""
    mode = command.mode or former.mode
    aim = evolve(former, start_s=start_s, from_s=start_s, mode=mode, reason=command.reason)
    if command.position_ecef_m is None:
        return aim
    return evolve(
        aim,
        time_s=time_s,
        position_ecef_m=command.position_ecef_m,
        velocity_m_s=command.velocity_m_s,
        track=command.track,
    )


def _pointing(sensor: Sensor) -> Pointing:
    assert sensor.pointing is not None
    return sensor.pointing


def _standing_aim(pointing: Pointing) -> FieldAim:
    """Return the aim of a sensor without a command."""
    place = _NOWHERE if pointing.at_ecef_m is None else np.array(pointing.at_ecef_m)
    return FieldAim(-np.inf, -np.inf, 0.0, place, np.zeros(3))
