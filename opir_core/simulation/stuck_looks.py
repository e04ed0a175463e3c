"""What sensors see whose scan is stuck."""

from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.interfaces.sensors import Sensor
from opir_core.planning.faults import SensorFaults, can_stick
from opir_core.planning.looks import LookGeometry, blocks, look_times_s
from opir_core.planning.plan import Plan
from opir_core.planning.sensor_states import scan_starts
from opir_core.scene.faults import STUCK

if TYPE_CHECKING:
    from opir_core.simulation.pointing import PointedFields


@frozen(eq=False, repr=False)
class StuckScans:
    """The sensors of a plan, each with the start of its scan, and their faults.

    A scan that is stuck sees what it saw when that began: a spin the strip of a resolution cell, a
    step-stare one stare, in the frame of the satellite. A narrow field stays where it is pointed;
    where it scans, one stare about its axis is left of it.
    """

    sensors: tuple[Sensor, ...]
    starts: list[float]
    geometry: LookGeometry
    faults: SensorFaults
    fields: "PointedFields | None"

    def is_looking(self, pair: IntArray, scan: IntArray) -> BoolArray:
        """Return which looks (n,) are made in spite of a stuck scan."""
        pairs = self.geometry.pairs
        time_s = look_times_s(pairs, pair, scan)
        sensor = pairs.sensor[pair]
        is_made = np.ones(len(pair), dtype=np.bool_)
        for _, stuck in self.faults.stuck(sensor, time_s):
            for block in blocks(len(stuck)):
                rows = stuck[block]
                exposed = self.geometry.exposures(pair[rows], scan[rows])
                places = exposed.sensor_ecef_m, exposed.target_ecef_m
                is_made[rows] &= self.is_seen(sensor[rows], *places, time_s[rows])
        return is_made

    def is_seen(
        self,
        sensor: IndexArray,
        sensor_ecef_m: FloatArray,
        point_ecef_m: FloatArray,
        time_s: FloatArray,
    ) -> BoolArray:
        """Return which points (n, 3) sensors (n,) at positions (n, 3) see at times (n,), as far as
        their scans are stuck.
        """
        is_seen = np.ones(len(time_s), dtype=np.bool_)
        for since_s, stuck in self.faults.stuck(sensor, time_s):
            for number in np.unique(sensor[stuck]).tolist():
                rows = stuck[sensor[stuck] == number]
                places = sensor_ecef_m[rows], point_ecef_m[rows]
                is_seen[rows] &= self._is_left(number, since_s, *places, time_s[rows])
        return is_seen

    def _is_left(
        self,
        number: int,
        since_s: float,
        sensor_ecef_m: FloatArray,
        point_ecef_m: FloatArray,
        time_s: FloatArray,
    ) -> BoolArray:
        """Return which points a sensor, by its number, sees whose scan is stuck since a time."""
        sensor = self.sensors[number]
        scan: Any = sensor.scan
        if not can_stick(sensor) or (sensor.is_narrow and self.fields is None):
            return np.ones(len(time_s), dtype=np.bool_)
        if sensor.is_narrow and self.fields is not None:
            most_rad = getattr(scan, "stare_half_angle_rad", np.pi)
            return self.fields.is_inside(number, sensor_ecef_m, point_ecef_m, time_s, most_rad)
        turn = (since_s * 1e9 / scan.period_ns - self.starts[number]) % 1.0
        width_rad = 0.0 if sensor.radiometer is None else sensor.radiometer.ifov_rad
        seen: BoolArray = scan.is_stuck_on(sensor_ecef_m, point_ecef_m, turn, width_rad)
        return seen


def stuck_scans(plan: Plan, fields: "PointedFields | None") -> StuckScans | None:
    """Return the scans of a plan's sensors that are stuck at times; None without any."""
    faults = plan.faults
    if faults is None or not any(fault.fault == STUCK for _, fault in faults.faults):
        return None
    starts = scan_starts(plan.scene.seed, plan.sensors)
    return StuckScans(plan.sensors, starts, plan.look_geometry(), faults, fields)
