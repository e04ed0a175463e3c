"""When satellites are in the Earth's shadow, and when the Sun keeps a sensor from looking at part
of its field.

Times are found by sampling and bisection (`opir_core.geometry.crossings`), to a millisecond for the
Sun and the orbit given.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.geometry import nadir_angle_rad
from opir_core.geometry.crossings import intervals_below
from opir_core.geometry.frames import Epoch
from opir_core.geometry.sun import shadow_margins_rad, sun_ecef_m
from opir_core.geometry.vectors import components, dot, floats, length, vector
from opir_core.interfaces.sensors import Orbit, Sensor

#: Longest step between samples, s. The Sun stands behind the Earth, or in a sensor's field, once in
#: a revolution, which takes over an hour; events shorter than a step are found by their extremum.
_STEP_S = 30.0


class Eclipses(NamedTuple):
    """Eclipses of a satellite by the Earth, (n,) s of scene time, in order.

    The penumbra lasts from `start_s` to `stop_s`, the umbra from `umbra_start_s` to `umbra_stop_s`,
    nan where the Sun is never wholly hidden. Times beyond the interval asked for are cut to its
    ends.
    """

    start_s: FloatArray
    umbra_start_s: FloatArray
    umbra_stop_s: FloatArray
    stop_s: FloatArray


class Outages(NamedTuple):
    """Intervals (n,) in which the Sun keeps a sensor from looking at part of its field of regard.

    `start_s` and `stop_s` are scene times. `azimuth_rad` (n, 2) is the direction of the Sun about
    nadir, clockwise from north over east, at start and stop; `nadir_angle_rad` (n,) the Sun's least
    angle from nadir, at `closest_s` (n,) to within a sample; and `share` (n,) the part of the field
    of regard, by solid angle, that is lost then.
    """

    start_s: FloatArray
    stop_s: FloatArray
    azimuth_rad: FloatArray
    closest_s: FloatArray
    nadir_angle_rad: FloatArray
    share: FloatArray


def eclipse_intervals(orbit: Orbit, epoch: Epoch, start_s: float, stop_s: float) -> Eclipses:
    """Return the eclipses of a satellite by the Earth between two scene times, s.

    `epoch` is the zero of scene time (`numpy.datetime64`, UTC). The Earth is the WGS 84 ellipsoid
    without air; shadows are those of `opir_core.geometry.sunlit_fraction`. Source: Montenbruck and
    Gill, Satellite Orbits, section 3.4.
    """
    epoch_us = _microseconds(epoch)

    def penumbra(time_s: FloatArray) -> FloatArray:
        return shadow_margins_rad(
            orbit.position_ecef_m(time_s), sun_ecef_m(time_s, epoch_us)
        ).penumbra

    def umbra(time_s: FloatArray) -> FloatArray:
        return shadow_margins_rad(orbit.position_ecef_m(time_s), sun_ecef_m(time_s, epoch_us)).umbra

    outer = intervals_below(penumbra, start_s, stop_s, step_s=_STEP_S)
    inner = intervals_below(umbra, start_s, stop_s, step_s=_STEP_S)
    umbras = np.full(outer.shape, np.nan)
    middle = 0.5 * (inner[:, 0] + inner[:, 1])
    umbras[np.searchsorted(outer[:, 1], middle)] = inner
    return Eclipses(outer[:, 0], umbras[:, 0], umbras[:, 1], outer[:, 1])


def outage_intervals(sensor: Sensor, epoch: Epoch, start_s: float, stop_s: float) -> Outages:
    """Return when the Sun keeps a sensor from looking at part of its field of regard, between two
    scene times, s.

    That is while some direction of the field is within the solar exclusion angle of the Sun's
    centre and any part of the Sun is in view of the satellite. `epoch` is the zero of scene time
    (`numpy.datetime64`, UTC).
    """
    epoch_us = _microseconds(epoch)
    outages_s = outage_times_s(sensor, epoch_us, start_s, stop_s)
    azimuth = np.stack(
        [_sun_azimuth_rad(sensor, time_s, epoch_us) for time_s in outages_s.T], axis=1
    )
    closest_s, nearest = _closest(sensor, outages_s, epoch_us)
    field = sensor.field_of_regard_half_angle_rad
    exclusion = sensor.solar_exclusion_rad
    lost = cap_overlap_sr(field, exclusion, nearest) / (4.0 * np.pi * np.sin(0.5 * field) ** 2)
    return Outages(outages_s[:, 0], outages_s[:, 1], azimuth, closest_s, nearest, lost)


def outage_times_s(
    sensor: Sensor, epoch_us: int, start_s: float, stop_s: float, *, tolerance_s: float = 1e-3
) -> FloatArray:
    """Return the starts and stops (n, 2), s, of `outage_intervals`, to within a tolerance.

    The epoch is in microseconds of UTC since 1970.
    """
    reach_rad = sensor.field_of_regard_half_angle_rad + sensor.solar_exclusion_rad

    def margin(time_s: FloatArray) -> FloatArray:
        """Return a margin (n,), rad, negative while the Sun is near the field of regard and in
        view.
        """
        position = sensor.orbit.position_ecef_m(time_s)
        sun = sun_ecef_m(time_s, epoch_us)
        clearance = nadir_angle_rad(position, sun) - reach_rad
        return np.maximum(clearance, -shadow_margins_rad(position, sun).umbra)

    if sensor.solar_exclusion_rad <= 0.0:
        return np.empty((0, 2))
    return intervals_below(margin, start_s, stop_s, step_s=_STEP_S, tolerance_s=tolerance_s)


def cap_overlap_sr(one_rad: ArrayLike, other_rad: ArrayLike, apart_rad: ArrayLike) -> FloatArray:
    """Return the solid angles (...), sr, common to two cones of directions, by half angles and the
    angle between axes.

    Arguments broadcast; half angles are above 0 and at most pi. Source: A. Tovchigrechko and I. A.
    Vakser, Protein Science 10 (2001), 1572-1583.
    """
    cap_1, cap_2, separation = np.broadcast_arrays(
        *(floats(angles) for angles in (one_rad, other_rad, apart_rad))
    )
    with np.errstate(all="ignore"):
        at_1 = _arc(cap_2, separation, cap_1)
        at_2 = _arc(cap_1, separation, cap_2)
        common = 2.0 * (
            np.pi - _arc(separation, cap_1, cap_2) - at_1 * np.cos(cap_1) - at_2 * np.cos(cap_2)
        )
    smaller = 4.0 * np.pi * np.sin(0.5 * np.minimum(cap_1, cap_2)) ** 2
    covered = 4.0 * np.pi * (np.sin(0.5 * cap_1) ** 2 + np.sin(0.5 * cap_2) ** 2 - 1.0)
    overlap = np.where(
        separation <= np.abs(cap_1 - cap_2),
        smaller,
        np.where(separation >= cap_1 + cap_2, 0.0, common),
    )
    return np.where(separation >= 2.0 * np.pi - cap_1 - cap_2, covered, overlap)


def _arc(opposite: FloatArray, side: FloatArray, base: FloatArray) -> FloatArray:
    """Return the angle of a spherical triangle between two sides, by the law of cosines."""
    # The product of sines may underflow, where the numerator is 0 too.
    sines = np.maximum(np.sin(side) * np.sin(base), 1e-300)
    cosine = (np.cos(opposite) - np.cos(side) * np.cos(base)) / sines
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def _closest(
    sensor: Sensor, intervals_s: FloatArray, epoch_us: int
) -> tuple[FloatArray, FloatArray]:
    """Return when in each interval (n, 2) the Sun is nearest to nadir, to a sample, and its angle
    from nadir, rad.
    """
    closest_s = np.empty(len(intervals_s))
    nearest = np.empty(len(intervals_s))
    for number, (start_s, stop_s) in enumerate(intervals_s.tolist()):
        time_s = np.linspace(start_s, stop_s, 2 + int((stop_s - start_s) / _STEP_S))
        angle = nadir_angle_rad(sensor.orbit.position_ecef_m(time_s), sun_ecef_m(time_s, epoch_us))
        place = int(np.argmin(angle))
        closest_s[number] = time_s[place]
        nearest[number] = angle[place]
    return closest_s, nearest


def _sun_azimuth_rad(sensor: Sensor, time_s: FloatArray, epoch_us: int) -> FloatArray:
    """Return the azimuths (n,) of the Sun about nadir, in [0, 2 pi), clockwise from north over
    east.
    """
    x, y, z = components(sensor.orbit.position_ecef_m(time_s))
    sun = sun_ecef_m(time_s, epoch_us)
    # East and north at the satellite, across the direction to the Earth's centre; over a pole, east
    # is +y.
    level = np.hypot(x, y)
    over_pole = level == 0.0
    per_level = 1.0 / np.where(over_pole, 1.0, level)
    east = vector(
        np.where(over_pole, 0.0, -y * per_level), np.where(over_pole, 1.0, x * per_level), 0.0 * z
    )
    ex, ey, _ = components(east)
    per_radius = 1.0 / length(x, y, z)
    north = vector(-ey * z * per_radius, ex * z * per_radius, (x * ey - y * ex) * per_radius)
    return np.mod(np.arctan2(dot(sun, east), dot(sun, north)), 2.0 * np.pi)


def _microseconds(epoch: Epoch) -> int:
    """Return an epoch in microseconds of UTC since 1970."""
    return int(np.asarray(epoch, dtype="datetime64[us]").astype(np.int64))
