"""The sensor models `LEO-WIDE`, `LEO-MEDIUM` and `LEO-NARROW` of a low tracking layer, and notional
Walker patterns of them.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from attrs import evolve

from opir_core.plugin import (
    Constellation,
    FocalPlaneConfig,
    ModeConfig,
    PointedSensorConfig,
    PointingConfig,
    ScanningSensorConfig,
    SensorModel,
    cited,
    hookimpl,
    named,
    scanning_model,
    with_defaults,
)

#: Notional; Walker delta patterns, which `walker_pattern` of opir_core.orbits cites.
NOTIONAL_WIDE_PATTERN = {
    "total": 24,
    "planes": 6,
    "phasing": 1,
    "altitude_km": 1200.0,
    "inclination_deg": 60.0,
}
NOTIONAL_MEDIUM_PATTERN = {
    "total": 12,
    "planes": 3,
    "phasing": 1,
    "altitude_km": 1200.0,
    "inclination_deg": 60.0,
}

LIMB_AND_SPACE = (
    "the Earth's disk from 1200 km, asin(6378.137 / 7578.137) = 57.3 deg, and a notional margin of"
    " 9.7 deg, in which"
    " targets stand against space up to 600 km above the limb"
)

UP_TO_SPACE = (
    "notional: from nadir to 20 deg above the satellite's horizon, so that bodies higher than it"
    " stand against space"
)

#: Ranges of hundreds to a few thousand kilometres: notional, better than from 36 000 km.
NOTIONAL_CONFUSION = {
    "ICBM": {"ICBM": 0.93, "IRBM": 0.04, "SRBM": 0.01, "UNKNOWN": 0.02},
    "IRBM": {"ICBM": 0.04, "IRBM": 0.91, "SRBM": 0.03, "UNKNOWN": 0.02},
    "SRBM": {"ICBM": 0.01, "IRBM": 0.03, "SRBM": 0.94, "UNKNOWN": 0.02},
}


#: Notional.
NOTIONAL_WIDE_FOCAL_PLANE = FocalPlaneConfig(
    aperture_m=0.1,
    integration_time_ms=20.0,
    subframes=8,
    read_noise_e=50.0,
    well_capacity_e=2e7,
    blur_urad=65.0,
    jitter_urad=10.0,
    registration_urad=4.0,
    drift_urad_s=2.0,
    lag_s=2.0,
)
NOTIONAL_MEDIUM_FOCAL_PLANE = FocalPlaneConfig(
    aperture_m=0.2,
    integration_time_ms=20.0,
    subframes=64,
    read_noise_e=50.0,
    well_capacity_e=5e7,
    blur_urad=14.0,
    jitter_urad=3.0,
    registration_urad=1.0,
    drift_urad_s=0.5,
    lag_s=2.0,
)
NOTIONAL_NARROW_FOCAL_PLANE = evolve(
    NOTIONAL_MEDIUM_FOCAL_PLANE, aperture_m=0.3, blur_urad=8.0, jitter_urad=2.0
)

#: Notional: the field of three degrees steps over a wider one, 0.2 s at each place; a stare adds up
#: four times the light. `spot` returns to the sensor's own settings.
NOTIONAL_NARROW_MODES = {
    "survey": ModeConfig(half_angle_deg=15.0, scan_period_ms=20_000.0),
    "sector": ModeConfig(half_angle_deg=5.0, scan_period_ms=2400.0),
    "spot": ModeConfig(),
    "stare": ModeConfig(
        scan_period_ms=400.0,
        integration_time_ms=80.0,
        subframes=256,
        line_of_sight_sigma_urad=5.0,
        settle_s=4.0,
    ),
}


@with_defaults(
    bands={"SWIR": (2.5, 3.0), "MWIR": (4.0, 5.0)},
    scan_pattern="staring",
    scan_period_ms=100.0,
    detection_probability={"ICBM": 0.95, "IRBM": 0.93, "SRBM": 0.9},
    field_of_regard_half_angle_deg=cited(67.0, LIMB_AND_SPACE),
    line_of_sight_sigma_urad=100.0,
    ifov_urad=200.0,
    threshold_sigma=6.5,
    false_alarm_susceptibility="moderate",
    spectral_discrimination="likelihood",
    coincidence_sigma=2.0,
    reference_band="MWIR",
    plausible_ratios={"SWIR": (0.25, 2.4)},
    confusion=NOTIONAL_CONFUSION,
    focal_plane=named(notional=NOTIONAL_WIDE_FOCAL_PLANE),
)
class WideConfig(ScanningSensorConfig):
    """What a scene may set of a LEO-WIDE sensor."""


@with_defaults(
    bands={"MWIR": (4.0, 5.0), "LWIR": (8.0, 12.0)},
    scan_pattern="staring",
    scan_period_ms=200.0,
    follows_bodies=True,
    detection_probability={"ICBM": 0.9, "IRBM": 0.88, "SRBM": 0.85},
    field_of_regard_half_angle_deg=cited(110.0, UP_TO_SPACE),
    line_of_sight_sigma_urad=30.0,
    band_focal_plane={"LWIR": {"detector_temperature_k": 55.0, "well_capacity_e": 2e8}},
    ifov_urad=50.0,
    threshold_sigma=7.0,
    false_alarm_susceptibility="low",
    spectral_discrimination=cited(
        "likelihood", "a warm body shows in LWIR alone: then MWIR weighs nothing"
    ),
    confusion=NOTIONAL_CONFUSION,
    focal_plane=named(notional=NOTIONAL_MEDIUM_FOCAL_PLANE),
)
class MediumConfig(ScanningSensorConfig):
    """What a scene may set of a LEO-MEDIUM sensor."""


@with_defaults(
    bands={"MWIR": (4.0, 5.0), "LWIR": (8.0, 12.0)},
    scan_pattern="staring",
    scan_period_ms=200.0,
    follows_bodies=True,
    detection_probability={"ICBM": 0.95, "IRBM": 0.93, "SRBM": 0.9},
    field_of_regard_half_angle_deg=cited(110.0, UP_TO_SPACE),
    pointing=PointingConfig(half_angle_deg=1.5, slew_deg_s=2.0, settle_s=2.0, delay_s=1.0),
    modes=named(none={}, notional=NOTIONAL_NARROW_MODES),
    line_of_sight_sigma_urad=10.0,
    band_focal_plane={"LWIR": {"detector_temperature_k": 55.0, "well_capacity_e": 2e8}},
    ifov_urad=20.0,
    threshold_sigma=7.0,
    false_alarm_susceptibility="low",
    spectral_discrimination=cited(
        "likelihood", "a warm body shows in LWIR alone: then MWIR weighs nothing"
    ),
    confusion=NOTIONAL_CONFUSION,
    focal_plane=named(notional=NOTIONAL_NARROW_FOCAL_PLANE),
)
class NarrowConfig(PointedSensorConfig):
    """What a scene may set of a LEO-NARROW sensor."""


@hookimpl
def opir_sensor_models() -> Iterable[SensorModel]:
    """Yield the sensor models `LEO-WIDE`, `LEO-MEDIUM` and `LEO-NARROW`."""
    summary = "wide field over the disk and the limb below a low orbit, for plumes"
    yield scanning_model("LEO-WIDE", summary, WideConfig)
    summary = "narrower, finer field from a low orbit, for plumes and warm bodies"
    yield scanning_model("LEO-MEDIUM", summary, MediumConfig)
    summary = "fine field of three degrees that a director points, from a low orbit, for tracks"
    yield scanning_model("LEO-NARROW", summary, NarrowConfig)


def _walker_fleet(model: str, pattern: Mapping[str, Any]) -> Constellation:
    """Return the constellation with the name of its sensor model: satellites MODEL-01, ... of a
    Walker pattern.

    `pattern` holds the settings of `orbit: walker` that the satellites share; the first ascending
    node is at 0 deg.
    """
    satellites = [
        {
            "id": f"{model}-{number:02d}",
            "orbit": {"walker": {**pattern, "satellite": number, "lon_asc_node_deg": 0.0}},
        }
        for number in range(1, pattern["total"] + 1)
    ]
    walker = "{inclination_deg:g} deg: {total}/{planes}/{phasing} at {altitude_km:g} km".format(
        **pattern
    )
    summary = f"{len(satellites)} {model} satellites in a notional Walker pattern {walker}"
    return Constellation(name=model, summary=summary, model=model, satellites=satellites)


@hookimpl
def opir_constellations() -> Iterable[Constellation]:
    """Yield the constellations `LEO-WIDE`, `LEO-MEDIUM` and `LEO-NARROW`."""
    yield _walker_fleet("LEO-WIDE", NOTIONAL_WIDE_PATTERN)
    yield _walker_fleet("LEO-MEDIUM", NOTIONAL_MEDIUM_PATTERN)
    yield _walker_fleet("LEO-NARROW", NOTIONAL_MEDIUM_PATTERN)
