"""The figures of the paper's sections 2 and 3: intensities, and the sensors."""

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
_AREAS = {"of a sphere's surface": irradiance_of_sphere, "projected": irradiance_of_projected_area}
_WORDS = {
    "DSP": "high, none",
    "SBIRS-GEO": "moderate, dual band ratio",
    "NEXTGEN-GEO": "low, triple coincidence",
}


def intensities(sensors: Mapping[str, Sensor]) -> Iterator[Check]:
    """Yield the figures of section 2: height, both forms of the irradiance, plumes, the least
    intensity by unit.
    """
    yield _height(next(iter(sensors.values())))
    for area, form in _AREAS.items():
        value = float(form(1.0, 1.0, 1.0))
        yield checked("2.1", f"E R² / (L A), area {area}", rounded("0.25"), value)
    for name, profile, text, low, high in _PLUMES:
        target_class = Host.discover().component("opir_target_classes", name)
        peak_kw_sr = 1e-3 * target_class.plume(profile).peak_w_sr["SWIR"]
        verdict = HOLDS if low <= peak_kw_sr <= high else NOTIONAL
        quantity = f"{name}: plume near 2.7 um, opir's notional peak"
        yield Check("2.3", quantity, f"{text} kW/sr", f"{peak_kw_sr:.4g} kW/sr", "-", verdict)
    for unit, nei_w_m2 in (("W/cm²", 5e-14 * 1e4), ("W/m²", 5e-14)):
        least = float(minimum_detectable_intensity(nei_w_m2, _RANGE_M))
        quantity = f"least intensity, NEI 5e-14 {unit}"
        yield checked("2.4", quantity, about("300", 0.1), least, "W/sr", digits=3)


def _height(sensor: Sensor) -> Check:
    """Return the check of the geostationary height, and of that of a sensor."""
    formula_km = 1e-3 * (GEOSTATIONARY_RADIUS_M - EARTH_EQUATORIAL_RADIUS_M)
    radius_m = float(np.linalg.norm(sensor.orbit.position_ecef_m(np.zeros(1))))
    sensor_km = 1e-3 * (radius_m - EARTH_EQUATORIAL_RADIUS_M)
    printed = rounded("35786")
    is_reproduced = printed.covers(formula_km) and printed.covers(sensor_km)
    return Check(
        "2.1",
        "geostationary height",
        "35786 km",
        f"{formula_km:.1f} km",
        f"{sensor_km:.1f} km",
        HOLDS if is_reproduced else NOT_REPRODUCED,
    )


def stated(sensors: Mapping[str, Sensor]) -> Iterator[Check]:
    """Yield the sensors' parameters (3.1 to 3.4, 6.3), which are the defaults of the packages."""
    yield _heritage_period()
    for number, (name, sensor) in enumerate(sensors.items(), 1):
        for quantity, paper, value in _parameters(name, sensor):
            verdict = TAKEN_OVER if paper == value else NOT_REPRODUCED
            yield Check(f"3.{number}", f"{name}: {quantity}", paper, value, "-", verdict)
    shares = [sensor.confusion["ICBM"]["ICBM"] for sensor in sensors.values()]
    verdict = TAKEN_OVER if sorted(set(shares)) == shares else NOT_REPRODUCED
    value = ", ".join(f"{share:.2f}" for share in shares)
    quantity = "P(an ICBM is called ICBM), by sensor"
    yield Check("3.4", quantity, '"limited, moderate, high"', value, "-", verdict)


def _parameters(name: str, sensor: Sensor) -> Iterator[tuple[str, str, str]]:
    """Yield a sensor's parameters: as printed, and as opir has them."""
    assert sensor.radiometer is not None
    period_ms, probability = STATED[name]
    yield "bands, um", _BANDS[name], ", ".join(_band_text(band) for band in sensor.bands)
    yield "scan period, ms", period_ms, f"{sensor.scan.period_ns * 1e-6:g}"
    yield "P_d, ICBM", probability, f"{sensor.detection_probability['ICBM']:.2f}"
    yield (
        "false alarm rate, discrimination",
        _WORDS[name],
        f"{sensor.false_alarm_susceptibility}, {sensor.spectral_discrimination}".replace("-", " "),
    )
    yield "threshold, sigma", "5", f"{sensor.radiometer.threshold:g}"


def _band_text(band: Band) -> str:
    return f"{band.name} {band.lower_um:g}-{band.upper_um:g}"


def _heritage_period() -> Check:
    preset = Host.discover().component("opir_sensor_models", "DSP").presets["heritage"]
    period_s = 1e-3 * float(preset["scan_period_ms"])
    simulated = Simulated(period_s, period_s, period_s)
    quantity = f"DSP: scan period of {_DSP_RPM:g} revolutions a minute (preset heritage)"
    return checked("3.1", quantity, rounded("10"), 60.0 / _DSP_RPM, "s", simulated)
