"""The sensor model `HEO`, a two-band scanner in a highly elliptical orbit, and two notional
fleets.
"""

from collections.abc import Iterable

from opir_core.plugin import (
    Constellation,
    ScanningSensorConfig,
    SensorModel,
    cited,
    hookimpl,
    scanning_model,
    with_defaults,
)

#: Notional: every apogee of the Molniya-class fleet is at this east longitude or at the opposite
#: one, 180 deg away.
NOTIONAL_APOGEE_LON_DEG = -90.0

#: Half and whole rotations of the Earth, s: the periods of Molniya and of Tundra orbits, 2 pi /
#: 7.292115e-5 rad/s each day (WGS 84).
DAY_S = 86164.1

#: Moderate classification: two bands mostly separate short, cool burns from long ones.
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
        12.0,
        "notional: it holds the Earth's disk from 24 300 km up, asin(6378.137 / 30677) = 12.0 deg",
    ),
    line_of_sight_sigma_urad=25.0,
    false_alarm_susceptibility="moderate",
    spectral_discrimination="likelihood",
    threshold_sigma=cited(5.5, "as SBIRS-GEO: about three false alarms of noise reported a day"),
    coincidence_sigma=2.0,
    reference_band="MWIR",
    plausible_ratios={"SWIR": (0.25, 2.4)},
    confusion=NOTIONAL_CONFUSION,
)
class HeoConfig(ScanningSensorConfig):
    """What a scene may set of an HEO sensor."""


@hookimpl
def opir_sensor_models() -> Iterable[SensorModel]:
    """Yield the sensor model `HEO`."""
    yield scanning_model("HEO", "sensor in a highly elliptical orbit", HeoConfig)


def _one_track_fleet(
    model: str, summary: str, kind: str, apogee_lon_deg: float, *, period_s: float, count: int
) -> Constellation:
    """Return the constellation MODEL-KIND: satellites that pass the apogee of one ground track one
    after another.

    `kind` is an orbit of a scene with an apogee (molniya, tundra); the passes are evenly spread
    over the period. `summary` goes on after the number of satellites.
    """
    name = f"{model}-{kind.upper()}"
    satellites = [
        {
            "id": f"{name}-{number + 1}",
            "orbit": {
                kind: {
                    "apogee_lon_deg": apogee_lon_deg,
                    "apogee_time_s": round(number * period_s / count, 1),
                },
            },
        }
        for number in range(count)
    ]
    return Constellation(
        name=name, summary=f"{count} {summary}", model=model, satellites=satellites
    )


@hookimpl
def opir_constellations() -> Iterable[Constellation]:
    """Yield the constellations `HEO-MOLNIYA` and `HEO-TUNDRA`."""
    summary = (
        "HEO satellites that take turns about the apogee of one Molniya-class ground track;"
        " notional"
    )
    yield _one_track_fleet(
        "HEO", summary, "molniya", NOTIONAL_APOGEE_LON_DEG, period_s=DAY_S / 2.0, count=3
    )
    summary = (
        "HEO satellites that take turns about the apogee of one Tundra-class ground track; notional"
    )
    yield _one_track_fleet(
        "HEO", summary, "tundra", NOTIONAL_APOGEE_LON_DEG, period_s=DAY_S, count=2
    )
