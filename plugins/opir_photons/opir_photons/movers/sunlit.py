"""Balloons and satellites: the sunlight that they reflect, as diffuse spheres, and their own
warmth.

Above most of the air the Sun's light is whole; in the Earth's shadow there is none.
"""

from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IndexArray
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight import Ephemeris, Forces, free_flight_ephemeris
from opir_core.geometry import (
    angle_between_rad,
    components,
    dot,
    ecef_to_eci,
    is_sunlit,
    length,
    sun_ecef_m,
)
from opir_core.plugin import Signatures, SourceContext, Sources
from opir_photons.movers.configs import BalloonConfig, SatelliteConfig
from opir_photons.movers.courses import flight_of, legs_of
from opir_photons.movers.trajectories import moving_sources, with_headings
from opir_photons.radiometry.emitters import Emitters, emitters_of
from opir_photons.radiometry.sources import (
    EmitterSources,
    by_band,
    directions,
    grey_w_sr,
    starts_m,
)
from opir_photons.radiometry.sunlight import lambert_sphere_intensity, solar_irradiance


@frozen(eq=False)
class SunlitSignatures(Signatures):
    """Diffuse spheres (n,): their own intensities (bands, n), W/sr, and `reflecting_m2` (n,) of
    sunlight (bands,), W/m².
    """

    own_w_sr: FloatArray
    sunlight_w_m2: FloatArray
    reflecting_m2: FloatArray
    flight: Ephemeris
    epoch_us: int

    def intensity_w_sr(
        self,
        band: int,
        target: IndexArray,
        time_since_ignition_s: FloatArray,
        altitude_m: FloatArray,
        aspect_rad: FloatArray,
    ) -> FloatArray:
        """Return radiant intensities (n,), W/sr; `aspect_rad` is the phase angle of the Sun."""
        reflecting = self.reflecting_m2[target]
        reflected = lambert_sphere_intensity(self.sunlight_w_m2[band], reflecting, aspect_rad)
        return self.own_w_sr[band][target] + reflected

    def aspect_rad(
        self, target: IndexArray, time_s: FloatArray, to_sensor_ecef: FloatArray
    ) -> FloatArray | None:
        """Return phase angles (n,), rad: pi, of no light, in the Earth's shadow."""
        position_m = self.flight.position_m(target, time_s)
        sun_m = sun_ecef_m(time_s, self.epoch_us)
        phase = angle_between_rad(sun_m - position_m, to_sensor_ecef)
        return np.where(is_sunlit(position_m, sun_m), phase, np.pi)


def balloon_sources(config: BalloonConfig, context: SourceContext) -> Sources:
    """Return balloons that drift with the wind."""
    emitters = with_headings(emitters_of(config, context), context)
    flight = flight_of(legs_of(emitters, (), 1.0, emitters["end_s"], context.path))
    return _sunlit("balloon", emitters, context, flight)


def satellite_sources(config: SatelliteConfig, context: SourceContext) -> Sources:
    """Return satellites on circular orbits through their places, under J2."""
    emitters = with_headings(emitters_of(config, context), context)
    start_s = emitters["start_s"]
    position_m = starts_m(emitters)
    level = directions(position_m, emitters["heading_deg"], np.zeros(len(emitters)))
    inertial_m = ecef_to_eci(position_m, start_s)
    radius_m = length(*components(position_m))
    speed_m_s = np.sqrt(EARTH_MU_M3_S2 / radius_m)
    # Level is across the radius here, not along the ellipsoid: the orbit is a circle.
    outwards = inertial_m / radius_m[:, None]
    way = ecef_to_eci(level, start_s)
    way = way - dot(way, outwards)[:, None] * outwards
    velocity_m_s = way * (speed_m_s / length(*components(way)))[:, None]
    end_s = np.maximum(emitters["end_s"], start_s + 1e-3)
    flight = free_flight_ephemeris(start_s, end_s, inertial_m, velocity_m_s, forces=Forces())
    return _sunlit("satellite", emitters, context, flight)


def _sunlit(
    kind: str, emitters: Emitters, context: SourceContext, flight: Ephemeris
) -> EmitterSources:
    """Return spheres of a kind in the sunlight on an ephemeris."""
    signatures = SunlitSignatures(**sunlit(emitters, context, flight))
    end_s = emitters["end_s"]
    sources = moving_sources(kind, "other", emitters, context, flight, end_s, signatures)
    return EmitterSources(tuple(sources.ids), sources.trajectories, signatures)


def sunlit(emitters: Emitters, context: SourceContext, flight: Ephemeris) -> dict[str, Any]:
    """Return the columns of `SunlitSignatures` of spheres on an ephemeris."""
    light = [solar_irradiance(band.lower_um, band.upper_um)[None] for band in context.bands]
    return {
        "own_w_sr": grey_w_sr(emitters, context),
        "sunlight_w_m2": by_band(light, 1)[:, 0],
        "reflecting_m2": emitters["area_m2"] * emitters["albedo"],
        "flight": flight,
        "epoch_us": context.epoch_us,
    }
