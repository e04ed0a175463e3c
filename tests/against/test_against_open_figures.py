"""opir's classes, orbits, fixes and fires against figures that others published.

Burn times: American Physical Society, Boost-Phase Intercept Systems for National Missile Defense
(2003), and National Research Council, Making Sense of Ballistic Missile Defense (2012). High
orbits: P. Podvig, russianforces.org (2024). Two bearings: L. G. Taff, MIT Lincoln Laboratory TR-741
(1986). Fires: L. Giglio et al., Remote Sensing of Environment 87 (2003) 273, as by Wang (2009).
"""

import math

import numpy as np
import pytest
from opir_estimation.triangulation import information
from opir_photons.radiometry import (
    band_radiance,
    brightness_temperature_k,
    grey_body_intensity,
)
from opir_photons.radiometry.source_configs import FireConfig

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
