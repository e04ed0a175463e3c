"""The sensor model `NEXTGEN-GEO`, the projected three-band staring array of the paper, and a
notional fleet.
"""

from collections.abc import Iterable

from opir_core.plugin import (
    Constellation,
    FocalPlaneConfig,
    ModeConfig,
    SensorModel,
    SteeredSensorConfig,
    cited,
    geostationary_fleet,
    hookimpl,
    named,
    scanning_model,
    with_defaults,
)

PAPER = "opir-simulator paper (2026), section 3.3"

#: Evenly spread; not the slots of real satellites.
NOTIONAL_SLOTS_DEG = (-105.0, -15.0, 75.0, 165.0)

#: "High" classification (paper, section 3.4): three bands sample the spectrum.
NOTIONAL_CONFUSION = {
    "ICBM": {"ICBM": 0.95, "IRBM": 0.03, "SRBM": 0.005, "UNKNOWN": 0.015},
    "IRBM": {"ICBM": 0.03, "IRBM": 0.93, "SRBM": 0.02, "UNKNOWN": 0.02},
    "SRBM": {"ICBM": 0.005, "IRBM": 0.025, "SRBM": 0.95, "UNKNOWN": 0.02},
}

#: Scans at whole periods of scene time, the convention of the paper's latencies (section 5.1), and
#: the rule over bands and the threshold of sections 3.4 and 2.4.
PAPER_PRESET = {
    "scan_phase": "aligned",
    "spectral_discrimination": "triple-coincidence",
    "threshold_sigma": 5.0,
}


#: Notional.
NOTIONAL_FOCAL_PLANE = FocalPlaneConfig(
    aperture_m=1.0,
    integration_time_ms=10.0,
    subframes=64,
    optics_temperature_k=220.0,
    detector_temperature_k=100.0,
    read_noise_e=50.0,
    well_capacity_e=4e7,
    blur_urad=4.0,
    jitter_urad=1.0,
    registration_urad=0.2,
    drift_urad_s=0.01,
)

#: Notional: fewer pixels are read out more often in a sector; a stare adds up eight times the light.
NOTIONAL_MODES = {
    "survey": ModeConfig(),
    "sector": ModeConfig(half_angle_deg=3.0, scan_period_ms=10.0),
    "stare": ModeConfig(
        half_angle_deg=3.0,
        scan_period_ms=100.0,
        integration_time_ms=80.0,
        subframes=512,
        settle_s=2.0,
    ),
}


@with_defaults(
    bands=cited({"SWIR": (2.5, 3.0), "MWIR": (4.0, 5.0), "LWIR": (8.0, 12.0)}, PAPER),
    scan_pattern=cited("staring", PAPER),
    scan_period_ms=cited(50.0, PAPER),
    detection_probability=cited(
        {"ICBM": 0.95, "IRBM": 0.92, "SRBM": 0.85}, f"ICBM: {PAPER}; IRBM, SRBM: notional"
    ),
    line_of_sight_sigma_urad=10.0,
    ifov_urad=14.0,
    band_focal_plane={
        "SWIR": {"well_capacity_e": 4e6},
        "LWIR": {"detector_temperature_k": 55.0, "well_capacity_e": 2e8},
    },
    coincidence_sigma=2.0,
    reference_band="MWIR",
    plausible_ratios={"SWIR": (0.25, 2.4), "LWIR": (0.005, 0.3)},
    false_alarm_susceptibility=cited("low", PAPER),
    spectral_discrimination=cited(
        "likelihood",
        "no band is a veto; preset paper: triple-coincidence, opir-simulator paper (2026), section"
        " 3.4",
    ),
    threshold_sigma=cited(5.75, "notional: about one false alarm of noise reported a day"),
    confusion=NOTIONAL_CONFUSION,
    focal_plane=named(notional=NOTIONAL_FOCAL_PLANE),
    modes=named(none={}, notional=NOTIONAL_MODES),
)
class NextGenConfig(SteeredSensorConfig):
    """What a scene may set of a NEXTGEN-GEO sensor."""


@hookimpl
def opir_sensor_models() -> Iterable[SensorModel]:
    """Yield the sensor model `NEXTGEN-GEO`."""
    summary = "projected array, geostationary"
    yield scanning_model("NEXTGEN-GEO", summary, NextGenConfig, presets={"paper": PAPER_PRESET})


@hookimpl
def opir_constellations() -> Iterable[Constellation]:
    """Yield the constellation `NEXTGEN-GEO`."""
    summary = f"{len(NOTIONAL_SLOTS_DEG)} NEXTGEN-GEO satellites in notional, evenly spread slots"
    yield geostationary_fleet("NEXTGEN-GEO", summary, NOTIONAL_SLOTS_DEG)
