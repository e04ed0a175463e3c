"""A sensor on the bench: its scene, and targets posed before it, seen by the scene's own models."""

import copy
import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from attrs import frozen
from opir_coverage import detection_of, target_class_of
from scipy.special import ndtr

from opir_core import Plan, Scene, compile_plan, scene_from_mapping
from opir_core.arrays import ByteArray, FloatArray, IndexArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.errors import ModelError
from opir_core.geometry import ecef_to_geodetic, geodetic_to_ecef, length, local_axes
from opir_core.plugin import (
    DetectionProbability,
    Exposures,
    FocalPlaneConfig,
    Sensor,
    TargetClass,
    Trajectories,
)
from opir_core.reading import scene_mapping

DAY_S = 86_400.0
#: Scene time at which posed targets are seen, s.
_LOOK_S = 3600.0
#: Least sine of the angle between a line of sight and the vertical that gives a direction across.
_LEAST_SINE = 1e-9
#: Settings of a focal plane that passes the whole light of a target.
_ALL_LIGHT: Mapping[str, Any] = {"temporal_filter": "none", "well_capacity_e": 1e18, "bits": 64}
#: Settings by which the bench leaves out targets, sources, outputs and trackers of a scene.
_LEFT_OUT: Mapping[str, Any] = {
    "targets": [],
    "sources": [],
    "outputs": [],
    "tracker": "none",
    "duration_s": 7200.0,
}
#: The scene of a sensor alone.
_ALONE: Mapping[str, Any] = {
    "scene": "bench",
    "epoch": "2026-04-01T12:00:00Z",
    "seed": 1,
    "detection": "snr",
    "atmosphere": "lowtran",
    "background": "earth",
}


@frozen(eq=False, kw_only=True)
class Poses:
    """Targets (n,) of a class: height, m, the sensor's elevation above their horizon and the
    aspect, rad, the share of the burn that is over, and the speed, m/s, by which a frame difference
    finds them elsewhere than a lag earlier."""

    height_m: FloatArray
    elevation_rad: FloatArray
    aspect_rad: FloatArray
    burned: FloatArray
    speed_m_s: FloatArray
    target_class: str = "ICBM"

    @classmethod
    def of(cls, target_class: str = "ICBM", **values: Any) -> "Poses":
        """Return poses of numbers and columns (`height_m`, …) of one length, and defaults."""
        values_by_name = {
            "height_m": 20e3,
            "elevation_rad": math.radians(40.0),
            "aspect_rad": 0.5 * math.pi,
            "burned": 0.4,
            "speed_m_s": 1000.0,
            **values,
        }
        columns = np.broadcast_arrays(
            *(
                np.atleast_1d(np.asarray(value, dtype=np.float64))
                for value in values_by_name.values()
            )
        )
        return cls(target_class=target_class, **dict(zip(values_by_name, columns, strict=True)))

    def __len__(self) -> int:
        return len(self.height_m)


@frozen(eq=False)
class Signals:
    """One look at posed targets: P_d (n,), ranges (n,), m, and by band (n, B) SNR, noise, air.

    `snr` is the expected signal over the noise, which is in W/m².
    """

    chance: FloatArray
    range_m: FloatArray
    snr: FloatArray
    noise_w_m2: FloatArray
    transmittance: FloatArray

    @property
    def irradiance_w_m2(self) -> FloatArray:
        """The irradiances (n, B) of targets at the aperture after frame difference and wells."""
        return self.snr * self.noise_w_m2


@frozen(eq=False)
class PosedTargets(Trajectories):
    """Targets in straight flight through their places, in the direction of their aspect."""

    type_code: ByteArray
    ignition_s: FloatArray
    burnout_s: FloatArray
    class_names: Sequence[str]
    place_m: FloatArray
    velocity_m_s: FloatArray
    profile: str

    @classmethod
    def of(cls, plan: Plan, poses: Poses) -> "PosedTargets":
        """Return targets posed before the first sensor of a plan."""
        kind: TargetClass = target_class_of(plan, poses.target_class)
        profile = kind.profiles[0]
        count = len(poses)
        code = np.full(count, kind.type_code, dtype=np.uint8)
        ignition_s = _LOOK_S - poses.burned * profile.burn_time_s
        sensor_m = np.asarray(plan.sensors[0].orbit.position_ecef_m(np.array([_LOOK_S])))[0]
        place_m = _places_m(sensor_m, poses.height_m, poses.elevation_rad)
        velocity_m_s = poses.speed_m_s[:, None] * _headings(sensor_m, place_m, poses.aspect_rad)
        burnout_s = ignition_s + profile.burn_time_s
        return cls(
            code, ignition_s, burnout_s, [kind.name] * count, place_m, velocity_m_s, profile.name
        )

    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) of targets (n,) at scene times (n,)."""
        return self.place_m[target] + (time_s - _LOOK_S)[:, None] * self.velocity_m_s[target]

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return the profile of each target."""
        return [{"profile": self.profile}] * len(self.type_code)


class Bench:
    """One sensor of a scene, or a sensor model alone, with the scene's air and background."""

    def __init__(self, mapping: Mapping[str, Any]) -> None:
        self.mapping = mapping

    @classmethod
    def of_scene(cls, scene: Scene, sensor: str | None = None) -> "Bench":
        """Return a scene's sensor by id, or its first; raises `ModelError` for an unknown id."""
        mapping = scene_mapping(scene)
        sensors = [
            member for block in mapping["sensors"] for member in block.get("members", [block])
        ]
        ids = [member["id"] for member in sensors]
        if sensor is not None and sensor not in ids:
            raise ModelError(f"--sensor: {sensor!r} is not one of {', '.join(ids)}")
        settings = sensors[0 if sensor is None else ids.index(sensor)]
        return cls({**mapping, **_LEFT_OUT, "sensors": [settings]})

    @classmethod
    def of_model(cls, model: str) -> "Bench":
        """Return a sensor model with its defaults, at the slot of 0° or on its own orbit."""
        return cls(
            {
                **_ALONE,
                **_LEFT_OUT,
                "sensors": [{"model": model, "id": model, "orbital_slot_deg": 0.0}],
            }
        )

    def changed(self, **changes: Any) -> "Bench":
        """Return the bench with changed values; keys are paths such as `sensor__ifov_urad`."""
        mapping: Any = copy.deepcopy(dict(self.mapping))
        for path, value in changes.items():
            *parents, key = path.replace("sensor__", "sensors__0__", 1).split("__")
            at = mapping
            for name in parents:
                at = at[int(name)] if name.isdigit() else at[name]
            at[key] = value
        return Bench(mapping)

    @cached_property
    def plan(self) -> Plan:
        """The plan of the bench."""
        return compile_plan(scene_from_mapping(self.mapping))

    @property
    def sensor(self) -> Sensor:
        """The sensor on the bench."""
        return self.plan.sensors[0]

    def background(self) -> dict[str, Any]:
        """Return the block of the scene's background, with all its settings."""
        return dict(scene_mapping(self.plan.scene)["background"])

    @property
    def planes(self) -> Sequence[FocalPlaneConfig]:
        """The sensor's focal planes by band; () without one."""
        return () if self.sensor.radiometer is None else self.sensor.radiometer.focal_planes

    def with_planes(self, **changes: Any) -> "Bench":
        """Return the bench with settings of the focal planes of all bands replaced."""
        sensor = self.whole().mapping["sensors"][0]
        by_band = {
            band: {name: value for name, value in settings.items() if name not in changes}
            for band, settings in sensor["band_focal_plane"].items()
        }
        changed = {
            **sensor,
            "focal_plane": {**sensor["focal_plane"], **changes},
            "band_focal_plane": by_band,
        }
        return Bench({**self.mapping, "sensors": [changed]})

    def light_w_m2(self, poses: Poses) -> FloatArray:
        """Return the irradiances (n, B) at the aperture, before frame difference and wells."""
        return (
            (self.with_planes(**_ALL_LIGHT) if self.planes else self).signals(poses).irradiance_w_m2
        )

    def whole(self) -> "Bench":
        """Return the bench with all settings of its sensor written out."""
        sensors = scene_mapping(self.plan.scene)["sensors"]
        return Bench({**self.mapping, "sensors": sensors})

    def model(self, poses: Poses) -> tuple[DetectionProbability, Exposures]:
        """Return the scene's detection model for posed targets, and one look at each."""
        targets = PosedTargets.of(self.plan, poses)
        model, _ = detection_of(self.plan, targets)
        return model, self._exposures(targets, poses)

    def signals(self, poses: Poses) -> Signals:
        """Return the signals of one look; raises `ModelError` if the detection has no signals."""
        model, looks = self.model(poses)
        response = model.response(looks)
        if response is None or response.probit is None:
            raise ModelError(
                "the bench needs detection: snr; the scene's detection model has no signals"
            )
        passed = [_transmittance(model, looks, band) for band in self.sensor.bands]
        width = len(self.sensor.bands)
        chance = ndtr(response.probit)
        snr = response.snr[:, :width]
        noise = response.noise_w_m2[:, :width]
        return Signals(chance, looks.range_m, snr, noise, np.stack(passed, axis=1))

    def _exposures(self, targets: PosedTargets, poses: Poses) -> Exposures:
        count = len(poses)
        time_s = np.full(len(poses), _LOOK_S)
        sensor_m = np.asarray(self.sensor.orbit.position_ecef_m(time_s))
        way = sensor_m - targets.place_m
        range_m = length(*way.T)
        up = local_axes(targets.place_m)[:, 2]
        return Exposures(
            time_s=time_s,
            emission_time_s=time_s,
            scan=np.zeros(count, dtype=np.int64),
            sensor=np.zeros(count, dtype=np.int32),
            target=np.arange(count, dtype=np.int32),
            range_m=range_m,
            elevation_sine=(way * up).sum(axis=1) / range_m,
            target_ecef_m=targets.place_m,
            sensor_ecef_m=sensor_m,
        )


def noise_alarms_a_day(plan: Plan, unknown: float) -> FloatArray:
    """Return the expected false alarms of noise a day of each sensor; `unknown` without a rate."""
    rate = plan.detection.rate_per_scan
    if rate is None:
        return np.full(len(plan.sensors), unknown)
    period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in plan.sensors])
    return np.asarray(rate, dtype=np.float64) * DAY_S / period_s


def _transmittance(model: DetectionProbability, looks: Exposures, band: Any) -> FloatArray:
    passed = model.transmittance(looks, band)
    return np.full(len(looks), np.nan) if passed is None else passed


def _places_m(sensor_m: FloatArray, height_m: FloatArray, elevation_rad: FloatArray) -> FloatArray:
    """Return places (n, 3), ECEF, m, north of the nadir, with these elevations of the sensor."""
    radius_m = float(np.linalg.norm(sensor_m))
    share = (EARTH_EQUATORIAL_RADIUS_M + height_m) / radius_m * np.cos(elevation_rad)
    angle = np.arccos(np.minimum(share, 1.0)) - elevation_rad
    below = sensor_m / radius_m
    north = local_axes(sensor_m)[1]
    direction = np.cos(angle)[:, None] * below + np.sin(angle)[:, None] * north
    geodetic = ecef_to_geodetic(direction * EARTH_EQUATORIAL_RADIUS_M)
    return geodetic_to_ecef(geodetic.latitude_rad, geodetic.longitude_rad, height_m)


def _headings(sensor_m: FloatArray, place_m: FloatArray, aspect_rad: FloatArray) -> FloatArray:
    """Return unit vectors (n, 3) at these angles to the directions to a sensor."""
    way = sensor_m - place_m
    way /= length(*way.T)[:, None]
    across = np.cross(way, local_axes(place_m)[:, 2])
    size = length(*across.T)
    east = local_axes(place_m)[:, 0]
    across = np.where(
        size[:, None] > _LEAST_SINE, across / np.maximum(size, _LEAST_SINE)[:, None], east
    )
    return np.cos(aspect_rad)[:, None] * way + np.sin(aspect_rad)[:, None] * across
