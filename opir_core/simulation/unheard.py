"""Looks of which a tracker in the order of report hears too late: their silence says nothing."""

import numpy as np
from attrs import evolve

from opir_core.arrays import IntArray
from opir_core.interfaces.sensors import Sensor
from opir_core.planning.plan import Plan


class UnheardLooks:
    """The spans of looks whose reports are not there when the tracker goes on, by sensor: those that
    wait for a contact, and those of reports that are on their way, in a queue or late otherwise.
    """

    def __init__(self, plan: Plan, wait_s: float) -> None:
        self._wait_s = wait_s
        self._late_s: list[list[tuple[float, float]]] = [[] for _ in plan.sensors]
        self.use(plan)

    def use(self, plan: Plan) -> None:
        """Go on with a plan of the same sensors."""
        self._plan = plan

    def tracker_sensors(self) -> tuple[Sensor, ...]:
        """Return the sensors as trackers know them, with the spans in which they are heard."""
        links = self._plan.links
        sensors = (
            evolve(
                sensor,
                partial_s=(
                    *sensor.partial_s,
                    *(() if links is None else links.lost_s(number, self._wait_s)),
                    *late_s,
                ),
            )
            for number, (sensor, late_s) in enumerate(
                zip(self._plan.sensors, self._late_s, strict=True)
            )
        )
        return evolve(self._plan, sensors=tuple(sensors)).tracker_sensors()

    def miss(self, sensor: IntArray, time_ns: IntArray, stepped_ns: int, tick_ns: int) -> bool:
        """Take the looks (n,) between two ticks whose reports have not come by the step of the
        second; return whether there are any.

        A sensor is not heard from the first of them on, or since it was heard last.
        """
        for number in np.unique(sensor).tolist():
            late_s = self._late_s[number]
            from_ns = int(time_ns[sensor == number].min())
            if late_s and late_s[-1][1] == stepped_ns * 1e-9:
                late_s[-1] = (late_s[-1][0], tick_ns * 1e-9)
            else:
                late_s.append((from_ns * 1e-9, tick_ns * 1e-9))
        return len(sensor) > 0
