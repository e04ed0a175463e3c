"""opir's classes, orbits, fixes, fires and persistence against figures that others published.

Burn times: American Physical Society, Boost-Phase Intercept Systems for National Missile Defense
(2003), and National Research Council, Making Sense of Ballistic Missile Defense (2012). High
orbits: P. Podvig, russianforces.org (2024). Two bearings: L. G. Taff, MIT Lincoln Laboratory TR-741
(1986). Fires: L. Giglio et al., Remote Sensing of Environment 87 (2003) 273, as by Wang (2009); one
fire in three imagers: CIMSS Satellite Blog, archives 19261. Lightning mappers: AMS Annual Meeting
2014, paper 234359.
"""

import math

import numpy as np
import pytest
from opir_estimation.triangulation import information
from opir_photons.detection import m_of_n_probability
from opir_photons.radiometry import (
    band_radiance,
    band_transmittance,
    brightness_temperature_k,
    grey_body_intensity,
    pixel_temperature_k,
)
from opir_photons.radiometry.source_configs import FireConfig
from scipy.optimize import brentq

from opir_core.flight import boost_profile
from opir_core.orbits import MolniyaConfig, OrbitConfig, orbit_of, synchronous_semi_major_axis_m
from opir_core.plugin import Band

#: Burn times of intercontinental missiles, s: APS, and NRC.
BURN_S = {"ICBM_liquid": (250.0, 240.0), "ICBM_solid": (170.0, 180.0)}

#: Perigees and apogees of the satellites of one series, km, and their inclination, deg.
ALTITUDES_KM = ((1645.0, 38_540.0), (1840.0, 38_500.0))
INCLINATION_DEG = 63.8

#: Flaming fires that MODIS finds routinely, under very good and under ideal conditions, m².
ROUTINELY_M2, WELL_M2, IDEALLY_M2 = 1000.0, 100.0, 50.0

#: Thresholds of its algorithm: absolute by night, and over the background, K.
NIGHT_K, RISE_K = 320.0, 10.0


#: One fire near 46.9° N, 108.6° W, 15 August 2015, at 3.9 µm: longitudes of the imagers, deg, and
#: their hottest pixels, K; the last one is the saturation of its detectors.
FIRE_DEG = (46.9, -108.6)
FIRE_K = {-75.0: 329.8, -135.0: 336.5, -105.0: 341.2}

#: Pixels of 4 km from 35 786 km, rad.
IMAGER_PIXEL_RAD = 112e-6

#: A lightning mapper: false events, 1/s, in all, and flashes that its filter leaves, 1/s; pixels;
#: frames, 1/s; the time within which its events are one flash, s.
FALSE_EVENTS, FALSE_FLASHES = 40_000.0, 0.7
MAPPER_PIXELS, MAPPER_FRAMES, FLASH_S = 1372 * 1300, 500.0, 0.33


@pytest.mark.parametrize("name", BURN_S)
def test_missiles_burn_as_long_as_others_assume(name):
    seconds = boost_profile(name).burn_time_s
    for published in BURN_S[name]:
        assert seconds == pytest.approx(published, rel=0.1)


@pytest.mark.parametrize(("perigee_km", "apogee_km"), ALTITUDES_KM)
def test_satellites_of_high_orbits_turn_twice_a_day(perigee_km, apogee_km):
    semi_km = 6378.137 + 0.5 * (perigee_km + apogee_km)
    half_day_km = synchronous_semi_major_axis_m(2.0) / 1e3
    assert semi_km == pytest.approx(half_day_km, rel=0.005)


def watched(count):
    """Return the share of a day in which places north of 45° are all in view of some satellite of
    `count`, evenly spread over half a day, by straight lines of 5° elevation or more.
    """
    molniya = [
        orbit_of(
            OrbitConfig(
                molniya=MolniyaConfig(
                    apogee_lon_deg=-20.0,
                    apogee_time_s=number * 86_164.1 / count,
                    eccentricity=0.69,
                    inclination_deg=INCLINATION_DEG,
                )
            ),
            0,
        )
        for number in range(count)
    ]
    time_s = np.arange(0.0, 86_164.1, 300.0)
    latitude, longitude = (
        axis.ravel()
        for axis in np.meshgrid(np.radians([45.0, 60.0, 75.0]), np.radians(np.arange(0, 360, 15)))
    )
    up = np.stack(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ],
        axis=1,
    )
    place_m = 6.371e6 * up
    seen = np.zeros((len(time_s), len(up)), dtype=bool)
    for orbit in molniya:
        sight = orbit.position_ecef_m(time_s)[:, None, :] - place_m
        sine = np.sum(sight * up, axis=2) / np.linalg.norm(sight, axis=2)
        seen |= sine > math.sin(math.radians(5.0))
    return float(seen.all(axis=1).mean())


def test_four_high_satellites_watch_the_north_round_the_clock():
    shares = {count: watched(count) for count in (1, 2, 4)}
    assert shares[4] == 1.0
    assert shares[1] < shares[2] < 1.0


def test_the_variance_of_two_bearings_goes_as_published():
    """Across the mean line of sight and along it: σ² R⁴/(ρ² sin² θ) for two sensors at range R, a
    baseline ρ apart at an angle θ to the line of sight; the coefficient is 2 for two equal errors.
    """

    def variance_along_m2(sigma, range_m, baseline_m, angle):
        half = 0.5 * baseline_m
        places = np.array(
            [
                [math.cos(angle) * sign * half, math.sin(angle) * sign * half, 0.0]
                for sign in (1, -1)
            ]
        )
        separation = np.array([range_m, 0.0, 0.0]) - places
        ranges = np.linalg.norm(separation, axis=1)
        rows = information(separation / ranges[:, None], ranges, np.full(2, sigma))
        return np.linalg.inv(rows.sum(axis=0))[0, 0]

    for sigma, range_m, baseline_m, angle in (
        (20e-6, 3.6e7, 1e6, 0.5 * math.pi),
        (5e-6, 3.6e7, 1e6, 0.5 * math.pi),
        (20e-6, 1.8e7, 1e6, 0.5 * math.pi),
        (20e-6, 3.6e7, 2e6, 0.5 * math.pi),
        (20e-6, 3.6e7, 1e6, 0.3),
    ):
        law = 2.0 * sigma**2 * range_m**4 / (baseline_m * math.sin(angle)) ** 2
        assert variance_along_m2(sigma, range_m, baseline_m, angle) == pytest.approx(law, rel=0.01)


def fire_pixel_k(area_m2, ground_k):
    """Return the brightness temperature of a pixel of 1 km² with a default fire of an area, 3.93 to
    3.99 µm, no air.
    """
    fire = FireConfig(at=[])
    band = Band("21", 3.929, 3.989)
    edges = (band.lower_um, band.upper_um)
    shining = float(grey_body_intensity(fire.temperature_k, area_m2, fire.emissivity, *edges))
    radiance = shining / 1e6 + float(band_radiance(ground_k, *edges))
    return float(brightness_temperature_k(radiance, band))


@pytest.mark.parametrize("ground_k", [285.0, 295.0, 300.0])
def test_fires_are_found_by_size_as_modis_finds_them(ground_k):
    rises = {
        area: fire_pixel_k(area, ground_k) - ground_k
        for area in (ROUTINELY_M2, WELL_M2, IDEALLY_M2)
    }
    assert ground_k + rises[ROUTINELY_M2] > NIGHT_K > ground_k + rises[WELL_M2]
    assert rises[ROUTINELY_M2] > 3.0 * RISE_K
    # Under very good conditions: about the threshold; ideal ones: half of it, far above the noise.
    assert 0.7 * RISE_K < rises[WELL_M2] < 2.0 * RISE_K
    assert 0.3 * RISE_K < rises[IDEALLY_M2] < 1.3 * RISE_K


def seen_from(longitude_deg):
    """Return the range, m, and the elevation, rad, of a geostationary imager at the fire."""
    latitude, longitude = np.radians(FIRE_DEG)
    place = 6371.0 * np.array(
        [
            math.cos(latitude) * math.cos(longitude),
            math.cos(latitude) * math.sin(longitude),
            math.sin(latitude),
        ]
    )
    slot = math.radians(longitude_deg)
    sight = 42_164.0 * np.array([math.cos(slot), math.sin(slot), 0.0]) - place
    range_km = float(np.linalg.norm(sight))
    return range_km * 1e3, math.asin(float(sight @ place) / range_km / 6371.0)


def fire_in_imager_k(area_m2, longitude_deg, ground_k):
    """Return the temperature of a pixel with all the light of a fire of 900 K, 1 km up."""
    range_m, elevation = seen_from(longitude_deg)
    air = band_transmittance(3.8, 4.0, 1000.0, elevation, climate="midlat_summer")
    shining = grey_body_intensity(900.0, area_m2, 0.95, 3.8, 4.0) * math.sin(elevation)
    arriving = float(shining * air) / range_m**2
    return float(
        pixel_temperature_k(
            arriving, band_radiance(ground_k, 3.8, 4.0), IMAGER_PIXEL_RAD, Band("B", 3.8, 4.0)
        )
    )


@pytest.mark.parametrize("ground_k", [300.0, 310.0])
def test_one_fire_is_as_hot_in_three_imagers_as_they_saw_it(ground_k):
    """Of the size that the first one saw, it is hotter in the others in the order that they had;
    the grid of pixels, which halves or doubles the light of one, makes 8 K.
    """
    first = next(iter(FIRE_K))
    area_m2 = brentq(lambda area: fire_in_imager_k(area, first, ground_k) - FIRE_K[first], 1.0, 1e7)
    assert 1e4 < area_m2 < 1e5
    others_k = [fire_in_imager_k(area_m2, slot, ground_k) for slot in list(FIRE_K)[1:]]
    assert FIRE_K[first] + 1.0 < others_k[0] < others_k[1] - 1.0
    assert others_k == pytest.approx(list(FIRE_K.values())[1:], abs=8.0)


def test_persistence_leaves_as_few_false_flashes_as_the_filter_of_a_lightning_mapper():
    """Events of noise that repeat in a pixel while a flash lasts: how many must do so was chosen.

    Twice is far too many false flashes, four times far fewer than published.
    """
    chance = FALSE_EVENTS / (MAPPER_PIXELS * MAPPER_FRAMES)
    frames = round(FLASH_S * MAPPER_FRAMES)
    left = {
        needed: FALSE_EVENTS * float(m_of_n_probability(chance, needed - 1, frames))
        for needed in (2, 3, 4)
    }
    assert left[3] == pytest.approx(FALSE_FLASHES, rel=0.6)
    assert left[2] > 100.0 * FALSE_FLASHES
    assert left[4] < 0.01 * FALSE_FLASHES
