"""The sensor model `DSP`, the Defense Support Program as described in the paper, and a notional
fleet of four.

The preset `heritage` follows public accounts of the real system instead of the paper's long-wave
band and 200 ms: a telescope that rotates with the spacecraft at 6 rpm, so one look in 10 s, lead
sulfide detectors at 2.7 um and, on later satellites, a second band at 4.3 um (J. T. Richelson,
America's Space Sentinels: DSP Satellites and National Security, University Press of Kansas, 1999).
The edges of its bands, about those wavelengths, are notional.
"""

from collections.abc import Iterable

from opir_core.plugin import (
    Constellation,
    FocalPlaneConfig,
    ScanningSensorConfig,
    SensorModel,
    cited,
    geostationary_fleet,
    hookimpl,
    named,
    scanning_model,
    with_defaults,
)

PAPER = "opir-simulator paper (2026), section 3.1"

#: Evenly spread; not the slots of real satellites.
NOTIONAL_SLOTS_DEG = (-135.0, -45.0, 45.0, 135.0)

#: "Limited" classification (paper, section 3.4): one band carries little information about the
#: motor.
NOTIONAL_CONFUSION = {
    "ICBM": {"ICBM": 0.55, "IRBM": 0.20, "SRBM": 0.05, "UNKNOWN": 0.20},
    "IRBM": {"ICBM": 0.20, "IRBM": 0.45, "SRBM": 0.15, "UNKNOWN": 0.20},
    "SRBM": {"ICBM": 0.05, "IRBM": 0.20, "SRBM": 0.45, "UNKNOWN": 0.30},
}

#: Scans at whole periods of scene time, the convention of the paper's latencies (section 5.1).
PAPER_PRESET = {"scan_phase": "aligned"}

#: Lead sulfide detectors cooled by radiation; a spin of 10 s and an array along the radius leave a
#: pixel about 1 ms.
HERITAGE_FOCAL_PLANE = {
    "aperture_m": 0.9,
    "optics_transmission": 0.6,
    "quantum_efficiency": 0.6,
    "optics_temperature_k": 270.0,
    "detector_temperature_k": 193.0,
    "integration_time_ms": 1.0,
    "subframes": 1,
    "read_noise_e": 300.0,
    "well_capacity_e": 4e6,
    "bits": 12,
    "blur_urad": 18.0,
    "jitter_urad": 5.0,
    "registration_urad": 1.0,
    "drift_urad_s": 0.05,
}

HERITAGE = {
    "bands": {"SWIR": (2.5, 3.0), "MWIR": (4.2, 4.45)},
    "scan_period_ms": 10_000.0,
    "confirmation_detections": 3,
    "confirmation_scans": 4,
    "focal_plane": HERITAGE_FOCAL_PLANE,
    "band_focal_plane": {"MWIR": {"detector_temperature_k": 120.0}},
}


#: Notional; detectors for the paper's long waves, which the heritage ones would not see.
NOTIONAL_FOCAL_PLANE = FocalPlaneConfig(
    aperture_m=0.9,
    optics_transmission=0.6,
    quantum_efficiency=0.6,
    optics_temperature_k=270.0,
    detector_temperature_k=65.0,
    integration_time_ms=1.0,
    subframes=64,
    read_noise_e=300.0,
    well_capacity_e=1e8,
    blur_urad=18.0,
    jitter_urad=5.0,
    registration_urad=1.0,
    drift_urad_s=0.05,
)


@with_defaults(
    bands=cited({"LWIR": (8.0, 12.0)}, PAPER),
    scan_pattern=cited("spin", PAPER),
    scan_period_ms=cited(200.0, PAPER),
    detection_probability=cited(
        {"ICBM": 0.60, "IRBM": 0.50, "SRBM": 0.35}, f"ICBM: {PAPER}; IRBM, SRBM: notional"
    ),
    line_of_sight_sigma_urad=50.0,
    ifov_urad=56.0,
    false_alarm_susceptibility=cited("high", PAPER),
    spectral_discrimination=cited("none", "opir-simulator paper (2026), section 3.4"),
    confusion=NOTIONAL_CONFUSION,
    focal_plane=named(notional=NOTIONAL_FOCAL_PLANE),
)
class DspConfig(ScanningSensorConfig):
    """What a scene may set of a DSP sensor."""


@hookimpl
def opir_sensor_models() -> Iterable[SensorModel]:
    """Yield the sensor model `DSP`."""
    summary = "Defense Support Program, geostationary"
    yield scanning_model(
        "DSP",
        summary,
        DspConfig,
        presets={"heritage": HERITAGE, "paper": PAPER_PRESET},
        presets_for={"light": "heritage"},
    )


@hookimpl
def opir_constellations() -> Iterable[Constellation]:
    """Yield the constellation `DSP`."""
    summary = f"{len(NOTIONAL_SLOTS_DEG)} DSP satellites in notional, evenly spread slots"
    yield geostationary_fleet("DSP", summary, NOTIONAL_SLOTS_DEG)
