"""The motion of a satellite over the rotating Earth by SGP4, from its mean elements.

SGP4 gives positions in TEME, the true equator and mean equinox of date. Turning them by Greenwich
mean sidereal time of 1982 gives the pseudo-Earth-fixed frame (Vallado, Crawford, Hujsak and Kelso,
AIAA 2006-6753, appendix C), which stands in for ECEF: polar motion is ignored and UTC taken for
UT1. The first is below 0.6 arcseconds, 20 m at the Earth's surface and 120 m at geostationary
distance; the second below 0.9 s of the Earth's rotation, 420 m and 2.8 km. SGP4 itself errs by
about 1 km at the epoch of the elements and 1 to 3 km a day from there.
"""

import math
from collections.abc import Mapping
from datetime import datetime, timedelta
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import field, frozen

from opir_core.arrays import FloatArray
from opir_core.errors import ModelError, PluginError, install_command
from opir_core.geometry import gmst_rad
from opir_core.orbits.mean_elements import OMM_NUMBERS, omm_epoch, omm_number

if TYPE_CHECKING:
    from sgp4.api import Satrec

_US_PER_DAY = 86_400_000_000
_UNIX_JULIAN_DATE = 2440587.5


@frozen(eq=False)
class Sgp4Motion:
    """The motion of an `sgp4.api.Satrec` from a scene epoch, in microseconds of UTC since 1970.

    `ModelError` for a time without a result of SGP4 (the satellite has decayed).
    """

    satellite: "Satrec"
    epoch_us: int
    name: str = "the satellite"
    _gmst_rad: float = field(init=False)
    _gmst_rate_rad_s: float = field(init=False)

    @_gmst_rad.default
    def _gmst_at_epoch(self) -> float:
        return float(gmst_rad(np.datetime64(self.epoch_us, "us")))

    @_gmst_rate_rad_s.default
    def _gmst_rate_at_epoch(self) -> float:
        """Return the rate of sidereal time; its error grows to 5e-12 rad in a month."""
        day_s = 86400.0
        later_rad = float(gmst_rad(np.datetime64(self.epoch_us, "us"), day_s))
        return (2.0 * math.pi + (later_rad - self._gmst_rad) % (2.0 * math.pi)) / day_s

    @property
    def age_days(self) -> float:
        """Return how much later than the elements' epoch the scene's is, days."""
        day = self.epoch_us / _US_PER_DAY + _UNIX_JULIAN_DATE
        return float(day - self.satellite.jdsatepoch - self.satellite.jdsatepochF)

    def position_teme_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) in TEME at scene times (n,)."""
        days, rest_us = divmod(self.epoch_us, _US_PER_DAY)
        fraction = (rest_us * 1e-6 + time_s) / 86400.0
        code, position_km, _ = self.satellite.sgp4_array(
            np.full(len(time_s), _UNIX_JULIAN_DATE + days), fraction
        )
        if code.any():
            row = int(np.argmax(code != 0))
            reason = _sgp4().SGP4_ERRORS[int(code[row])]
            raise ModelError(f"SGP4 has no position for {self.name} at {time_s[row]} s: {reason}")
        if not np.isfinite(position_km).all():
            row = int(np.argmin(np.isfinite(position_km).all(axis=1)))
            raise ModelError(
                f"SGP4 gives no number for {self.name} at {time_s[row]} s; are its elements whole?"
            )
        return np.asarray(position_km * 1e3, dtype=np.float64)

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) in the pseudo-Earth-fixed frame."""
        x, y, z = self.position_teme_m(time_s).T
        angle_rad = self._gmst_rad + self._gmst_rate_rad_s * time_s
        cosine = np.cos(angle_rad)
        sine = np.sin(angle_rad)
        return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=1)

    def state_ecef(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and their rates of change, m/s, (n, 3) in the pseudo-Earth-fixed
        frame.
        """
        # SGP4's own velocities differ from the rates of its positions by up to 4 m/s. Truncation
        # (1e-7 m/s in a low orbit) and rounding (1e-6 m/s) of finite differences are negligible.
        step_s = 4.0
        p0, p1, p3, p4 = (self.position_ecef_m(time_s + k * step_s) for k in (-2.0, -1.0, 1.0, 2.0))
        velocity = (8.0 * (p3 - p1) - (p4 - p0)) / (12.0 * step_s)
        return self.position_ecef_m(time_s), velocity


def satellite_of_tle(lines: tuple[str, str]) -> "Satrec":
    """Return the `Satrec` of a TLE; raises `PluginError` where the package sgp4 is not
    installed.
    """
    sgp4 = _sgp4()
    return sgp4.Satrec.twoline2rv(lines[0], lines[1], sgp4.WGS72)


def satellite_of_omm(omm: Mapping[str, Any]) -> "Satrec":
    """Return the `Satrec` of an OMM; raises `PluginError` where the package sgp4 is not installed.

    Units are those of the OMM (degrees, turns a day); SGP4 does not use the derivatives of the mean
    motion.
    """
    sgp4 = _sgp4()
    numbers = {name: omm_number(omm[name]) for name in OMM_NUMBERS}
    degrees = (
        numbers[name]
        for name in ("ARG_OF_PERICENTER", "INCLINATION", "MEAN_ANOMALY", "RA_OF_ASC_NODE")
    )
    perigee_rad, inclination_rad, anomaly_rad, node_rad = (
        angle / 180.0 * np.pi for angle in degrees
    )
    satellite = sgp4.Satrec()
    # The epoch from which SGP4 counts days.
    satellite.sgp4init(
        sgp4.WGS72,
        "i",
        0,  # the number of the satellite, which the theory does not use
        (omm_epoch(omm["EPOCH"]) - datetime(1949, 12, 31)) / timedelta(days=1),
        numbers["BSTAR"],
        0.0,
        0.0,
        numbers["ECCENTRICITY"],
        perigee_rad,
        inclination_rad,
        anomaly_rad,
        numbers["MEAN_MOTION"] / 720.0 * np.pi,
        node_rad,
    )
    return satellite


def _sgp4() -> Any:
    """Return the module `sgp4.api`; published elements belong to its gravity constants WGS72."""
    try:
        return import_module("sgp4.api")
    except ImportError as error:
        remedy = install_command("opir-core", "sgp4")
        raise PluginError(
            f"an orbit from a TLE or an OMM needs the package sgp4; {remedy}"
        ) from error
