"""States in the frames of ephemerides, of date or frozen at an epoch, against astropy's, with UT1
as UTC.
"""

import erfa
import numpy as np
import pytest
from astropy import units
from astropy.coordinates import (
    CIRS,
    GCRS,
    ITRS,
    TEME,
    TETE,
    CartesianDifferential,
    CartesianRepresentation,
    EarthLocation,
)
from astropy.time import Time
from astropy.utils import iers
from opir_readers.frames import frame_of, is_of_epoch, to_ecef

EPOCH = Time("2026-04-01T12:00:00", scale="utc")
EPOCH_US = round(EPOCH.unix * 1e6)
OFFSETS_S = np.array([0.0, 30.0, 3600.0, 86400.0])
PLACE_M = np.array(
    [[-5600e3, -2600e3, 2900e3], [7e6, 1e5, -2e5], [1e6, -4.1e7, 3e6], [2e7, 2e7, 1e7]]
)
VELOCITY_M_S = np.array(
    [
        [1500.0, -5200.0, 2600.0],
        [10.0, 7500.0, 30.0],
        [3000.0, 100.0, -50.0],
        [-1000.0, 1200.0, 900.0],
    ]
)


@pytest.fixture(autouse=True)
def rotation_by_utc():
    """Take UT1 for UTC and leave polar motion out, as opir does."""
    with iers.earth_orientation_table.set(_Flat()):
        yield


class _Flat(iers.IERS_B):
    """Earth orientation of a uniformly rotating Earth."""

    def __init__(self):
        pass

    def ut1_utc(self, jd1, jd2=0.0, return_status=False):
        zero = np.zeros(np.shape(jd1)) * units.s
        return (zero, np.zeros(np.shape(jd1), int)) if return_status else zero

    def pm_xy(self, jd1, jd2=0.0, return_status=False):
        zero = np.zeros(np.shape(jd1)) * units.arcsec
        return (zero, zero, np.zeros(np.shape(jd1), int)) if return_status else (zero, zero)

    def dcip_xy(self, jd1, jd2=0.0, return_status=False):
        return self.pm_xy(jd1, jd2, return_status)


def theirs(frame):
    times = EPOCH + OFFSETS_S * units.s
    rates = CartesianDifferential(VELOCITY_M_S.T * units.m / units.s)
    states = CartesianRepresentation(PLACE_M.T * units.m, differentials=rates)
    kinds = {"TEME": TEME(states, obstime=times), "EME2000": GCRS(states, obstime=times)}
    position = EarthLocation.from_geocentric(0, 0, 0, unit=units.m)
    kinds["TOD"] = TETE(states, obstime=times, location=position)
    kinds["CIRS"] = CIRS(states, obstime=times, location=position)
    # The mean axes of date, by erfa's precession of 1976, which that of J2000 is in.
    turns = [erfa.pmat76(2400000.5, mjd) for mjd in times.tt.mjd]
    mean = (
        np.array([turn.T @ vector for turn, vector in zip(turns, rows, strict=True)]).T
        for rows in (PLACE_M, VELOCITY_M_S)
    )
    place, rate = (
        axis * unit for axis, unit in zip(mean, (units.m, units.m / units.s), strict=True)
    )
    equinox = CartesianRepresentation(*place, differentials=CartesianDifferential(*rate))
    kinds["MOD"] = GCRS(equinox, obstime=times)
    result = kinds[frame].transform_to(ITRS(obstime=times))
    return result.cartesian.xyz.to_value(units.m).T, result.velocity.d_xyz.to_value(
        units.m / units.s
    ).T


# Omitted terms of nutation and the frame bias: 0.06 arcseconds, at each distance.
@pytest.mark.parametrize(
    ("frame", "arcseconds"),
    [("TEME", 0.01), ("EME2000", 0.1), ("TOD", 0.1), ("MOD", 0.1), ("CIRS", 0.1)],
)
def test_states_are_those_of_astropy(frame, arcseconds):
    place, velocity = to_ecef(frame, PLACE_M, VELOCITY_M_S, EPOCH_US, OFFSETS_S)
    other, rate = theirs(frame)
    limit = np.linalg.norm(PLACE_M, axis=1) * np.radians(arcseconds / 3600.0)
    assert (np.linalg.norm(place - other, axis=1) < limit).all(), (
        np.linalg.norm(place - other, axis=1) - limit
    )
    np.testing.assert_allclose(velocity, rate, rtol=0.0, atol=0.02)


@pytest.mark.parametrize("frame", ["TEME", "TOD", "MOD"])
def test_frozen_axes_are_those_of_date_at_their_epoch_and_do_not_turn_with_precession(frame):
    at_s = 3600.0
    frozen, _ = to_ecef(frame, PLACE_M, VELOCITY_M_S, EPOCH_US, np.full(4, at_s), at_s)
    of_date, _ = to_ecef(frame, PLACE_M, VELOCITY_M_S, EPOCH_US, np.full(4, at_s))
    np.testing.assert_allclose(frozen, of_date, rtol=0.0, atol=1e-6)
    # Thirty years later the equinox has gone 25 arcminutes: the axes of date with it, frozen ones
    # not.
    year_s = 30 * 365.25 * 86400.0
    early, _ = to_ecef(frame, PLACE_M, VELOCITY_M_S, EPOCH_US, np.zeros(4), -year_s)
    date, _ = to_ecef(frame, PLACE_M, VELOCITY_M_S, EPOCH_US, np.zeros(4))
    angle = np.linalg.norm(early - date, axis=1) / np.linalg.norm(PLACE_M, axis=1)
    assert np.degrees(angle).max() == pytest.approx(30 * 50.3 / 3600.0, rel=0.1)


def test_names_of_frames():
    known = ["ITRF", "itrf-2014", "ITRF2000", "EFG", "J2000", "ICRF", "gcrf", "TOD", "TEME", "RSW"]
    assert [frame_of(name) for name in known] == [
        *["ITRF"] * 4,
        *["EME2000"] * 3,
        "TOD",
        "TEME",
        "",
    ]
    others = [
        "DTRF2014",
        "WGS84",
        "TIRS",
        "ICRF3",
        "GCRF2",
        "TOD_EARTH",
        "MOD_Earth",
        "TEMEofDate",
        "CIRS",
        "TOD_MOON",
    ]
    assert [frame_of(name) for name in others] == [
        *["ITRF"] * 3,
        *["EME2000"] * 2,
        "TOD",
        "MOD",
        "TEME",
        "CIRS",
        "",
    ]
    assert [is_of_epoch(name) for name in ("TEMEOFEPOCH", "MOE_EARTH", "MOD", "TOD")] == [
        True,
        True,
        False,
        False,
    ]
