"""Sources that are no targets: fires, gas flares, sun glints and bolides, as emitters with a
spectrum.

They pass through the same atmosphere, aperture and threshold as plumes.

Sun glint (`opir_photons.radiometry.sea_surface`): the radiant intensity over an area A is A ρ E p /
(4 cos⁴ β) with the tilt β of the facets, the density of slopes p = exp(-tan² β / σ²) / (π σ²), the
in-band irradiance E of the Sun at the surface and Fresnel's reflectance ρ at the Sun's zenith
angle.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import ByteArray, FloatArray, IndexArray
from opir_core.geometry import (
    components,
    dot,
    geodetic_to_ecef,
    length,
    local_axes,
    sun_ecef_m,
)
from opir_core.plugin import (
    EMITTER_TYPES,
    Paths,
    Signatures,
    SourceContext,
    Sources,
    Trajectories,
    Transmittance,
)
from opir_photons.radiometry.emitters import Emitters, emitters_of
from opir_photons.radiometry.planck import grey_body_intensity
from opir_photons.radiometry.sea_surface import reflectance, slope_density, slope_variance
from opir_photons.radiometry.source_configs import (
    BolideConfig,
    FireConfig,
    FlareConfig,
    GlintConfig,
)
from opir_photons.radiometry.sunlight import solar_irradiance


@frozen(eq=False)
class GlintSignatures(Signatures):
    """Patches of water (n,) under the Sun: `sunlight_w_m2` (bands, n) is normal irradiance above
    the air.
    """

    sunlight_w_m2: FloatArray
    area_m2: FloatArray
    ignition_s: FloatArray
    height_m: FloatArray
    position_ecef_m: FloatArray
    up_ecef: FloatArray
    slope_variance: float
    refractive_index: float
    epoch_us: int
    sky: Transmittance | None

    def intensity_w_sr(
        self,
        band: int,
        target: IndexArray,
        time_since_ignition_s: FloatArray,
        altitude_m: FloatArray,
        aspect_rad: FloatArray,
    ) -> FloatArray:
        """Return radiant intensities (n,) at the surface, W/sr; `aspect_rad` is the tilt of the
        facets that glint.
        """
        time_s = self.ignition_s[target] + time_since_ignition_s
        sine = dot(self._to_sun(target, time_s), self.up_ecef[target])
        air = self._sun_transmittance(band, target, time_s, sine)
        light = self.area_m2[target] * (self.sunlight_w_m2[band][target] * air)
        mirrored = light * reflectance(np.maximum(sine, 0.0), self.refractive_index)
        intensity = mirrored * 0.25 * slope_density(aspect_rad, self.slope_variance)
        return np.where(sine > 0.0, intensity, 0.0)

    def aspect_rad(
        self, target: IndexArray, time_s: FloatArray, to_sensor_ecef: FloatArray
    ) -> FloatArray | None:
        """Return the tilts (n,) of the facets that mirror the Sun to the sensors, in [0, pi]."""
        half = self._to_sun(target, time_s) + to_sensor_ecef
        size = length(*components(half))
        cosine = dot(half, self.up_ecef[target]) / np.where(size > 0.0, size, np.inf)
        return np.arccos(np.clip(cosine, -1.0, 1.0))

    def _to_sun(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        offset = sun_ecef_m(time_s, self.epoch_us) - self.position_ecef_m[target]
        return offset / length(*components(offset))[:, None]

    def _sun_transmittance(
        self, band: int, target: IndexArray, time_s: FloatArray, sine: FloatArray
    ) -> FloatArray:
        """Return the transmittance from the Sun to the surface; 1 without an atmosphere."""
        if self.sky is None:
            return np.ones(len(target))
        sun = sun_ecef_m(time_s, self.epoch_us)
        path = Paths(self.height_m[target], sine, self.position_ecef_m[target], sun, time_s)
        return self.sky.transmittance(band, path)


def glint_signatures(
    config: GlintConfig, emitters: Emitters, position_ecef_m: FloatArray, context: SourceContext
) -> GlintSignatures:
    """Return the signatures of patches of water at positions (n, 3)."""
    sun_k = emitters["temperature_k"]
    light = [
        solar_irradiance(band.lower_um, band.upper_um, sun_k) * emitters["emissivity"]
        for band in context.bands
    ]
    return GlintSignatures(
        sunlight_w_m2=by_band(light, len(emitters)),
        area_m2=emitters["area_m2"],
        ignition_s=emitters["start_s"],
        height_m=emitters["height_m"],
        position_ecef_m=position_ecef_m,
        up_ecef=local_axes(position_ecef_m)[:, 2],
        slope_variance=slope_variance(config.wind_m_s),
        refractive_index=config.refractive_index,
        epoch_us=context.epoch_us,
        sky=context.make_atmosphere() if context.make_atmosphere else None,
    )


@frozen(eq=False)
class StraightTrajectories(Trajectories):
    """Emitters that stand still or move straight: at `start_ecef_m` (n, 3) from `ignition_s` on."""

    type_code: ByteArray
    ignition_s: FloatArray
    burnout_s: FloatArray
    start_ecef_m: FloatArray
    velocity_ecef_m_s: FloatArray
    emitters_truth: tuple[Mapping[str, Any], ...]

    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (m, 3) of emitters (m,) at scene times (m,); nan when they do not
        shine.
        """
        since_s = time_s - self.ignition_s[target]
        shines = (since_s >= 0.0) & (time_s <= self.burnout_s[target])
        since_s = np.where(shines, since_s, np.nan)
        return self.start_ecef_m[target] + since_s[:, None] * self.velocity_ecef_m_s[target]

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return the truth of each source, its kind and start, as plain values."""
        return self.emitters_truth


@frozen(eq=False)
class GreySignatures(Signatures):
    """Grey bodies: intensities (bands, n); flat ones by how their area turns to the sensor, brief
    ones with a flash.

    `up_ecef` (n, 3) is the vertical of a flat body, and None where all shine alike to all sides.
    `flash_s` (n,) is how long a flash lasts, sin² in time, and None where brightness does not
    change.
    """

    peak_w_sr: FloatArray
    up_ecef: FloatArray | None = None
    flash_s: FloatArray | None = None

    def intensity_w_sr(
        self,
        band: int,
        target: IndexArray,
        time_since_ignition_s: FloatArray,
        altitude_m: FloatArray,
        aspect_rad: FloatArray,
    ) -> FloatArray:
        """Return radiant intensities (n,) at the source, W/sr; `aspect_rad` is from the
        vertical.
        """
        intensity: FloatArray = self.peak_w_sr[band][target]
        if self.up_ecef is not None:
            intensity = intensity * np.maximum(np.cos(aspect_rad), 0.0)
        if self.flash_s is not None:
            share = np.clip(time_since_ignition_s / self.flash_s[target], 0.0, 1.0)
            intensity = intensity * np.square(np.sin(np.pi * share))
        return intensity

    def aspect_rad(
        self, target: IndexArray, time_s: FloatArray, to_sensor_ecef: FloatArray
    ) -> FloatArray | None:
        """Return the angles (n,) between the vertical and the sensor; 0 where all directions are
        alike.
        """
        if self.up_ecef is None:
            return np.zeros(len(target))
        return np.arccos(np.clip(dot(self.up_ecef[target], to_sensor_ecef), -1.0, 1.0))


@frozen(eq=False)
class EmitterSources(Sources):
    """The emitters of a block of sources."""

    ids: tuple[str, ...]
    trajectories: Trajectories
    signatures: Signatures


def fire_sources(config: FireConfig, context: SourceContext) -> Sources:
    """Return fires: flat grey bodies on the ground."""
    emitters = emitters_of(config, context)
    trajectories = _standing("fire", emitters, context)
    up = local_axes(trajectories.start_ecef_m)[:, 2]
    signatures = GreySignatures(grey_w_sr(emitters, context), up_ecef=up)
    return _sources(trajectories, signatures)


def flare_sources(config: FlareConfig, context: SourceContext) -> Sources:
    """Return gas flares: grey bodies that shine alike to all sides."""
    emitters = emitters_of(config, context)
    signatures = GreySignatures(grey_w_sr(emitters, context))
    return _sources(_standing("flare", emitters, context), signatures)


def glint_sources(config: GlintConfig, context: SourceContext) -> Sources:
    """Return glints: water that mirrors the Sun."""
    emitters = emitters_of(config, context)
    trajectories = _standing("glint", emitters, context)
    signatures = glint_signatures(config, emitters, trajectories.start_ecef_m, context)
    return _sources(trajectories, signatures)


def bolide_sources(config: BolideConfig, context: SourceContext) -> Sources:
    """Return bolides: flashes that move straight down through the air."""
    emitters = emitters_of(config, context, is_brief=True)
    start_m = starts_m(emitters)
    way = directions(start_m, emitters["heading_deg"], emitters["descent_deg"])
    velocity_m_s = way * emitters["speed_m_s"][:, None]
    trajectories = _trajectories("bolide", emitters, context, start_m, velocity_m_s)
    signatures = GreySignatures(grey_w_sr(emitters, context), flash_s=emitters["flash_s"])
    return _sources(trajectories, signatures)


def directions(
    position_m: FloatArray, heading_deg: FloatArray, descent_deg: FloatArray
) -> FloatArray:
    """Return unit vectors (n, 3), ECEF, at positions (n, 3), by heading and descent."""
    axes = local_axes(position_m)
    descent = np.radians(descent_deg)
    heading = np.radians(heading_deg)
    level = np.cos(descent)
    east = (level * np.sin(heading))[:, None]
    north = (level * np.cos(heading))[:, None]
    up = -np.sin(descent)[:, None]
    return east * axes[:, 0] + north * axes[:, 1] + up * axes[:, 2]


def _sources(trajectories: StraightTrajectories, signatures: Signatures) -> Sources:
    ids = tuple(str(truth["id"]) for truth in trajectories.emitters_truth)
    return EmitterSources(ids, trajectories, signatures)


def starts_m(emitters: Emitters) -> FloatArray:
    """Return the places (n, 3) of emitters, ECEF, m."""
    return geodetic_to_ecef(
        np.radians(emitters["lat_deg"]), np.radians(emitters["lon_deg"]), emitters["height_m"]
    )


def _standing(kind: str, emitters: Emitters, context: SourceContext) -> StraightTrajectories:
    start_m = starts_m(emitters)
    return _trajectories(kind, emitters, context, start_m, np.zeros_like(start_m))


def _trajectories(
    kind: str,
    emitters: Emitters,
    context: SourceContext,
    start_m: FloatArray,
    velocity_m_s: FloatArray,
) -> StraightTrajectories:
    end_s = emitters["end_s"]
    if "flash_s" in emitters.columns:
        end_s = np.minimum(end_s, emitters["start_s"] + emitters["flash_s"])
    return StraightTrajectories(
        type_code=np.full(len(emitters), EMITTER_TYPES.index(kind), dtype=np.uint8),
        ignition_s=emitters["start_s"],
        burnout_s=np.maximum(end_s, emitters["start_s"]),
        start_ecef_m=start_m,
        velocity_ecef_m_s=velocity_m_s,
        emitters_truth=truth_of(kind, emitters, context.id),
    )


def truth_of(kind: str, emitters: Emitters, block: str) -> tuple[Mapping[str, Any], ...]:
    """Return the truth of each emitter of a block, as plain values."""
    names = tuple(emitters.columns)
    rows = zip(*(emitters[name].tolist() for name in names), strict=True)
    return tuple(
        {"id": f"{block}-{number}", "type": kind, **dict(zip(names, row, strict=True))}
        for number, row in enumerate(rows, start=1)
    )


def grey_w_sr(emitters: Emitters, context: SourceContext) -> FloatArray:
    """Return intensities (bands, n) of the whole area."""
    bodies = (emitters["temperature_k"], emitters["area_m2"], emitters["emissivity"])
    intensities = [
        grey_body_intensity(*bodies, band.lower_um, band.upper_um) for band in context.bands
    ]
    return by_band(intensities, len(emitters))


def by_band(rows: Sequence[FloatArray], count: int) -> FloatArray:
    """Return columns (bands, count), at least 0: bands with swapped edges are empty."""
    return np.maximum(np.array(rows, dtype=np.float64).reshape(len(rows), count), 0.0)
