"""States in the frames that ephemerides are written in, to ECEF, and frames frozen at an epoch.

Polar motion is left out and UTC taken for UT1, as everywhere in opir: the first is below 0.6
arcseconds, the second below 0.9 s of the Earth's rotation.
"""

import re

import numpy as np

from opir_core.arrays import FloatArray
from opir_readers.celestial_frames import ecef_state, nutation_rad

#: What ephemerides call the frames, in capitals and without `_EARTH`, and what they are here. ICRF
#: and GCRF differ from EME2000 by 0.02 arcseconds. Names as those of the SANA registry of CCSDS,
#: and those of STK.
FRAMES = {
    **dict.fromkeys(
        ("ITRF", "DTRF", "TDR", "GRC", "GTOD", "EFG", "ECEF", "FIXED", "TIRS", "WGS84"), "ITRF"
    ),
    **dict.fromkeys(("EME2000", "J2000", "GCRF", "GCRS", "ICRF", "INERTIAL"), "EME2000"),
    **dict.fromkeys(("TEME", "TEMEOFDATE", "TEMEOFEPOCH"), "TEME"),
    **dict.fromkeys(("TOD", "TRUEOFDATE", "TOE", "TRUEOFEPOCH"), "TOD"),
    **dict.fromkeys(("MOD", "MEANOFDATE", "MOE", "MEANOFEPOCH"), "MOD"),
    "CIRS": "CIRS",
}

#: The names for messages.
FRAME_NAMES = (
    "ITRF",
    "TDR",
    "GRC",
    "GTOD",
    "TIRS",
    "TEME",
    "TOD",
    "MOD",
    "CIRS",
    "EME2000",
    "J2000",
    "GCRF",
    "ICRF",
)

#: Names of realisations, with a year or a number: ITRF-2014, DTRF2014, ICRF3.
_REALISATION = re.compile(r"(ITRF|DTRF|ICRF|GCRF)[- ]?\d+")

_J2000_UNIX_S = 946_728_000.0
_CENTURY_S = 36525.0 * 86400.0
_TT_LESS_UTC_S = 69.184
_ARCSECOND = np.pi / 648_000.0


def frame_of(name: str) -> str:
    """Return the frame of a name, "" for one that is not known.

    >>> frame_of("ITRF-2014"), frame_of("TOD_EARTH")
    ('ITRF', 'TOD')
    """
    capitals = name.upper().removesuffix("_EARTH")
    realisation = _REALISATION.fullmatch(capitals)
    return FRAMES.get(realisation[1] if realisation else capitals, "")


def is_of_epoch(name: str) -> bool:
    """Return whether a name is that of axes which are frozen at an epoch, and need one."""
    capitals = name.upper().removesuffix("_EARTH")
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
        own, equinox = (_matrix(name, epoch_us, frame_s) for name in (frame, "EME2000"))
        # Rows of a matrix are the axes in ECEF at that time: from the frozen axes to those of
        # J2000.
        turn = (own[:, None, :] * equinox[None, :, :]).sum(axis=2)
        position_m, velocity_m_s = (_times(vectors, turn) for vectors in (position_m, velocity_m_s))
        frame = "EME2000"
    if frame in ("TOD", "CIRS"):
        centuries = (epoch_us * 1e-6 + time_s + _TT_LESS_UTC_S - _J2000_UNIX_S) / _CENTURY_S
        angle = _equinoxes_rad(centuries) if frame == "TOD" else _origin_rad(centuries)
        position_m, velocity_m_s = (
            _about_z(vectors, angle) for vectors in (position_m, velocity_m_s)
        )
        frame = "TEME"
    return ecef_state(frame, position_m, velocity_m_s, epoch_us, time_s)


def _matrix(frame: str, epoch_us: int, time_s: float) -> FloatArray:
    """Return the axes (3, 3) of a frame at a time, as rows in ECEF."""
    return to_ecef(frame, np.eye(3), np.zeros((3, 3)), epoch_us, np.full(3, time_s))[0]


def _times(vectors: FloatArray, turn: FloatArray) -> FloatArray:
    return np.asarray((vectors[:, :, None] * turn[None, :, :]).sum(axis=1))


def _equinoxes_rad(centuries: FloatArray) -> FloatArray:
    """Return by how much the true equinox is ahead of the mean one along the equator, rad."""
    longitude, obliquity, _ = nutation_rad(centuries)
    return np.asarray(longitude * np.cos(obliquity))


def _origin_rad(centuries: FloatArray) -> FloatArray:
    """Return by how much the Earth's rotation angle is ahead of mean sidereal time, rad (Capitaine
    et al., 2003).
    """
    return np.asarray(-(0.014506 + (4612.156534 + 1.3915817 * centuries) * centuries) * _ARCSECOND)


def _about_z(vectors: FloatArray, angle_rad: FloatArray) -> FloatArray:
    cosine = np.cos(angle_rad)
    sine = np.sin(angle_rad)
    x, y, z = vectors.T
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=1)
