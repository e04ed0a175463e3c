"""From the configuration of a scanning sensor to the sensor: its bands, radiometer, orbit and scan
pattern.
"""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import asdict, evolve, fields_dict

from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.errors import ModelError, Problem, SceneError
from opir_core.geometry import geodetic_to_ecef
from opir_core.interfaces.contexts import SensorContext
from opir_core.interfaces.focal_plane import FocalPlaneConfig
from opir_core.interfaces.sensors import (
    Band,
    Orbit,
    Pointing,
    Radiometer,
    ReportingStage,
    ScanPattern,
    Sensor,
)
from opir_core.orbits.orbit_models import GeostationaryOrbit, MovingOrbit, orbit_of
from opir_core.sensors.reporting import ReportingConfig
from opir_core.sensors.scan_patterns import scan_pattern
from opir_core.sensors.scanning_sensor import ScanningSensorConfig

if TYPE_CHECKING:
    from opir_core.sensors.pointed_sensor import PointingConfig

#: The default half angle from a geosynchronous slot, and the margin around the Earth's disk from
#: other orbits, deg.
_SLOT_HALF_ANGLE_DEG = 10.0
_MARGIN_DEG = 1.3

#: W/cm² to W/m².
W_M2_PER_W_CM2 = 1e4


def built_sensor(config: ScanningSensorConfig, context: SensorContext, type_: str) -> Sensor:
    """Return the sensor of a configuration."""
    bands = _bands(config.bands)
    completed = {name: _completed(config, name) for name in ("detection_probability", "confusion")}
    orbit = _orbit(config, context)
    half_angle_deg = _half_angle_deg(config, orbit)
    return Sensor(
        id=context.id,
        type=type_,
        orbital_slot_deg=_slot_deg(config),
        bands=bands,
        orbit=orbit,
        scan=_scan(config, half_angle_deg),
        field_of_regard_half_angle_rad=math.radians(half_angle_deg),
        minimum_elevation_rad=math.radians(config.minimum_elevation_deg),
        solar_exclusion_rad=math.radians(config.solar_exclusion_deg),
        line_of_sight_sigma_rad=config.line_of_sight_sigma_urad * 1e-6,
        radiometer=_radiometer(config, bands),
        line_of_sight_bias_sigma_rad=config.line_of_sight_bias_sigma_urad * 1e-6,
        detection_probability=completed["detection_probability"],
        confusion=completed["confusion"],
        false_alarm_susceptibility=config.false_alarm_susceptibility,
        spectral_discrimination=config.spectral_discrimination,
        follows_bodies=config.follows_bodies,
        reporting=_reporting(config.reporting),
        pointing=_pointing(config),
        modes=_modes(config, context, type_, half_angle_deg),
        settings={**asdict(config), "field_of_regard_half_angle_deg": half_angle_deg, **completed},
    )


def _pointing(config: ScanningSensorConfig) -> Pointing | None:
    """Return the field of a sensor that takes commands."""
    return _field(config) if getattr(config, "is_pointed", False) else None


def _field(config: Any) -> Pointing:
    """Return the field of a configuration with `pointing`."""
    pointing: PointingConfig = config.pointing
    at_ecef_m = None
    if pointing.at_deg is not None:
        lat_rad, lon_rad = map(math.radians, pointing.at_deg)
        x, y, z = geodetic_to_ecef(lat_rad, lon_rad, 0.0).tolist()
        at_ecef_m = x, y, z
    return Pointing(
        half_angle_rad=math.radians(pointing.half_angle_deg),
        slew_rad_s=math.radians(pointing.slew_deg_s),
        settle_s=pointing.settle_s,
        delay_s=pointing.delay_s,
        at_ecef_m=at_ecef_m,
        sun_keep_out_rad=math.radians(pointing.sun_keep_out_deg),
        limb_keep_out_rad=math.radians(pointing.limb_keep_out_deg),
    )


def _modes(
    config: Any, context: SensorContext, type_: str, half_angle_deg: float
) -> Mapping[str, Sensor]:
    """Return by name what a sensor is in each of its modes, with an id of its own; raises
    `SceneError` for one that its scan is too slow for.
    """
    names = sorted(getattr(config, "modes", ()))
    complaint_of = getattr(config, "rate_complaint", lambda _name, _half_angle_deg: None)
    problems = [
        Problem(f"modes.{name}", complaint)
        for name in names
        if (complaint := complaint_of(name, half_angle_deg))
    ]
    if problems:
        raise SceneError(problems)
    return {name: _in_mode(config.in_mode(name), name, context, type_) for name in names}


def _in_mode(mode: Any, name: str, context: SensorContext, type_: str) -> Sensor:
    sensor = built_sensor(mode, evolve(context, id=f"{context.id}/{name}"), type_)
    return evolve(sensor, pointing=_field(mode))


def _reporting(config: ReportingConfig) -> tuple[ReportingStage, ...]:
    """Return the stages of reporting, in order; none without latency."""
    stages = {name: getattr(config, name) for name in fields_dict(type(config))}
    if not any(stage.mean_s for stage in stages.values()):
        return ()
    return tuple(
        ReportingStage(name, stage.mean_s, stage.sigma_s) for name, stage in stages.items()
    )


def _slot_deg(config: ScanningSensorConfig) -> float | None:
    """Return the longitude of the sensor's slot, or None where it has none."""
    if config.orbit is None:
        return config.orbital_slot_deg
    return None if config.orbit.slot is None else config.orbit.slot.lon_deg


def _orbit(config: ScanningSensorConfig, context: SensorContext) -> Orbit:
    if config.orbit is None:
        assert config.orbital_slot_deg is not None
        return GeostationaryOrbit(config.orbital_slot_deg)
    orbit = orbit_of(config.orbit, context.epoch_us, context.readers)
    if config.orbit.file is not None and isinstance(orbit, MovingOrbit):
        try:
            orbit.motion.position_ecef_m(np.array([context.duration_s]))
        except ModelError as error:
            raise SceneError(
                [
                    Problem(
                        "orbit.file.path",
                        f"{config.orbit.file.path}: {error}, and the scene lasts"
                        f" {context.duration_s:g} s",
                    )
                ]
            ) from error
    return orbit


def _half_angle_deg(config: ScanningSensorConfig, orbit: Orbit) -> float:
    """Return the half angle of the field of regard: as set, or the Earth's disk from the orbit's
    least height in half a day, as far as the orbit is known, with a margin beyond the
    limb."""
    if config.field_of_regard_half_angle_deg is not None:
        return config.field_of_regard_half_angle_deg
    if _slot_deg(config) is not None:
        return _SLOT_HALF_ANGLE_DEG
    try:
        position_m = orbit.position_ecef_m(np.linspace(0.0, 43_200.0, 97))
    except ModelError:
        position_m = orbit.position_ecef_m(np.zeros(1))
    sine = EARTH_EQUATORIAL_RADIUS_M / float(np.sqrt(np.square(position_m).sum(axis=1)).min())
    return math.degrees(math.asin(min(sine, 1.0))) + _MARGIN_DEG


def _scan(config: ScanningSensorConfig, half_angle_deg: float) -> ScanPattern:
    return scan_pattern(
        config.scan_pattern,
        config.scan_phase,
        period_ns=config.scan_period_ns,
        half_angle_rad=math.radians(half_angle_deg),
        rows=config.raster_rows,
        columns=config.raster_columns,
    )


def _completed(config: ScanningSensorConfig, name: str) -> dict[str, Any]:
    """Return a mapping by target type with the model's defaults for the types it does not name."""
    default = fields_dict(type(config))[name].default
    return {**(default if isinstance(default, Mapping) else {}), **getattr(config, name)}


def _bands(edges: Mapping[str, tuple[float, float]]) -> tuple[Band, ...]:
    """Return bands, the shortest wavelength first: the keys of a scene's mapping have no order to
    rely on.
    """
    return tuple(
        Band(name, *edges[name]) for name in sorted(edges, key=lambda name: (*edges[name], name))
    )


def _radiometer(config: ScanningSensorConfig, bands: tuple[Band, ...]) -> Radiometer:
    """Return the radiometer of a configuration."""
    nei = config.nei_w_m2 if config.nei_w_cm2 is None else config.nei_w_cm2 * W_M2_PER_W_CM2
    return Radiometer(
        nei_w_m2=tuple(
            config.band_nei_w_m2.get(band.name, math.nan if nei is None else nei) for band in bands
        ),
        ifov_rad=config.ifov_urad * 1e-6,
        collection_m2_s=config.collection_m2_s,
        threshold=_threshold(config),
        coincidence=config.coincidence_sigma,
        confirmation=(config.confirmation_detections, config.confirmation_scans),
        confirmation_speed_m_s=config.confirmation_speed_m_s,
        reference=_reference(config, bands),
        ratio_tolerance=config.ratio_tolerance_sigma,
        ratios=tuple(config.plausible_ratios.get(band.name, (0.0, float("inf"))) for band in bands),
        focal_planes=_focal_planes(config, bands),
    )


def _focal_planes(
    config: ScanningSensorConfig, bands: tuple[Band, ...]
) -> tuple[FocalPlaneConfig, ...]:
    """Return the focal planes by band, with integration times and lags that fit the scan period;
    none without one.
    """
    period_ms = config.scan_period_ms
    if config.focal_plane is None:
        return ()
    changes: Any = config.band_focal_plane
    planes = [evolve(config.focal_plane, **changes.get(band.name, {})) for band in bands]
    times = [
        (min(plane.integration_time_ms, period_ms), max(plane.lag_s, period_ms * 1e-3))
        for plane in planes
    ]
    return tuple(
        evolve(plane, integration_time_ms=ms, lag_s=s)
        for plane, (ms, s) in zip(planes, times, strict=True)
    )


def _reference(config: ScanningSensorConfig, bands: tuple[Band, ...]) -> int:
    """Return the number of the reference band: the one named, or the shortest if the sensor does
    not have that band.
    """
    names = [band.name for band in bands]
    return names.index(config.reference_band) if config.reference_band in names else 0


def _threshold(config: ScanningSensorConfig) -> float:
    if config.false_alarm_probability is None:
        return config.threshold_sigma
    # Imported here: sensors without a false-alarm probability need no scipy.
    from scipy.special import ndtri

    return -float(ndtri(config.false_alarm_probability))
