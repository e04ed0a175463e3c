"""States in the frames that ephemerides are written in, to ECEF, and frames frozen at an epoch.

Polar motion is left out and UTC taken for UT1, as everywhere in opir: the first is below 0.6
arcseconds, the second below 0.9 s of the Earth's rotation.
"""

import re

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import dot, east_north_up_axes, ecef_to_geodetic
from opir_readers.celestial_frames import (
    ARCSECOND_RAD,
    centuries_since_j2000,
    ecef_state,
    nutation_rad,
    turned,
)
from opir_readers.published import published

#: The names for messages.
FRAME_NAMES = "ITRF, TDR, GRC, GTOD, TIRS, TEME, TOD, MOD, CIRS, EME2000, J2000, GCRF, ICRF"

#: Names of realisations, with a year or a number: ITRF-2014, DTRF2014, ICRF3.
_REALISATION = re.compile(r"(ITRF|DTRF|ICRF|GCRF)[- ]?\d+")


def frame_of(name: str) -> str:
    """Return the frame of a name, "" for an unknown one.

    >>> frame_of("ITRF-2014"), frame_of("TOD_EARTH")
    ('ITRF', 'TOD')
    """
    capitals = _capitals(name)
    realisation = _REALISATION.fullmatch(capitals)
    bare = realisation[1] if realisation else capitals
    frames = published("frames").items()
    return next((frame for frame, names in frames if frame != "source" and bare in names), "")


def _capitals(name: str) -> str:
    return name.upper().removesuffix("_EARTH")


def is_of_epoch(name: str) -> bool:
    """Whether a name is that of axes which are frozen at an epoch, and need one."""
    capitals = _capitals(name)
    return capitals.endswith("OFEPOCH") or capitals in ("TOE", "MOE")


def to_ecef(
    frame: str,
    position_m: FloatArray,
    velocity_m_s: FloatArray,
    epoch_us: int,
    time_s: FloatArray,
    frame_s: float | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return ECEF positions and velocities over the Earth (n, 3) of states in a frame that
    `frame_of` returns.

    Times (n,) are scene times, the epoch microseconds of UTC since 1970. `frame_s` is the scene
    time at which axes of date are frozen (REF_FRAME_EPOCH); None for axes of each state's own date.
    """
    if frame_s is not None and frame not in ("ITRF", "EME2000"):
        axes, equinox = (axes_of(name, epoch_us, frame_s) for name in (frame, "EME2000"))
        # Rows are the axes in ECEF at that time: from the frozen axes to those of J2000.
        turn = dot(axes[:, None], equinox)
        position_m = along_axes(position_m, turn)
        velocity_m_s = along_axes(velocity_m_s, turn)
        frame = "EME2000"
    if frame in ("TOD", "CIRS"):
        centuries = centuries_since_j2000(epoch_us, time_s)
        angle = _equinoxes_rad(centuries) if frame == "TOD" else _origin_rad(centuries)
        position_m = turned(position_m, [("z", angle)])
        velocity_m_s = turned(velocity_m_s, [("z", angle)])
        frame = "TEME"
    return ecef_state(frame, position_m, velocity_m_s, epoch_us, time_s)


def along_axes(vectors: FloatArray, axes: FloatArray) -> FloatArray:
    """Return vectors (n, 3) of components along axes, (3, 3) or of each vector (n, 3, 3)."""
    return (vectors[:, :, None] * axes).sum(axis=1)


def lengths(vectors: FloatArray) -> FloatArray:
    """Return the lengths (n,) of vectors (n, 3)."""
    return np.sqrt(dot(vectors, vectors))


def axes_at(position_m: FloatArray) -> FloatArray:
    """Return the axes (n, 3, 3) towards east, north and up at positions (n, 3), as rows in ECEF."""
    where = ecef_to_geodetic(position_m)
    return east_north_up_axes(where.latitude_rad, where.longitude_rad)


def axes_of(frame: str, epoch_us: int, time_s: float) -> FloatArray:
    """Return the axes (3, 3) of a frame at a time, as rows in ECEF."""
    return to_ecef(frame, np.eye(3), np.zeros((3, 3)), epoch_us, np.full(3, time_s))[0]


def _equinoxes_rad(centuries: FloatArray) -> FloatArray:
    """Return the lead of the true equinox over the mean one along the equator, rad."""
    longitude, obliquity, _ = nutation_rad(centuries)
    return longitude * np.cos(obliquity)


def _origin_rad(centuries: FloatArray) -> FloatArray:
    """Return the lead of the Earth's rotation angle over mean sidereal time, rad (Capitaine et al.,
    2003).
    """
    lead = 0.014506 + (4612.156534 + 1.3915817 * centuries) * centuries
    return -lead * ARCSECOND_RAD
