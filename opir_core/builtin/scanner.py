"""Core's plugin of sensor models that are no constellation's: for first scenes and tests; imported
when named.
"""

from collections.abc import Iterable

from opir_core.host.components import SensorModel
from opir_core.host.hookspecs import hookimpl
from opir_core.scene.fields import with_defaults
from opir_core.sensors.pointed_sensor import PointedSensorConfig
from opir_core.sensors.scanning_sensor import ScanningSensorConfig
from opir_core.sensors.sensor_components import scanning_model

#: Notional: some right, some wrong, some unknown.
CONFUSION = {
    "ICBM": {"ICBM": 0.6, "IRBM": 0.2, "SRBM": 0.1, "UNKNOWN": 0.1},
    "IRBM": {"ICBM": 0.2, "IRBM": 0.5, "SRBM": 0.2, "UNKNOWN": 0.1},
    "SRBM": {"ICBM": 0.1, "IRBM": 0.2, "SRBM": 0.5, "UNKNOWN": 0.2},
}


@with_defaults(
    bands={"SWIR": (2.5, 3.0), "MWIR": (4.2, 4.45)},
    scan_period_ms=500.0,
    detection_probability={"ICBM": 0.8, "IRBM": 0.6, "SRBM": 0.4},
    line_of_sight_sigma_urad=20.0,
    confusion=CONFUSION,
)
class ScannerConfig(ScanningSensorConfig):
    """What a scene may set of the sensor model `generic-scanner`."""


@with_defaults(
    bands={"SWIR": (2.5, 3.0), "MWIR": (4.2, 4.45)},
    scan_period_ms=200.0,
    detection_probability={"ICBM": 0.9, "IRBM": 0.8, "SRBM": 0.7},
    line_of_sight_sigma_urad=5.0,
    confusion=CONFUSION,
)
class PointedConfig(PointedSensorConfig):
    """What a scene may set of the sensor model `generic-pointed`."""


@hookimpl
def opir_sensor_models() -> Iterable[SensorModel]:
    """Yield `generic-scanner` and `generic-pointed`."""
    summary = "a plain sensor of no constellation, for first scenes and tests"
    yield scanning_model("generic-scanner", summary, ScannerConfig, label="GENERIC")
    summary = (
        "a plain sensor with a narrow field that a director points, for first scenes and tests"
    )
    yield scanning_model("generic-pointed", summary, PointedConfig, label="GENERIC")
