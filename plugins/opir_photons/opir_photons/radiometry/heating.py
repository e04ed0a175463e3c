"""Bodies that are hot because they are fast: heat fluxes of hypersonic flow, and the temperatures
and light of surfaces that radiate what they get.

The nose gets the stagnation heat flux of Sutton and Graves, q = K √(ρ/R) v³; other parts that of
flow along a plate, laminar or turbulent by its Reynolds number (Tauber, Menees and Adelman). Both
are at most the flow of energy ρ v³/2 that meets the part. In radiative equilibrium a surface of
emissivity ε at T gets ε σ (T⁴ - T₀⁴) = q (1 - c T/H), with the total enthalpy H = c T_air + v²/2
and the temperature T₀ that it has without air. After its burn a nozzle cools by radiation to both
sides: C dT/dt = -2 ε σ T⁴. Constants, shapes and sources:
`opir_photons/data/heated_bodies.json`. A convex body shows a quarter of its surface on average over
all directions.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray, IndexArray
from opir_core.plugin import Band
from opir_photons.columns import floats
from opir_photons.laws import law
from opir_photons.radiometry.planck import STEFAN_BOLTZMANN_W_M2_K4, band_radiance


def stagnation_flux_w_m2(
    density_kg_m3: ArrayLike, speed_m_s: ArrayLike, nose_radius_m: ArrayLike
) -> FloatArray:
    """Return the heat fluxes, W/m², at the stagnation points of cold noses; arguments broadcast.

    Source: K. Sutton and R. A. Graves, NASA TR R-376 (1971); at most ρ v³/2, the free-molecular
    limit.
    """
    factor = law("heated_bodies")["stagnation_kg05_m"]
    density = floats(density_kg_m3)
    speed = floats(speed_m_s)
    flux = factor * np.sqrt(density / floats(nose_radius_m)) * speed**3
    return np.minimum(flux, 0.5 * density * speed**3)


def plate_flux_w_m2(
    density_kg_m3: ArrayLike, speed_m_s: ArrayLike, slope_rad: ArrayLike, length_m: ArrayLike
) -> FloatArray:
    """Return the heat fluxes, W/m², of flow along cold plates at running lengths; arguments
    broadcast.

    Laminar flow turns turbulent about a Reynolds number. Source: M. E. Tauber, G. P. Menees and H.
    G. Adelman, J. Aircraft 24 (1987) 594; at most ρ v³/2 times the sine of the slope.
    """
    table = law("heated_bodies")
    density = floats(density_kg_m3)
    speed = floats(speed_m_s)
    length = floats(length_m)
    sine = np.sin(slope_rad)
    shape = table["plate_factor"] * np.sqrt(np.cos(slope_rad) / length) * sine
    laminar = shape * np.sqrt(density) * speed ** table["plate_speed_power"]
    reynolds = density * speed * length / table["viscosity_pa_s"]
    share = 1.0 / (1.0 + np.square(table["transition_reynolds"] / np.maximum(reynolds, 1e-9)))
    turbulent = _turbulent_flux_w_m2(density, speed, slope_rad, length)
    flux = laminar + share * np.maximum(turbulent - laminar, 0.0)
    return np.minimum(flux, 0.5 * density * speed**3 * sine)


def _turbulent_flux_w_m2(
    density_kg_m3: FloatArray, speed_m_s: FloatArray, slope_rad: ArrayLike, length_m: FloatArray
) -> FloatArray:
    """Return the heat fluxes, W/m², of turbulent flow along cold plates."""
    table = law("heated_bodies")
    edge = table["turbulent_slow_below_m_s"]
    power = table["turbulent_speed_power"]
    slow = edge**power * (speed_m_s / edge) ** table["turbulent_slow_speed_power"]
    by_speed = np.where(speed_m_s > edge, speed_m_s**power, slow)
    shape = np.cos(slope_rad) ** table["turbulent_cosine_power"] * np.sin(slope_rad) ** 1.6
    return table["turbulent_factor"] * shape * density_kg_m3**0.8 / length_m**0.2 * by_speed


def equilibrium_temperature_k(
    flux_w_m2: ArrayLike, speed_m_s: ArrayLike, emissivity: ArrayLike, unheated_k: ArrayLike
) -> FloatArray:
    """Return the temperatures, K, of surfaces that radiate the heat fluxes of cold walls that they
    get; arguments broadcast.

    At most that at which carbon sublimes. `unheated_k` are the temperatures without air.
    """
    table = law("heated_bodies")
    heat = table["specific_heat_j_kg_k"]
    enthalpy = heat * table["air_k"] + 0.5 * np.square(floats(speed_m_s))
    # What is not emissive is not seen: a floor keeps its temperature finite.
    emitting = STEFAN_BOLTZMANN_W_M2_K4 * np.maximum(floats(emissivity), 1e-9)
    radiated = floats(flux_w_m2) / emitting
    unheated = floats(unheated_k)
    slope = radiated * heat / enthalpy
    target = unheated**4 + radiated
    # Newton's method from above: T⁴ + slope T grows and is convex, so each step stays above.
    temperature = target**0.25
    for _ in range(8):
        cube = temperature**3
        excess = cube * temperature + slope * temperature - target
        temperature = temperature - excess / (4.0 * cube + slope)
    return np.clip(temperature, unheated, np.maximum(table["limit_k"], unheated))


def cooling_nozzle_k(since_burn_s: ArrayLike) -> FloatArray:
    """Return the temperatures of nozzles at times after their burns, K: T⁻³ grows evenly."""
    table = law("heated_bodies")
    emitting = 2.0 * table["nozzle_emissivity"] * STEFAN_BOLTZMANN_W_M2_K4
    per_k3_s = 3.0 * emitting / table["nozzle_heat_j_m2_k"]
    return (table["nozzle_k"] ** -3.0 + per_k3_s * floats(since_burn_s)) ** (-1.0 / 3.0)


@frozen(eq=False)
class HeatedParts:
    """One kind of part of n bodies, columns (n,): its wetted area, m², slope, rad, running length,
    m, and share of the windward flux; noses have a radius, m, and no slope.
    """

    area_m2: FloatArray
    slope_rad: FloatArray
    length_m: FloatArray
    flux_share: FloatArray
    is_nose: bool = False

    def flux_w_m2(
        self, rows: IndexArray, density_kg_m3: FloatArray, speed_m_s: FloatArray
    ) -> FloatArray:
        """Return the heat fluxes of cold walls (m,), W/m², of bodies `rows` (m,)."""
        length_m = self.length_m[rows]
        if self.is_nose:
            return stagnation_flux_w_m2(density_kg_m3, speed_m_s, length_m)
        windward = plate_flux_w_m2(density_kg_m3, speed_m_s, self.slope_rad[rows], length_m)
        return self.flux_share[rows] * windward


@frozen(eq=False)
class HeatedBodies:
    """The surfaces of n bodies: their parts, and columns (n,) of emissivity, of the temperature
    without air, and of the nozzle, m² as seen.
    """

    parts: tuple[HeatedParts, ...]
    emissivity: FloatArray
    unheated_k: FloatArray
    nozzle_m2: FloatArray

    @classmethod
    def of(
        cls,
        profiles: Sequence[str],
        projected_m2: FloatArray,
        emissivity: FloatArray,
        unheated_k: FloatArray,
    ) -> "HeatedBodies":
        """Return the bodies of class profiles with mean projected areas (n,), m²."""
        shapes = [_shape(profile) for profile in profiles]
        count = max(len(shape["parts"]) for shape in shapes)
        flanks = [_flanks(shapes, 4.0 * projected_m2, number) for number in range(count)]
        nozzle_m2 = projected_m2 * np.array([shape["nozzle_share"] for shape in shapes])
        return cls((_noses(shapes), *flanks), emissivity, unheated_k, nozzle_m2)

    def excess_w_sr(
        self,
        bands: Sequence[Band],
        rows: IndexArray,
        density_kg_m3: FloatArray,
        speed_m_s: FloatArray,
    ) -> FloatArray:
        """Return what bodies `rows` (m,) radiate more than without air (bands, m), W/sr, as a mean
        over directions.
        """
        excess = np.zeros((len(bands), len(rows)))
        emissivity = self.emissivity[rows]
        unheated_k = self.unheated_k[rows]
        temperatures_k = [
            equilibrium_temperature_k(
                part.flux_w_m2(rows, density_kg_m3, speed_m_s), speed_m_s, emissivity, unheated_k
            )
            for part in self.parts
        ]
        for light, band in zip(excess, bands, strict=True):
            # Bands with swapped edges are empty.
            edges = (band.lower_um, max(band.lower_um, band.upper_um))
            unheated = band_radiance(unheated_k, *edges)
            for part, hot_k in zip(self.parts, temperatures_k, strict=True):
                area_m2 = 0.25 * emissivity * part.area_m2[rows]
                light += area_m2 * (band_radiance(hot_k, *edges) - unheated)
        return excess

    def nozzle_w_sr(
        self, bands: Sequence[Band], rows: IndexArray, since_burn_s: FloatArray
    ) -> FloatArray:
        """Return what the nozzles of bodies `rows` (m,) radiate at times after their burns more
        than at the bodies' temperature (bands, m), W/sr.
        """
        light = np.zeros((len(bands), len(rows)))
        hot_k = cooling_nozzle_k(since_burn_s)
        unheated_k = self.unheated_k[rows]
        area_m2 = law("heated_bodies")["nozzle_emissivity"] * self.nozzle_m2[rows]
        for glow, band in zip(light, bands, strict=True):
            edges = (band.lower_um, max(band.lower_um, band.upper_um))
            excess = band_radiance(hot_k, *edges) - band_radiance(unheated_k, *edges)
            np.multiply(area_m2, np.maximum(excess, 0.0), out=glow)
        return light


def heated_below_m() -> float:
    """Return the height, m, above which the heat of the air is left out."""
    return float(law("heated_bodies")["top_m"])


@cache
def _shape(profile: str) -> Mapping[str, Any]:
    table = law("heated_bodies")
    shape: Mapping[str, Any] = table["bodies"][table["profiles"].get(profile, "cone")]
    return shape


def _noses(shapes: Sequence[Mapping[str, Any]]) -> HeatedParts:
    """Return the noses of bodies: discs of their radius at the heat flux of the stagnation
    point.
    """
    radius_m = np.array([shape["nose_radius_m"] for shape in shapes])
    ones = np.ones_like(radius_m)
    return HeatedParts(np.pi * radius_m * radius_m, 0.0 * ones, radius_m, ones, is_nose=True)


def _flanks(shapes: Sequence[Mapping[str, Any]], wetted_m2: FloatArray, number: int) -> HeatedParts:
    """Return the parts of a number of bodies, without area where a body lacks it."""
    rows = [_part(shape["parts"], number) for shape in shapes]
    share, slope_deg, length_m, flux_share = np.array(rows).T
    return HeatedParts(wetted_m2 * share, np.radians(slope_deg), length_m, flux_share)


def _part(parts: Sequence[Mapping[str, float]], number: int) -> tuple[float, float, float, float]:
    """Return share, slope, length and share of flux of a part; of one that a body lacks, none."""
    if number >= len(parts):
        return 0.0, 0.0, 1.0, 0.0
    part = parts[number]
    return part["share"], part["slope_deg"], part["length_m"], part["flux_share"]
