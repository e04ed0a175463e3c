"""The `HEO` sensor model, a two-band scanner in a highly elliptical orbit, and two notional fleets."""

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import Any

from opir_core.plugin import (
    Constellation,
    ScanningSensorConfig,
    SensorModel,
    cited,
    hookimpl,
    scanning_sensor,
    with_defaults,
)

#: Notional: every apogee of the Molniya-class fleet is over this longitude or half a turn of the Earth away.
NOTIONAL_APOGEE_LON_DEG = -90.0

#: Half and whole rotations of the Earth, s: the periods of Molniya and of Tundra orbits, 2 pi / 7.292115e-5 rad/s each
#: day (WGS 84).
DAY_S = 86164.1

#: Moderate classification: two bands tell the shorter, cooler burns from the long ones most of the time.
NOTIONAL_CONFUSION = {
    "ICBM": {"ICBM": 0.82, "IRBM": 0.1, "SRBM": 0.02, "UNKNOWN": 0.06},
    "IRBM": {"ICBM": 0.1, "IRBM": 0.78, "SRBM": 0.06, "UNKNOWN": 0.06},
    "SRBM": {"ICBM": 0.02, "IRBM": 0.08, "SRBM": 0.82, "UNKNOWN": 0.08},
}


@with_defaults(
    bands={"SWIR": (2.5, 3.0), "MWIR": (4.0, 5.0)},
    scan_pattern="step-stare",
    scan_period_ms=500.0,
    detection_probability={"ICBM": 0.75, "IRBM": 0.7, "SRBM": 0.55},
    field_of_regard_half_angle_deg=cited(
        12.0, "notional: it holds the Earth's disk from 24 300 km up, asin(6378.137 / 30677) = 12.0 deg"
    ),
    line_of_sight_sigma_urad=25.0,
    false_alarm_susceptibility="moderate",
    nei_w_m2=1e-12,
    spectral_discrimination="dual-band-ratio",
    plausible_ratios={"MWIR": (0.8, 4.0)},
    confusion=NOTIONAL_CONFUSION,
)
class HeoConfig(ScanningSensorConfig):
    """What a scene may set of an HEO sensor."""


@hookimpl
def opir_sensor_models() -> Iterable[SensorModel]:
    """Yield the sensor model `HEO`."""
    yield SensorModel(
        name="HEO",
        summary="step-stare scanner of two bands in a highly elliptical orbit",
        config=HeoConfig,
        build=partial(scanning_sensor, type="HEO"),
    )


@hookimpl
def opir_constellations() -> Iterable[Constellation]:
    """Yield the constellations `HEO-MOLNIYA` and `HEO-TUNDRA`."""
    yield Constellation(
        name="HEO-MOLNIYA",
        summary="three HEO satellites that take turns about the apogee of one Molniya-class ground track; notional",
        model="HEO",
        satellites=list(_fleet("molniya", NOTIONAL_APOGEE_LON_DEG, DAY_S / 2.0, count=3)),
    )
    yield Constellation(
        name="HEO-TUNDRA",
        summary="two HEO satellites that take turns about the apogee of one Tundra-class ground track; notional",
        model="HEO",
        satellites=list(_fleet("tundra", NOTIONAL_APOGEE_LON_DEG, DAY_S, count=2)),
    )


def _fleet(kind: str, apogee_lon_deg: float, period_s: float, *, count: int) -> Iterator[Mapping[str, Any]]:
    """Yield satellites that pass the apogee of one ground track one after another, evenly spread over a period."""
    for number in range(count):
        apogee = {"apogee_lon_deg": apogee_lon_deg, "apogee_time_s": round(number * period_s / count, 1)}
        yield {"id": f"HEO-{kind.upper()}-{number + 1}", "orbit": {kind: apogee}}
