"""What a live run tells of itself while it runs."""

import numpy as np
from attrs import define, field, frozen

from opir_core.arrays import IntArray
from opir_core.live.outlets import OutletStatus
from opir_core.plan import Plan
from opir_core.records import Window

#: Upper edges of the classes in which late cycles are counted, s; the last class has all that are later.
LATE_EDGES_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5)


@frozen(eq=False)
class LiveWindow:
    """A window of a live run: as sinks get it, with the cycle it ended, its lap, and the plan it came from."""

    window: Window
    cycle: int
    lap: int
    plan: Plan


@frozen
class SensorStatus:
    """What a sensor has done; times are of the scene."""

    id: str
    type: str
    detections: int
    last_detection_s: float | None


@frozen
class LiveStatus:
    """A live run at a moment. States: starting, running, ended, stopped, failed."""

    state: str
    error: str | None
    time_ns: int
    cycle: int
    lap: int
    speed: float | None
    late_s: float
    latest_s: float
    late_cycles: int
    late_counts: tuple[int, ...]
    late_total_s: float
    looks: int
    detections: int
    targets: int
    targets_launched: int
    sensors: tuple[SensorStatus, ...]
    sinks: tuple[OutletStatus, ...]


@define(eq=False)
class Counts:
    """What has happened so far; written by the run's thread alone."""

    detections_by_sensor: IntArray
    last_ns: IntArray
    time_ns: int = 0
    cycle: int = 0
    looks: int = 0
    detections: int = 0
    late_s: float = 0.0
    latest_s: float = 0.0
    late_total_s: float = 0.0
    late_cycles: int = 0
    late_counts: list[int] = field(factory=lambda: [0] * (len(LATE_EDGES_S) + 1))

    @classmethod
    def of(cls, sensors: int) -> "Counts":
        """Return counts of nothing yet."""
        return cls(np.zeros(sensors, dtype=np.int64), np.full(sensors, -1, dtype=np.int64))

    def take(self, window: Window) -> None:
        """Count a window's looks and detections."""
        found = window.detections
        self.looks += window.looks
        self.detections += len(found)
        self.detections_by_sensor += np.bincount(found.sensor, minlength=len(self.last_ns))
        self.last_ns[found.sensor] = found.time_ns

    def ended(self, time_ns: int, late_s: float, allowed_s: float) -> None:
        """Count a cycle that came up to `time_ns`, and how late it was done; `allowed_s` is how late it may be."""
        self.time_ns = time_ns
        self.cycle += 1
        self.late_s = max(late_s, 0.0)
        self.latest_s = max(self.latest_s, self.late_s)
        self.late_total_s += self.late_s
        self.late_cycles += late_s > allowed_s
        self.late_counts[int(np.searchsorted(LATE_EDGES_S, self.late_s))] += 1

    def sensors(self, plan: Plan) -> tuple[SensorStatus, ...]:
        """Return what each sensor has done."""
        rows = zip(plan.sensors, self.detections_by_sensor.tolist(), self.last_ns.tolist(), strict=True)
        return tuple(
            SensorStatus(sensor.id, sensor.type, count, last * 1e-9 if last >= 0 else None)
            for sensor, count, last in rows
        )
