"""Modes of sensors: in the plan by which looks are made, each mode is a sensor of its own, which
looks while it is in force.
"""

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import IndexArray
from opir_core.host.boundary import PluginErrors
from opir_core.interfaces.sensors import Sensor
from opir_core.planning.faults import SensorFaults
from opir_core.planning.plan import Plan, models_of
from opir_core.planning.sensor_states import PointingBias


@frozen(eq=False)
class SensorModes:
    """The modes of a plan's sensors: `plan` has the sensors with their own settings, in their
    order, and after them one for each mode.

    `sensor` (m,) are the numbers of the sensors that they are modes of, `names` those of the modes,
    "" for a sensor's own settings.
    """

    plan: Plan
    sensor: IndexArray
    names: tuple[str, ...]

    @classmethod
    def of(cls, plan: Plan) -> "SensorModes":
        """Return the modes of a plan's sensors, with models and looks of their own.

        Raises `SceneError` for more work than the scene's limits accept.
        """
        rows = [(number, "", sensor) for number, sensor in enumerate(plan.sensors)]
        rows += [
            (number, name, evolve(in_mode, watched_s=sensor.watched_s, orbit=sensor.orbit))
            for number, sensor in enumerate(plan.sensors)
            for name, in_mode in sensor.modes.items()
        ]
        numbers, names, sensors = zip(*rows, strict=True)
        sensor = np.array(numbers, dtype=np.int32)
        bias = plan.bias
        if bias is not None:
            bias = PointingBias(bias.east_rad[sensor], bias.north_rad[sensor])
        generations = plan.scan_generations and [plan.scan_generations[row] for row in numbers]
        changed = evolve(
            plan,
            bias=bias,
            faults=None if plan.faults is None else _of_modes(plan.faults, sensor),
            scan_generations=tuple(generations),
        )
        return cls(_with_sensors(changed, sensors), sensor, names)


def _with_sensors(plan: Plan, sensors: tuple[Sensor, ...]) -> Plan:
    """Return a plan with other sensors: models, pairs and lines of sight are built for them."""
    with PluginErrors(plan.host, plan.scene):
        models = models_of(plan.scene, plan.host, sensors, plan.targets, plan.sources)
        detection, classifier, confidence = models
        changed = evolve(plan, sensors=sensors, detection=detection, classifier=classifier)
        exclusions = changed.solar_exclusions()
        pairs, sightlines = changed.pair_compiler(exclusions).compiled()
    changed = evolve(changed, confidence=confidence, pairs=pairs, sightlines=sightlines)
    changed = evolve(changed, exclusions=exclusions, kept={})
    changed.workload.require_run()
    return changed


def _of_modes(faults: SensorFaults, sensor: IndexArray) -> SensorFaults:
    """Return the faults of sensors (m,) as those of all their modes."""
    return SensorFaults(
        tuple(
            (row, fault)
            for number, fault in faults.faults
            for row in np.flatnonzero(sensor == number).tolist()
        )
    )
