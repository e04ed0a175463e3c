"""The continuum of particles in a plume's spectrum: soot of kerosene while afterburning feeds it, alumina
of solid motors.

Source: `opir_photons/data/propellants.json`, which gives the source and the spread of each level.
The continuum's power is a share of the jet power, spread over wavelengths as a black body times the
emissivity of the particles. It is brightest broadside, where a long body shows 4/π of its mean over
all directions.
"""

import math
from collections.abc import Mapping
from functools import cache, lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np
from attrs import frozen
from scipy.special import ndtri

from opir_core.arrays import FloatArray
from opir_photons.laws import law
from opir_photons.radiometry.planck import planck_radiance
from opir_photons.radiometry.quadrature import legendre

_TABLE = "propellants"


@frozen
class Propellant:
    """The particles of a propellant's exhaust.

    `radiated_share` of the jet power is continuum where the height's factor is 1; `depth_um` is the
    wavelength at which soot has optical depth 1, None for grey particles; `spread` is the factor,
    either way, within which levels hold.
    """

    name: str
    radiated_share: float
    temperature_k: float
    depth_um: float | None
    altitude_km: tuple[float, ...]
    altitude_scale: tuple[float, ...]
    spread: float

    def emissivity(self, wavelength_um: FloatArray) -> FloatArray:
        """Return the emissivity of the particles up to a factor: 1 - exp(-depth) of soot, 1 of grey
        particles.
        """
        if self.depth_um is None:
            return np.ones_like(wavelength_um)
        return -np.expm1(-self.depth_um / wavelength_um)


@cache
def propellants() -> Mapping[str, Propellant]:
    """Return the propellants by name; those without particles have radiated share 0."""
    return MappingProxyType(
        {name: _propellant(name, row) for name, row in law(_TABLE)["propellants"].items()}
    )


def profile_propellant(profile: str) -> str | None:
    """Return the name of the propellant of a class profile of the core, None for another
    profile.
    """
    return law(_TABLE)["profiles"].get(profile)


def jet_power_w(peaks: Mapping[str, float]) -> float:
    """Return the jet power, W, that goes with a plume's peaks by band: gases radiate a fixed share
    of it in SWIR.
    """
    return 4.0 * math.pi * peaks["SWIR"] / float(law(_TABLE)["gas_share_of_jet_power"])


def log_sigma(spread: float) -> float:
    """Return the standard deviation of ln of a level that holds within a factor, either way, as the
    table states.
    """
    return math.log(spread) / float(ndtri(0.5 + 0.5 * law(_TABLE)["spread_probability"]))


def gas_log_sigma() -> float:
    """Return the standard deviation of ln of the gases' level, in all bands at once."""
    return log_sigma(law(_TABLE)["gas_spread"])


def band_log_sigma() -> float:
    """Return the standard deviation of ln of the level of each of the gases' bands by itself."""
    return log_sigma(law(_TABLE)["band_spread"])


def continuum_w_sr(
    propellant: Propellant, power_w: float, lower_um: float, upper_um: float
) -> float:
    """Return the particles' radiant intensity in a band, W/sr, broadside, for a jet power, where it
    is brightest.
    """
    # Broadside a long body has 4/π of its mean over all directions: the mean sine of the aspect
    # angle is π/4.
    total = power_w * propellant.radiated_share / (4.0 * math.pi) * (4.0 / math.pi)
    if total <= 0.0 or upper_um <= lower_um:
        return 0.0
    return total * _band_share(propellant, lower_um, upper_um)


@lru_cache(maxsize=1024)
def _band_share(propellant: Propellant, lower_um: float, upper_um: float) -> float:
    """Return the share of the continuum's power in a band, in which it is smooth."""
    nodes, weights = legendre(48)
    half = 0.5 * (upper_um - lower_um)
    spectrum = _spectrum(propellant, lower_um + half * (1.0 + nodes))
    return float(half * np.sum(weights * spectrum)) / _total(propellant)


@lru_cache(maxsize=64)
def _total(propellant: Propellant) -> float:
    """Return the integral of the continuum's spectrum; 1e-6 of it lies beyond the limits."""
    wavelength_um = np.geomspace(0.3, 100.0, 4001)
    return float(np.trapezoid(_spectrum(propellant, wavelength_um), wavelength_um))


def _spectrum(propellant: Propellant, wavelength_um: FloatArray) -> FloatArray:
    return propellant.emissivity(wavelength_um) * planck_radiance(
        propellant.temperature_k, wavelength_um
    )


def _propellant(name: str, row: Mapping[str, Any]) -> Propellant:
    depth = row.get("optical_depth_at_4_um")
    return Propellant(
        name=name,
        radiated_share=row.get("radiated_share_of_jet_power", 0.0),
        temperature_k=row.get("temperature_k", 0.0),
        depth_um=None if depth is None else 4.0 * depth,
        altitude_km=tuple(row.get("altitude_km", (0.0,))),
        altitude_scale=tuple(row.get("altitude_scale", (0.0,))),
        spread=row["spread"],
    )
