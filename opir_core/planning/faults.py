"""The faults of a plan's sensors: what they look at, and by how much their measurements are off."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.errors import Problem, SceneError
from opir_core.interfaces.sensors import Sensor, Spans, spans_without
from opir_core.planning.sensor_states import turned
from opir_core.random_streams.philox import failure_spans_s, stream_key
from opir_core.scene.faults import BIAS, BLIND, CLOCK, DOWN, NOISE, STUCK, SensorFault
from opir_core.scene.scene import Scene

#: The purpose of the streams of faults at random.
STREAM = "fault"
#: The faults in which a sensor takes no command, and why.
_REFUSALS = {DOWN: "it is down", STUCK: "its scan is stuck"}


class SensorFaults(NamedTuple):
    """Faults in the order of the scene, each with its sensor's number."""

    faults: tuple[tuple[int, SensorFault], ...]

    @classmethod
    def of(cls, scene: Scene) -> "SensorFaults":
        """Return the faults of a scene; of each that comes at random the times that its seed draws."""
        ids = [choice.id for choice in scene.sensors]
        return cls(
            tuple(
                (ids.index(fault.sensor), each)
                for number, fault in enumerate(scene.faults)
                for each in _drawn(scene, number, fault)
            )
        )

    def require_scans(self, scene: Scene, sensors: Sequence[Sensor]) -> None:
        """Raise `SceneError` for scans that are stuck of sensors that have none and are not
        pointed.
        """
        by_id = {sensor.id: sensor for sensor in sensors}
        problems = [
            Problem(
                f"faults[{number}].fault",
                f"{fault.sensor} has no scan that could be stuck: it stares, or its scan_phase is"
                " aligned, so that it looks everywhere at once",
            )
            for number, fault in enumerate(scene.faults)
            if fault.fault == STUCK and (sensor := by_id.get(fault.sensor)) is not None
            if sensor.pointing is None and not can_stick(sensor)
        ]
        if problems:
            raise SceneError(problems)

    def watched_s(self, sensor: str, spans: Spans | None, duration_s: float) -> Spans | None:
        """Return the spans in which the sensor of an id looks while it is not down, of those in
        which its scene has it look; None for throughout.
        """
        for _, fault in self.faults:
            if fault.sensor == sensor and fault.fault == DOWN:
                whole = ((0.0, duration_s),) if spans is None else spans
                spans = spans_without(whole, fault.at_s, fault.end_s)
        return spans

    def partial_s(self, sensor: str, duration_s: float) -> Spans:
        """Return the spans in which the scan of the sensor of an id is stuck."""
        spans = tuple(
            (fault.at_s, min(fault.end_s, duration_s))
            for _, fault in self.faults
            if fault.sensor == sensor and fault.fault == STUCK
        )
        return tuple(span for span in spans if span[0] < span[1])

    def refusal(self, number: int, time_s: float) -> str:
        """Return why a sensor, by its number, takes no command at a time, "" if it does."""
        reasons = (
            f"{_REFUSALS[fault.fault]} since {fault.at_s:g} s"
            for sensor, fault in self.faults
            if sensor == number and fault.fault in _REFUSALS and fault.at_s <= time_s < fault.end_s
        )
        return next(reasons, "")

    def stuck(self, sensor: IndexArray, time_s: FloatArray) -> Iterator[tuple[float, IntArray]]:
        """Yield since when scans are stuck, with the rows (n,) of sensors and times of which that
        is.
        """
        for fault, rows in self._in_force(STUCK, sensor, time_s):
            if len(rows):
                yield fault.at_s, rows

    def is_blind(self, sensor: IndexArray, time_s: FloatArray) -> BoolArray:
        """Return which sensors (n,) see nothing at times (n,)."""
        blind = np.zeros(len(time_s), dtype=np.bool_)
        for _, rows in self._in_force(BLIND, sensor, time_s):
            blind[rows] = True
        return blind

    def noise(self, sensor: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return true over stated standard deviations (n,) of sensors (n,) at times (n,)."""
        factor = np.ones(len(time_s))
        for fault, rows in self._in_force(NOISE, sensor, time_s):
            factor[rows] *= fault.factor or 1.0
        return factor

    def clock_s(self, sensor: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return stated minus true times (n,) of sensors (n,) at stated times (n,)."""
        offset_s = np.zeros(len(time_s))
        for fault, rows in self._in_force(CLOCK, sensor, time_s):
            offset_s[rows] += fault.offset_s or 0.0
        return offset_s

    def turned(
        self,
        line_of_sight_ecef: FloatArray,
        sensor: IndexArray,
        sensor_ecef_m: FloatArray,
        time_s: FloatArray,
    ) -> FloatArray:
        """Return lines of sight (n, 3) of sensors (n,) at positions (n, 3) with their biases."""
        measured = line_of_sight_ecef
        for fault, rows in self._in_force(BIAS, sensor, time_s):
            east_rad, north_rad = (
                np.full(len(rows), 1e-6 * (angle_urad or 0.0))
                for angle_urad in (fault.east_urad, fault.north_urad)
            )
            x, y, z = measured[rows].T
            vectors = turned(x, y, z, east_rad, north_rad, sensor_ecef_m[rows])
            measured = measured.copy()
            measured[rows] = np.stack(vectors, axis=1)
        return measured

    def _in_force(
        self, name: str, sensor: IndexArray, time_s: FloatArray
    ) -> Iterator[tuple[SensorFault, IntArray]]:
        """Yield the faults of a name with the rows in which each is in force."""
        for number, fault in self.faults:
            if fault.fault == name:
                is_late = (time_s >= fault.at_s) & (time_s < fault.end_s)
                yield fault, np.flatnonzero((sensor == number) & is_late)


def can_stick(sensor: Sensor) -> bool:
    """Whether the scan of a sensor looks at one place after the other."""
    scan = sensor.scan
    return hasattr(scan, "is_stuck_on") and not getattr(scan, "is_staring", False)


def _drawn(scene: Scene, number: int, fault: SensorFault) -> list[SensorFault]:
    if fault.mtbf_s is None or fault.mttr_s is None:
        return [fault]
    spans_s = failure_spans_s(
        stream_key(scene.seed, fault.sensor, STREAM, str(number)),
        mtbf_s=fault.mtbf_s,
        mttr_s=fault.mttr_s,
        start_s=fault.at_s,
        end_s=min(fault.end_s, scene.duration_s),
    )
    settled = evolve(fault, mtbf_s=None, mttr_s=None)
    return [
        evolve(settled, at_s=start_s, until_s=until_s)
        for start_s, until_s in spans_s.tolist()
        if start_s < until_s
    ]
