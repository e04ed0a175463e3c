"""The whole chain of a look: from elements, a launch point and a plume to ranges, irradiance, P_d
and detection.

A satellite on a circular orbit looks at a target in free flight. Every number on the way is
computed with the functions of opir one after the other, as the engine does, and in 40 digits.
"""

import mpmath as mp
import numpy as np
import opir_photons.detection as detection
import opir_photons.radiometry as radiometry

import opir_core.flight as flight
import opir_core.geometry as geometry
import opir_core.orbits as orbits
from exact_cases import draws
from exact_cases.detection import cumulative, tail
from exact_cases.flight import MU, orbital_position
from exact_cases.geometry import OMEGA, axes, azimuth_elevation_range, ecef, fixed, inertial_state
from exact_cases.measure import Case, less, norm, plus, times
from exact_cases.radiometry import band
from exact_cases.two_body import exact_end
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2, SPEED_OF_LIGHT_M_S

#: Fixed points of the light time: each leaves v/c of the error before.
_PASSES = 4
_LOOKS = 8


def _satellite_m(altitude_km, inclination_deg, node_deg, latitude_deg, time_s):
    """Return positions (n, 3), ECEF, of satellites on circular orbits."""
    states = [
        orbits.circular_elements(
            1e3 * a, *(float(np.radians(v)) for v in remainder)
        ).perigee_state_eci()
        for a, *remainder in zip(
            altitude_km.tolist(),
            inclination_deg.tolist(),
            node_deg.tolist(),
            (0.0 * latitude_deg).tolist(),
            strict=True,
        )
    ]
    place, speed = (np.array(column) for column in zip(*states, strict=True))
    radius = EARTH_EQUATORIAL_RADIUS_M + 1e3 * altitude_km
    along_s = np.radians(latitude_deg) / (np.sqrt(EARTH_MU_M3_S2 / radius) / radius)
    return geometry.eci_to_ecef(flight.propagate_kepler(place, speed, time_s + along_s)[0], time_s)


def chain(
    latitude,
    longitude,
    height,
    east,
    north,
    up,
    epoch_s,
    altitude,
    tilt,
    node,
    along,
    later,
    kelvin,
    area,
    nei,
    threshold,
):
    """Return position, range and elevation of the target, irradiance, ln P_d and the probability of
    8 looks.
    """
    start = geometry.geodetic_to_ecef(latitude, longitude, height)
    rows = geometry.east_north_up_axes(latitude, longitude)
    velocity = east[:, None] * rows[:, 0] + north[:, None] * rows[:, 1] + up[:, None] * rows[:, 2]
    state = geometry.ecef_to_eci_state(start, velocity, epoch_s)
    look_s = epoch_s + later
    sensor = _satellite_m(altitude, tilt, node, along, look_s)
    delay = np.zeros_like(later)
    for _ in range(_PASSES):
        target = geometry.eci_to_ecef(
            flight.propagate_kepler(*state, later - delay)[0], look_s - delay
        )
        _, elevation, range_m = geometry.azimuth_elevation_range(target, sensor)
        delay = range_m / SPEED_OF_LIGHT_M_S
    intensity = area * radiometry.band_radiance(kelvin, 2.5, 3.0)
    irradiance = radiometry.irradiance_at_aperture(intensity, range_m)
    snr = irradiance / nei
    chance = detection.probability_of_detection(snr, threshold)
    return (
        target,
        range_m,
        elevation,
        irradiance,
        chance,
        detection.cumulative_probability(chance, _LOOKS),
    )


def exact_chain(
    latitude,
    longitude,
    height,
    east,
    north,
    up,
    epoch_s,
    altitude,
    tilt,
    node,
    along,
    later,
    kelvin,
    area,
    nei,
    threshold,
):
    rows = axes(latitude, longitude)
    velocity = plus(plus(times(east, rows[0]), rows[1], north), rows[2], up)
    start, speed = inertial_state(ecef(latitude, longitude, height), velocity, epoch_s)
    look = epoch_s + later
    sensor = orbital_position(altitude, tilt, node, along, look)
    delay = mp.mpf(0)
    for _ in range(_PASSES + 1):
        target = fixed(exact_end([*start, *speed, later - delay, MU])[0], look - delay)
        delay = norm(less(sensor, target)) / mp.mpf(SPEED_OF_LIGHT_M_S)
    _, elevation, distance = azimuth_elevation_range(target, sensor)
    irradiance = area * band(kelvin, mp.mpf(2.5), mp.mpf(3)) / distance**2
    chance = tail(threshold - irradiance / nei)
    return target, distance, elevation, irradiance, chance, cumulative(chance, _LOOKS)


def scenes(rng, n):
    """Return scenes: burnouts anywhere, satellites from 300 km to geostationary, looks at once to
    in ten years.
    """
    columns = (
        draws.latitudes(rng, n),
        draws.angles(rng, n),
        rng.uniform(6e4, 3e5, n),
        *(rng.normal(scale=2e3, size=n) for _ in range(3)),
        draws.log_uniform(rng, n, 1e-3, 3e8, (0.0,)),
        rng.choice([300.0, 1400.0, 35786.0], n) * rng.uniform(0.99, 1.01, n),
        rng.choice([0.0, 63.4, 98.0], n),
        rng.uniform(-180.0, 180.0, n),
        rng.uniform(0.0, 360.0, n),
        rng.uniform(1.0, 600.0, n),
        rng.uniform(600.0, 2500.0, n),
        draws.log_uniform(rng, n, 0.1, 1e3),
    )
    threshold = rng.uniform(3.0, 7.0, n)
    received = chain(*columns, np.ones(n), threshold)[3]
    # Signals from a tenth of the threshold to twice it: P_d from 1e-12 to almost 1.
    return (*columns, received / (threshold * draws.log_uniform(rng, n, 0.1, 2.0)), threshold)


def turned(*row):
    """Return the angle by which ECI and ECEF differ at the look: a rotation rounds it, whatever is
    rotated back.
    """
    return OMEGA * (row[6] + row[11])


CASES = (
    Case(
        "chain: geometry, light time, irradiance, P_d",
        scenes,
        chain,
        exact_chain,
        samples=4,
        digits=50,
        inner=turned,
    ),
)
