"""The sensor model `SBIRS-GEO`, the Space-Based Infrared System as described in the paper, and a
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

PAPER = "opir-simulator paper (2026), section 3.2"

#: Evenly spread; not the slots of real satellites.
NOTIONAL_SLOTS_DEG = (-165.0, -75.0, 15.0, 105.0)

#: "Moderate" classification (paper, section 3.4): the ratio of two bands gives the temperature of
#: the plume.
NOTIONAL_CONFUSION = {
    "ICBM": {"ICBM": 0.80, "IRBM": 0.10, "SRBM": 0.02, "UNKNOWN": 0.08},
    "IRBM": {"ICBM": 0.12, "IRBM": 0.72, "SRBM": 0.08, "UNKNOWN": 0.08},
    "SRBM": {"ICBM": 0.03, "IRBM": 0.10, "SRBM": 0.77, "UNKNOWN": 0.10},
}

#: Scans at whole periods of scene time, the convention of the paper's latencies (section 5.1), and
#: the rule over bands and the threshold of sections 3.4 and 2.4.
PAPER_PRESET = {
    "scan_phase": "aligned",
    "spectral_discrimination": "dual-band-ratio",
    "threshold_sigma": 5.0,
}


#: Notional.
NOTIONAL_FOCAL_PLANE = FocalPlaneConfig(
    aperture_m=0.6,
    integration_time_ms=10.0,
    subframes=16,
    detector_temperature_k=110.0,
    read_noise_e=100.0,
    well_capacity_e=2e7,
    blur_urad=9.0,
    jitter_urad=2.5,
    registration_urad=0.5,
    drift_urad_s=0.02,
)

#: Notional. A sector has a ninth of the survey's solid angle over twice: twice the light of each
#: place at five times the rate. A stare adds up eight times the light.
NOTIONAL_MODES = {
    "survey": ModeConfig(),
    "sector": ModeConfig(
        half_angle_deg=3.0, scan_period_ms=20.0, integration_time_ms=20.0, subframes=32
    ),
    "stare": ModeConfig(half_angle_deg=1.0, integration_time_ms=80.0, subframes=128, settle_s=2.0),
}


@with_defaults(
    bands=cited({"SWIR": (2.5, 3.0), "MWIR": (4.0, 5.0)}, PAPER),
    scan_pattern=cited("step-stare", PAPER),
    scan_period_ms=cited(100.0, PAPER),
    detection_probability=cited(
        {"ICBM": 0.80, "IRBM": 0.72, "SRBM": 0.60}, f"ICBM: {PAPER}; IRBM, SRBM: notional"
    ),
    line_of_sight_sigma_urad=20.0,
    coincidence_sigma=2.0,
    reference_band="MWIR",
    plausible_ratios={"SWIR": (0.25, 2.4)},
    false_alarm_susceptibility=cited("moderate", PAPER),
    spectral_discrimination=cited(
        "likelihood",
        "no band is a veto; preset paper: dual-band-ratio, opir-simulator paper (2026), section"
        " 3.4",
    ),
    threshold_sigma=cited(5.5, "notional: about one false alarm of noise reported a day"),
    confusion=NOTIONAL_CONFUSION,
    focal_plane=named(notional=NOTIONAL_FOCAL_PLANE),
    modes=named(none={}, notional=NOTIONAL_MODES),
)
class SbirsConfig(SteeredSensorConfig):
    """What a scene may set of a SBIRS-GEO sensor."""


@hookimpl
def opir_sensor_models() -> Iterable[SensorModel]:
    """Yield the sensor model `SBIRS-GEO`."""
    summary = "Space-Based Infrared System, geostationary"
    yield scanning_model("SBIRS-GEO", summary, SbirsConfig, presets={"paper": PAPER_PRESET})


@hookimpl
def opir_constellations() -> Iterable[Constellation]:
    """Yield the constellation `SBIRS-GEO`."""
    summary = f"{len(NOTIONAL_SLOTS_DEG)} SBIRS-GEO satellites in notional, evenly spread slots"
    yield geostationary_fleet("SBIRS-GEO", summary, NOTIONAL_SLOTS_DEG)
