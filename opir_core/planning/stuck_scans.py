"""Which sensors have a scan that can be stuck."""

from collections.abc import Sequence

from opir_core.errors import Problem, SceneError
from opir_core.interfaces.sensors import Sensor
from opir_core.scene.faults import STUCK, SensorFault


def can_stick(sensor: Sensor) -> bool:
    """Whether the scan of a sensor looks at one place after the other."""
    scan = sensor.scan
    return hasattr(scan, "is_stuck_on") and not getattr(scan, "is_staring", False)


def require_scans_of(faults: Sequence[SensorFault], sensors: Sequence[Sensor]) -> None:
    """Raise `SceneError` for scans that are stuck of sensors that have none and are not pointed."""
    by_id = {sensor.id: sensor for sensor in sensors}
    problems = [
        Problem(
            f"faults[{number}].fault",
            f"{fault.sensor} has no scan that could be stuck: it stares, or its scan_phase is"
            " aligned, so that it looks everywhere at once",
        )
        for number, fault in enumerate(faults)
        if fault.fault == STUCK and (sensor := by_id.get(fault.sensor)) is not None
        if sensor.pointing is None and not can_stick(sensor)
    ]
    if problems:
        raise SceneError(problems)
