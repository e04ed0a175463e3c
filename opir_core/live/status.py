"""State and counts of a live run."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import define, field, frozen

from opir_core.arrays import IntArray
from opir_core.interfaces.records import Window
from opir_core.interfaces.sensor_health import SensorHealth
from opir_core.output.sink_thread import SinkStatus
from opir_core.planning.plan import Plan

if TYPE_CHECKING:
    from opir_core.simulation.pointing import NarrowField

#: Upper edges, s, of the histogram of lateness; a last bin has all later cycles.
LATE_EDGES_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5)


@frozen
class SensorStatus:
    """Detections of a sensor; the last one's scene time is None before the first.

    `health` is what the tracker has found of it, as plain values, or None; `field` is where its
    narrow field is, None for a sensor without one.
    """

    id: str
    type: str
    detections: int
    last_detection_s: float | None
    health: Mapping[str, Any] | None = None
    field: "NarrowField | None" = None


@frozen
class LiveStatus:
    """State and counts of a live run. States: starting, running, ended, stopped, failed.

    `tracker_error` is why the tracker has ended, if the run goes on without it. `targets` are
    launches to come or still looked at, `targets_launched` those of the scene, lap by lap, and
    those accepted since; hot sources are neither.
    """

    state: str
    error: str | None
    tracker_error: str | None
    time_ns: int
    cycle: int
    lap: int
    speed: float | None
    late_s: float
    latest_s: float
    late_cycles: int
    late_counts: tuple[int, ...]
    late_total_s: float
    cycle_age_s: float
    looks: int
    detections: int
    targets: int
    targets_launched: int
    sensors: tuple[SensorStatus, ...]
    sinks: tuple[SinkStatus, ...]


@define(eq=False)
class Counts:
    """Counts of a live run; only the run's thread changes them."""

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
    health: SensorHealth | None = None
    late_counts: list[int] = field(factory=lambda: [0] * (len(LATE_EDGES_S) + 1))

    @classmethod
    def of(cls, sensors: int) -> "Counts":
        """Return zero counts for a number of sensors."""
        return cls(np.zeros(sensors, dtype=np.int64), np.full(sensors, -1, dtype=np.int64))

    def take(self, window: Window) -> None:
        """Count a window's looks and detections."""
        detections = window.detections
        self.looks += window.looks
        self.health = window.health or self.health
        self.detections += len(detections)
        self.detections_by_sensor += np.bincount(detections.sensor, minlength=len(self.last_ns))
        np.maximum.at(self.last_ns, detections.sensor, detections.time_ns)

    def ended(self, time_ns: int, late_s: float, allowed_s: float) -> None:
        """Count a cycle up to scene time `time_ns` and its lateness; over `allowed_s` it missed its
        deadline.
        """
        self.time_ns = time_ns
        self.cycle += 1
        self.late_s = max(late_s, 0.0)
        self.latest_s = max(self.latest_s, self.late_s)
        self.late_total_s += self.late_s
        self.late_cycles += late_s > allowed_s
        self.late_counts[int(np.searchsorted(LATE_EDGES_S, self.late_s))] += 1

    def sensors(self, plan: Plan, fields: Mapping[int, "NarrowField"]) -> tuple[SensorStatus, ...]:
        """Return the status of each sensor; `fields` are narrow fields by the sensors' numbers."""
        health = self.health.documents() if self.health else [None] * len(plan.sensors)
        rows = zip(
            plan.sensors,
            self.detections_by_sensor.tolist(),
            self.last_ns.tolist(),
            health,
            strict=True,
        )
        return tuple(
            SensorStatus(
                id=sensor.id,
                type=sensor.type,
                detections=detections,
                last_detection_s=last_ns * 1e-9 if last_ns >= 0 else None,
                health=report,
                field=fields.get(number),
            )
            for number, (sensor, detections, last_ns, report) in enumerate(rows)
        )
