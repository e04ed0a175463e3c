"""The figures of the paper's sections 2 and 3: what there is to be seen, and the sensors."""

from collections.abc import Iterator, Mapping

import numpy as np
from opir_photons.radiometry import (
    irradiance_of_projected_area,
    irradiance_of_sphere,
    minimum_detectable_intensity,
)

from opir_core import Host
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, GEOSTATIONARY_RADIUS_M
from opir_core.plugin import Band, Sensor
from opir_paper.check import HOLDS, NOT_REPRODUCED, NOTIONAL, STATED, TAKEN_OVER, Check, checked
from opir_paper.printed import about, rounded
from opir_paper.simulated import Simulated

#: Section 2.4: range of the least intensity, m; its threshold is 5.
_RANGE_M = 3.6e7

#: Section 3.1: revolutions of DSP a minute.
_DSP_RPM = 6.0

_BANDS = {
    "DSP": "LWIR 8-12",
    "SBIRS-GEO": "SWIR 2.5-3, MWIR 4-5",
    "NEXTGEN-GEO": "SWIR 2.5-3, MWIR 4-5, LWIR 8-12",
}
#: Class, profile, and the printed range of its plume near 2.7 µm, kW/sr.
_PLUMES = (("ICBM", "ICBM_solid", "10 to 100", 10.0, 100.0), ("SRBM", "SRBM", "0.1 to 1", 0.1, 1.0))
_WORDS = {
    "DSP": "high, none",
    "SBIRS-GEO": "moderate, dual band ratio",
    "NEXTGEN-GEO": "low, triple coincidence",
}


def intensities(sensors: Mapping[str, Sensor]) -> Iterator[Check]:
    """Yield the figures of section 2: height, both forms of the irradiance, plumes, the least
    intensity by unit.
    """
    height_km = 1e-3 * (GEOSTATIONARY_RADIUS_M - EARTH_EQUATORIAL_RADIUS_M)
    position = next(iter(sensors.values())).orbit.position_ecef_m(np.zeros(1))
    seen_km = 1e-3 * (float(np.linalg.norm(position)) - EARTH_EQUATORIAL_RADIUS_M)
    printed = rounded("35786")
    verdict = HOLDS if printed.covers(height_km) and printed.covers(seen_km) else NOT_REPRODUCED
    yield Check(
        "2.1",
        "geostationary height",
        "35786 km",
        f"{height_km:.1f} km",
        f"{seen_km:.1f} km",
        verdict,
    )
    for area, form in (
        ("of a sphere's surface", irradiance_of_sphere),
        ("projected", irradiance_of_projected_area),
    ):
        yield checked(
            "2.1", f"E R² / (L A), area {area}", rounded("0.25"), float(form(1.0, 1.0, 1.0))
        )
    for name, profile, text, least, most in _PLUMES:
        peak_kw_sr = (
            1e-3
            * Host.discover()
            .component("opir_target_classes", name)
            .plume(profile)
            .peak_w_sr["SWIR"]
        )
        verdict = HOLDS if least <= peak_kw_sr <= most else NOTIONAL
        quantity = f"{name}: plume near 2.7 um, opir's notional peak"
        yield Check("2.3", quantity, f"{text} kW/sr", f"{peak_kw_sr:.4g} kW/sr", "-", verdict)
    for unit, nei_w_m2 in (("W/cm²", 5e-14 * 1e4), ("W/m²", 5e-14)):
        least = float(minimum_detectable_intensity(nei_w_m2, _RANGE_M))
        yield checked(
            "2.4", f"least intensity, NEI 5e-14 {unit}", about("300", 0.1), least, "W/sr", digits=3
        )


def stated(sensors: Mapping[str, Sensor]) -> Iterator[Check]:
    """Yield the sensors' parameters (3.1 to 3.4, 6.3), which are the defaults of the packages."""
    period_s = _heritage_period_s()
    simulated = Simulated(period_s, period_s, period_s)
    name = f"DSP: scan period of {_DSP_RPM:g} revolutions a minute (preset heritage)"
    yield checked("3.1", name, rounded("10"), 60.0 / _DSP_RPM, "s", simulated)
    for number, (name, sensor) in enumerate(sensors.items(), 1):
        period_ms, probability = STATED[name]
        assert sensor.radiometer is not None
        rows = (
            ("bands, um", _BANDS[name], ", ".join(_band_text(band) for band in sensor.bands)),
            ("scan period, ms", period_ms, f"{sensor.scan.period_ns * 1e-6:g}"),
            ("P_d, ICBM", probability, f"{sensor.detection_probability['ICBM']:.2f}"),
            ("false alarm rate, discrimination", _WORDS[name], _words(sensor)),
            ("threshold, sigma", "5", f"{sensor.radiometer.threshold:g}"),
        )
        for what, paper, ours in rows:
            verdict = TAKEN_OVER if paper == ours else NOT_REPRODUCED
            yield Check(f"3.{number}", f"{name}: {what}", paper, ours, "-", verdict)
    right = [sensor.confusion["ICBM"]["ICBM"] for sensor in sensors.values()]
    verdict = TAKEN_OVER if sorted(set(right)) == right else NOT_REPRODUCED
    ours = ", ".join(f"{share:.2f}" for share in right)
    yield Check(
        "3.4",
        "P(an ICBM is called ICBM), by sensor",
        '"limited, moderate, high"',
        ours,
        "-",
        verdict,
    )


def _words(sensor: Sensor) -> str:
    return f"{sensor.false_alarm_susceptibility}, {sensor.spectral_discrimination}".replace(
        "-", " "
    )


def _band_text(band: Band) -> str:
    return f"{band.name} {band.lower_um:g}-{band.upper_um:g}"


def _heritage_period_s() -> float:
    preset = Host.discover().component("opir_sensor_models", "DSP").presets["heritage"]
    return 1e-3 * float(preset["scan_period_ms"])
