"""What falls through the air without power: bodies that enter it, and meteors that graze it.

Both move under gravity with J2 and drag in air that turns with the Earth. A body that enters is as
hot as radiative equilibrium with the stagnation heat flux of its nose makes it
(`opir_photons.radiometry.heating`); the air that glows around it and behind it is left out. A
grazing meteor shines with the energy of the air that it meets, ρ v³, which is 1 at perigee.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.flight import (
    Drag,
    Ephemeris,
    Forces,
    density_kg_m3,
    free_flight_ephemeris,
    impact,
    propagate,
)
from opir_core.geometry import components, ecef_to_eci_state, eci_to_ecef_state, length
from opir_core.plugin import Band, Signatures, SourceContext, Sources
from opir_photons.movers.configs import GrazerConfig, ReentryConfig
from opir_photons.movers.trajectories import moving_sources, with_headings
from opir_photons.radiometry.emitters import Emitters, emitters_of, normals
from opir_photons.radiometry.heating import equilibrium_temperature_k, stagnation_flux_w_m2
from opir_photons.radiometry.planck import grey_body_intensity
from opir_photons.radiometry.propellants import log_sigma
from opir_photons.radiometry.sources import directions, grey_w_sr, starts_m

#: How far the polynomials may be from the integrated flights, m.
_TOLERANCE_M = 0.1


@frozen(eq=False)
class HotNoseSignatures(Signatures):
    """Bodies (n,) as hot as the stagnation points of their noses, alike to all sides."""

    bands: Sequence[Band]
    emitters: Emitters
    flight: Ephemeris

    def intensity_w_sr(
        self,
        band: int,
        target: IndexArray,
        time_since_ignition_s: FloatArray,
        altitude_m: FloatArray,
        aspect_rad: FloatArray,
    ) -> FloatArray:
        """Return radiant intensities (n,), W/sr; the aspect does not matter."""
        temperature_k = self.temperature_k(target, time_since_ignition_s, altitude_m)
        area_m2 = self.emitters["area_m2"][target]
        emissivity = self.emitters["emissivity"][target]
        edges_um = (self.bands[band].lower_um, self.bands[band].upper_um)
        # Bands with swapped edges are empty.
        return np.maximum(grey_body_intensity(temperature_k, area_m2, emissivity, *edges_um), 0.0)

    def temperature_k(
        self, target: IndexArray, since_s: FloatArray, altitude_m: FloatArray
    ) -> FloatArray:
        """Return the temperatures (n,) of bodies, K."""
        speed_m_s = speeds_m_s(self.flight, target, since_s)
        density = density_kg_m3(altitude_m)
        flux = stagnation_flux_w_m2(density, speed_m_s, self.emitters["nose_radius_m"][target])
        emissivity = self.emitters["emissivity"][target]
        unheated_k = self.emitters["temperature_k"][target]
        return equilibrium_temperature_k(flux, speed_m_s, emissivity, unheated_k)

    def aspect_rad(
        self, target: IndexArray, time_s: FloatArray, to_sensor_ecef: FloatArray
    ) -> FloatArray | None:
        """Return angles (n,) that do not matter."""
        return np.zeros(len(target))


@frozen(eq=False)
class GrazerSignatures(Signatures):
    """Meteors (n,) with intensities (bands, n) at perigee, where the air has `power_w_m2` (n,),
    twice the energy that it meets them with.
    """

    peak_w_sr: FloatArray
    power_w_m2: FloatArray
    flight: Ephemeris

    def intensity_w_sr(
        self,
        band: int,
        target: IndexArray,
        time_since_ignition_s: FloatArray,
        altitude_m: FloatArray,
        aspect_rad: FloatArray,
    ) -> FloatArray:
        """Return radiant intensities (n,), W/sr; the aspect does not matter."""
        speed_m_s = speeds_m_s(self.flight, target, time_since_ignition_s)
        power = density_kg_m3(altitude_m) * speed_m_s**3
        return self.peak_w_sr[band][target] * power / self.power_w_m2[target]

    def aspect_rad(
        self, target: IndexArray, time_s: FloatArray, to_sensor_ecef: FloatArray
    ) -> FloatArray | None:
        """Return angles (n,) that do not matter."""
        return np.zeros(len(target))


def reentry_sources(config: ReentryConfig, context: SourceContext) -> Sources:
    """Return bodies that enter the air, from their places down to where they are dark, and the
    fragments that they break up into.
    """
    emitters = _placed(config, context)
    start_m = starts_m(emitters)
    way = directions(start_m, emitters["heading_deg"], emitters["descent_deg"])
    velocity_m_s = way * emitters["speed_m_s"][:, None]
    lowest_m = np.full(len(emitters), config.lowest_m)
    if config.fragments:
        lowest_m[:] = config.break_up_m
        whole, end_s = falls(emitters, start_m, velocity_m_s, lowest_m)
        pieces, bodies = _fragments(config, context, emitters, end_s)
        place_m, place_m_s = whole.state(bodies, pieces["start_s"])
        emitters = _joined(emitters, pieces)
        start_m = np.concatenate([start_m, place_m])
        velocity_m_s = np.concatenate([velocity_m_s, place_m_s])
        lowest_m = np.concatenate([lowest_m, np.full(len(pieces), config.lowest_m)])
    flight, end_s = falls(emitters, start_m, velocity_m_s, lowest_m)
    signatures = HotNoseSignatures(context.bands, emitters, flight)
    return moving_sources("re-entry", "other", emitters, context, flight, end_s, signatures)


def _fragments(
    config: ReentryConfig, context: SourceContext, emitters: Emitters, end_s: FloatArray
) -> tuple[Emitters, IntArray]:
    """Return the fragments (m,) of bodies (n,) that break up at times (n,) within the scene, and
    their bodies (m,).

    They have equal masses and the body's shape: of N, each is N^(-1/3) as large.
    """
    body = np.repeat(np.flatnonzero(end_s < emitters["end_s"]), config.fragments)
    size = config.fragments ** (-1.0 / 3.0)
    spread = np.exp(log_sigma(config.fragment_spread) * normals(context, "fragments", len(body)))
    columns = {name: column[body] for name, column in emitters.columns.items()}
    columns["start_s"] = end_s[body]
    columns["height_m"] = np.full(len(body), config.break_up_m)
    columns["ballistic_coefficient_kg_m2"] *= size * spread
    columns["area_m2"] *= size**2
    columns["nose_radius_m"] *= size
    return Emitters(columns), body


def _joined(first: Emitters, second: Emitters) -> Emitters:
    """Return the emitters of both."""
    names = first.columns
    return Emitters({name: np.concatenate([first[name], second[name]]) for name in names})


def falls(
    emitters: Emitters, start_m: FloatArray, velocity_m_s: FloatArray, lowest_m: ArrayLike
) -> tuple[Ephemeris, FloatArray]:
    """Return the ephemeris of falls from places and velocities (n, 3), ECEF, down to heights, m,
    and the times (n,) at which they end.
    """
    forces = Forces(drag=Drag(ballistic_coefficient_kg_m2=emitters["ballistic_coefficient_kg_m2"]))
    states = ecef_to_eci_state(start_m, velocity_m_s, np.zeros(len(emitters)))
    within_s = np.maximum(emitters["end_s"] - emitters["start_s"], 1.0)
    fall_s, _ = impact(*states, lowest_m, forces, within_s=within_s)
    end_s = emitters["start_s"] + np.maximum(np.where(np.isnan(fall_s), within_s, fall_s), 1e-3)
    return _flight(start_m, velocity_m_s, emitters["start_s"], end_s, forces), end_s


def grazer_sources(config: GrazerConfig, context: SourceContext) -> Sources:
    """Return meteors that graze the air, from before their perigee to after it."""
    emitters = _placed(config, context)
    perigee_m = starts_m(emitters)
    way = directions(perigee_m, emitters["heading_deg"], np.zeros(len(emitters)))
    speed_m_s = emitters["speed_m_s"]
    half_s = 0.5 * emitters["shining_s"]
    states = ecef_to_eci_state(perigee_m, way * speed_m_s[:, None], np.zeros(len(emitters)))
    forces = Forces()
    first_m, first_m_s = propagate(*states, -half_s, forces)
    begin_m, begin_m_s = eci_to_ecef_state(first_m, first_m_s, -half_s)
    start_s = emitters["start_s"]
    end_s = np.minimum(start_s + 2.0 * half_s, np.maximum(emitters["end_s"], start_s + 1e-3))
    flight = _flight(begin_m, begin_m_s, start_s, end_s, forces)
    power = density_kg_m3(emitters["height_m"]) * speed_m_s**3
    signatures = GrazerSignatures(grey_w_sr(emitters, context), power, flight)
    return moving_sources("earth grazer", "bolide", emitters, context, flight, end_s, signatures)


def _placed(config: ReentryConfig | GrazerConfig, context: SourceContext) -> Emitters:
    return with_headings(emitters_of(config, context, is_brief=True), context)


def speeds_m_s(flight: Ephemeris, target: IndexArray, since_s: FloatArray) -> FloatArray:
    """Return speeds (n,) over the Earth, m/s, at times since flights began, at most their
    lengths.
    """
    start_s = flight.start_s[target]
    time_s = np.clip(start_s + since_s, start_s, flight.end_s[target])
    return length(*components(flight.state(target, time_s)[1]))


def _flight(
    position_m: FloatArray,
    velocity_m_s: FloatArray,
    start_s: FloatArray,
    end_s: FloatArray,
    forces: Forces,
) -> Ephemeris:
    """Return the ephemeris of falls from states (n, 3), ECEF, at times (n,) to others."""
    states = ecef_to_eci_state(position_m, velocity_m_s, start_s)
    return free_flight_ephemeris(start_s, end_s, *states, forces=forces, tolerance_m=_TOLERANCE_M)
