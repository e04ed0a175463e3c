"""Geometry against ERFA and astropy: ellipsoids, sidereal time, Julian dates, the Sun, local
angles.
"""

import erfa
import numpy as np
import pytest
from astropy.coordinates import EarthLocation

from opir_core.geometry import (
    Ellipsoid,
    east_north_up_axes,
    ecef_to_geodetic,
    geodetic_to_ecef,
    gmst_rad,
    julian_date,
    sun_position_ecef_m,
    sun_position_eci_m,
    sun_position_of_date_m,
)

AU_M = 149597870700.0
LIGHT_AU_PER_DAY = 173.1446326846693
ELLIPSOIDS = {
    1: Ellipsoid(6378137.0, 1 / 298.257223563),
    2: Ellipsoid(6378137.0, 1 / 298.257222101),
}


@pytest.mark.parametrize("number", [pytest.param(1, id="WGS84"), pytest.param(2, id="GRS80")])
@pytest.mark.parametrize("distance_m", [5e6, 6.38e6, 7e6, 4.2164e7, 3.844e8])
def test_geodetic_both_ways(number, distance_m):
    directions = np.random.default_rng(1).normal(size=(2000, 3))
    position = distance_m * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    longitude, latitude, height = erfa.gc2gd(number, position)
    result = ecef_to_geodetic(position, ellipsoid=ELLIPSOIDS[number])
    # ERFA makes one of Fukushima's steps (J. Geod. 79, 2006), good to 2.3e-11 rad; what is beyond
    # it, mpmath judges.
    assert result.longitude_rad == pytest.approx(longitude, rel=0.0, abs=5e-16)
    assert result.latitude_rad == pytest.approx(latitude, rel=0.0, abs=2.5e-11)
    assert result.height_m == pytest.approx(height, rel=0.0, abs=3e-9 + 6e-16 * distance_m)
    back = geodetic_to_ecef(latitude, longitude, height, ellipsoid=ELLIPSOIDS[number])
    reference = erfa.gd2gc(number, longitude, latitude, height)
    assert back == pytest.approx(reference, rel=0.0, abs=2e-9 + 6e-16 * distance_m)


def test_astropy_earth_location():
    location = EarthLocation.from_geodetic(lon=-120.57, lat=34.73, height=1234.5)
    result = geodetic_to_ecef(np.radians(34.73), np.radians(-120.57), 1234.5)
    assert result == pytest.approx(
        [location.x.value, location.y.value, location.z.value], rel=0.0, abs=2e-9
    )


def test_local_axes_are_those_of_erfa():
    rng = np.random.default_rng(2)
    latitude = np.arcsin(rng.uniform(-1, 1, 500))
    longitude = rng.uniform(-np.pi, np.pi, 500)
    step = 1.0
    up = (
        erfa.gd2gc(1, longitude, latitude, 1e6 + step) - erfa.gd2gc(1, longitude, latitude, 1e6)
    ) / step
    axes = east_north_up_axes(latitude, longitude)
    assert axes[:, 2] == pytest.approx(up, rel=0.0, abs=3e-9)
    assert np.cross(axes[:, 0], axes[:, 1]) == pytest.approx(axes[:, 2], rel=0.0, abs=4e-16)
    assert np.all(axes[:, 0, 2] == 0.0)
    assert np.all(axes[:, 1, 2] >= 0.0)


EPOCHS = np.datetime64("1970-01-01T00:00:00", "ms") + np.random.default_rng(3).integers(
    0, 47_481 * 86_400_000, 4000
)


def two_part_julian_dates(epochs):
    day = epochs.astype("datetime64[D]")
    return 2440587.5 + day.astype(int), (epochs - day) / np.timedelta64(1, "D")


def test_epochs_span_the_stated_years():
    assert EPOCHS.min() < np.datetime64("1970-03")
    assert EPOCHS.max() > np.datetime64("2099-10")


def test_julian_date():
    day, fraction = two_part_julian_dates(EPOCHS)
    assert julian_date(EPOCHS) == pytest.approx(day + fraction, rel=0.0, abs=5e-10)
    for year in (1970, 2000, 2026, 2099):
        assert julian_date(f"{year}-12-31") == sum(erfa.cal2jd(year, 12, 31))


def test_gmst_of_1982():
    reference = erfa.gmst82(*two_part_julian_dates(EPOCHS))
    result = gmst_rad(EPOCHS)
    assert np.abs((result - reference + np.pi) % (2.0 * np.pi) - np.pi).max() < 1e-12
    assert result.min() >= 0.0
    assert result.max() < 2.0 * np.pi


def test_gmst_counts_seconds_from_the_epoch():
    seconds = np.random.default_rng(4).uniform(0.0, 30 * 86400.0, 500)
    day = np.full(500, 2440587.5 + np.datetime64("2026-04-01").astype("datetime64[D]").astype(int))
    reference = erfa.gmst82(day, 0.5 + seconds / 86400.0)
    result = gmst_rad(np.datetime64("2026-04-01T12:00:00"), seconds)
    assert np.abs((result - reference + np.pi) % (2.0 * np.pi) - np.pi).max() < 3e-11


def apparent_sun(day, fraction):
    """The unit vector to the apparent Sun in the celestial frame, and its distance, au."""
    heliocentric, barycentric = erfa.epv00(day, fraction)
    distance = np.linalg.norm(heliocentric["p"], axis=-1)
    velocity = barycentric["v"] / LIGHT_AU_PER_DAY
    slowness = np.sqrt(1.0 - np.sum(velocity**2, axis=-1))
    return erfa.ab(-heliocentric["p"] / distance[:, None], velocity, distance, slowness), distance


def apart_deg(direction, reference):
    return np.degrees(
        np.arctan2(
            np.linalg.norm(np.cross(direction, reference), axis=-1),
            np.sum(direction * reference, axis=-1),
        )
    )


def test_sun_of_date_from_1970_to_2099():
    """Dynamical time runs 69 s ahead of UTC (in 1970, 42 s)."""
    day, fraction = two_part_julian_dates(EPOCHS)
    direction, distance = apparent_sun(day, fraction + 69.184 / 86400.0)
    of_date = np.einsum("nij,nj->ni", erfa.pmat76(day, fraction + 69.184 / 86400.0), direction)
    result = sun_position_of_date_m(day + fraction)
    assert apart_deg(result, of_date).max() < 0.001
    assert np.abs(np.linalg.norm(result, axis=1) / (distance * AU_M) - 1.0).max() < 1.1e-4


def test_sun_in_ecef_from_1970_to_2099():
    day, fraction = two_part_julian_dates(EPOCHS)
    direction, _ = apparent_sun(day, fraction + 69.184 / 86400.0)
    to_earth = erfa.c2t06a(day, fraction + 69.184 / 86400.0, day, fraction, 0.0, 0.0)
    assert (
        apart_deg(sun_position_ecef_m(EPOCHS), np.einsum("nij,nj->ni", to_earth, direction)).max()
        < 0.001
    )


def test_sun_in_eci_stays_while_the_earth_turns():
    epoch = np.datetime64("2026-04-01T12:00:00")
    hours = np.arange(0.0, 25.0) * 3600.0
    in_eci = sun_position_eci_m(epoch, hours)
    in_ecef = sun_position_ecef_m(epoch, hours)
    assert in_eci[0] == pytest.approx(in_ecef[0], rel=1e-15)
    # The Sun walks 0.986 degrees a day along the ecliptic, and 15 degrees an hour in ECEF.
    assert apart_deg(in_eci[24], in_eci[0]) == pytest.approx(0.986, rel=0.0, abs=0.04)
    assert apart_deg(in_ecef[6], in_ecef[0]) == pytest.approx(89.5, rel=0.0, abs=1.0)
