"""The faults of a plan's sensors: what they look at, and by how much their measurements are off."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.interfaces.sensors import Sensor, Spans
from opir_core.planning.sensor_states import turned
from opir_core.random_streams.philox import failure_spans_s, stream_key
from opir_core.scene.faults import BIAS, BLIND, CLOCK, DOWN, NOISE, SensorFault
from opir_core.scene.scene import Scene

#: The purpose of the streams of faults at random.
STREAM = "fault"


class SensorFaults(NamedTuple):
    """Faults in the order of the scene, each with its sensor's number."""

    faults: tuple[tuple[int, SensorFault], ...]

    @classmethod
    def of(cls, faults: Iterable[SensorFault], ids: Sequence[str]) -> "SensorFaults | None":
        """Return the faults of sensors by their ids; None without any."""
        numbered = tuple((ids.index(fault.sensor), fault) for fault in faults)
        return cls(numbered) if numbered else None

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


def drawn_faults(scene: Scene) -> tuple[SensorFault, ...]:
    """Return the faults of a scene; of each that comes at random the times that its seed draws."""
    return tuple(
        each for number, fault in enumerate(scene.faults) for each in _drawn(scene, number, fault)
    )


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


def watching(sensor: Sensor, scene: Scene, faults: Iterable[SensorFault]) -> Sensor:
    """Return a sensor with the spans in which it looks by its scene, where it does not throughout."""
    watched_s = scene.watched_s.get(sensor.id, sensor.watched_s)
    for fault in faults:
        if fault.sensor == sensor.id and fault.fault == DOWN:
            before_s = ((0.0, scene.duration_s),) if watched_s is None else watched_s
            watched_s = _without(before_s, fault)
    return sensor if watched_s is None else evolve(sensor, watched_s=watched_s)


def _without(spans: Spans, fault: SensorFault) -> Spans:
    """Return spans without the time of a fault."""
    pieces = [
        piece
        for start_s, end_s in spans
        for piece in ((start_s, min(end_s, fault.at_s)), (max(start_s, fault.end_s), end_s))
    ]
    return tuple((start_s, end_s) for start_s, end_s in pieces if start_s < end_s)
