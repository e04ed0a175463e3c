"""Stage of the engine, of scenes whose sensors have modes: detections are those of the sensors."""

import numpy as np
from attrs import frozen

from opir_core.planning.looks import blocks, look_times_s
from opir_core.planning.sensor_modes import SensorModes
from opir_core.simulation.observation import Observation
from opir_core.simulation.pointing import PointedFields


@frozen(eq=False, repr=False)
class MergeModes:
    """Takes `looks`, `detections` and `truth`; gives the last two by time, then sensor, whichever
    its mode, and `made`, the number of looks in the modes in force.
    """

    modes: SensorModes
    fields: PointedFields

    def __call__(self, window: Observation) -> None:
        """Give the detections of each mode to its sensor."""
        detections = window.detections
        sensor = self.modes.sensor[detections.sensor]
        order = np.lexsort((sensor, detections.time_ns))
        window.detections = detections.replaced(sensor=sensor).take(order)
        window.truth = window.truth.take(order)
        window.made = sum(self._made(window, rows) for rows in blocks(len(window.looks.pair)))

    def _made(self, window: Observation, rows: slice) -> int:
        """Return how many looks of some rows are of modes in force."""
        pairs = self.modes.plan.pairs
        pair = window.looks.pair[rows]
        sensor = pairs.sensor[pair]
        time_s = look_times_s(pairs, pair, window.looks.scan[rows])
        made = np.ones(len(pair), dtype=np.bool_)
        for number in self.fields.sensors:
            of_sensor = np.flatnonzero(sensor == number)
            made[of_sensor] = self.fields.is_in_mode(number, time_s[of_sensor])
        return int(np.count_nonzero(made))
