"""Flights in extended precision: the boost by quadrature, free flight under zonal gravity by
extrapolation.
"""

from functools import cache
from typing import NamedTuple

import mpmath as mp
import numpy as np

from opir_core.flight.forces import ZonalField

LONG = np.longdouble
_ORDER = 16
_PANELS = 48
HALF_PI = LONG(mp.nstr(mp.pi / 2, 30))


@cache
def _gauss():
    """Return nodes and weights on [0, 1], and the matrix of integrals from 0 to each node, in
    extended precision.
    """
    with mp.workdps(40):
        nodes = [
            (1 + mp.findroot(lambda x: mp.legendre(_ORDER, x), float(x))) / 2
            for x in np.polynomial.legendre.leggauss(_ORDER)[0]
        ]
        powers = mp.matrix(_ORDER, _ORDER)
        for row, node in enumerate(nodes):
            for power in range(_ORDER):
                powers[row, power] = node**power
        inverse = powers**-1
        to_node = mp.matrix(_ORDER + 1, _ORDER)
        for row, end in enumerate([*nodes, mp.mpf(1)]):
            for column in range(_ORDER):
                to_node[row, column] = mp.fsum(
                    inverse[power, column] * end ** (power + 1) / (power + 1)
                    for power in range(_ORDER)
                )
        long = np.array(
            [[LONG(mp.nstr(to_node[r, c], 30)) for c in range(_ORDER)] for r in range(_ORDER + 1)]
        )
        return np.array([LONG(mp.nstr(node, 30)) for node in nodes]), long


class Course(NamedTuple):
    """Courses (n,) of class profiles in extended precision: burn and start of the pitch, s, shapes
    of speed and pitch, final speed, m/s, and final lean off the vertical, rad.
    """

    burn_s: np.ndarray
    start_s: np.ndarray
    shape: np.ndarray
    exponent: np.ndarray
    speed_m_s: np.ndarray
    turn_rad: np.ndarray

    @classmethod
    def of(cls, profiles, speed_m_s, angle_rad):
        """Return the courses of profiles with final speeds and flight path angles."""
        columns = (
            np.array([getattr(profile, name) for profile in profiles], LONG)
            for name in ("burn_time_s", "pitch_start_s", "speed_shape", "pitch_exponent")
        )
        return cls(*columns, np.asarray(speed_m_s, LONG), HALF_PI - np.asarray(angle_rad, LONG))

    def at(self, time_s):
        """Return speeds and leans at times."""
        share = np.maximum((time_s - self.start_s) / (self.burn_s - self.start_s), 0)
        growth = np.expm1(self.shape * time_s / self.burn_s) / np.expm1(self.shape)
        return self.speed_m_s * growth, self.turn_rad * np.sin(HALF_PI * share**self.exponent)

    def risen_m(self, time_s):
        """Return heights of the vertical part: its closed form."""
        y = self.shape * time_s / self.burn_s
        small = sum(y**n / LONG(mp.nstr(mp.factorial(n), 30)) for n in range(2, 24))
        high = np.where(y < 2, small, np.expm1(y) - y)
        return self.speed_m_s * self.burn_s / self.shape * high / np.expm1(self.shape)

    def way(self, radius_m, elapsed_s):
        """Return heights, m, and angles over the Earth, rad, by quadrature in the fourth root of
        the share of the turn, in which it is smooth.
        """
        nodes, to_node = _gauss()
        rise = self.risen_m(np.minimum(elapsed_s, self.start_s))
        swept = np.zeros_like(rise)
        turn_s = self.burn_s - self.start_s
        step = np.maximum((elapsed_s - self.start_s) / turn_s, 0) ** LONG(0.25) / _PANELS
        for panel in range(_PANELS):
            root = step * panel + step * nodes[:, None]
            speed, lean = self.at(self.start_s + turn_s * root**4)
            pace = 4 * root**3 * turn_s * step
            climb = to_node @ (pace * speed * np.cos(lean))
            sweep = pace * speed * np.sin(lean) / (radius_m + rise + climb[:-1])
            swept += (to_node[-1][:, None] * sweep).sum(axis=0)
            rise = rise + climb[-1]
        return rise, swept


def boost_states(site, azimuth_rad, speed_m_s, angle_rad, profiles, elapsed_s):
    """Return positions and velocities (n, 3) of boosts in ECEF, `elapsed_s` (n,) after ignition, by
    quadrature in time.

    `site` are latitude, longitude (rad) and height (m), (n,) each; the course is that of the class
    profiles.
    """
    latitude, longitude, height = (np.asarray(column, LONG) for column in site)
    azimuth = np.asarray(azimuth_rad, LONG)
    elapsed = np.asarray(elapsed_s, LONG)
    course = Course.of(profiles, speed_m_s, angle_rad)
    flattening = LONG(1.0 / 298.257223563)
    e2 = flattening * (2 - flattening)
    sine = np.sin(latitude)
    cosine = np.cos(latitude)
    root = 1 - e2 * sine**2
    normal = LONG(6378137.0) / np.sqrt(root)
    meridian = normal * (1 - e2) / root + height
    radius = 1 / (np.cos(azimuth) ** 2 / meridian + np.sin(azimuth) ** 2 / (normal + height))
    rise, swept = course.way(radius, elapsed)
    speed, lean = course.at(elapsed)
    outward = np.stack([np.cos(longitude), np.sin(longitude), 0 * longitude])
    pole = np.array([[0], [0], [1]], LONG)
    up = cosine * outward + sine * pole
    east = np.stack([-np.sin(longitude), np.cos(longitude), 0 * longitude])
    heading = np.sin(azimuth) * east + np.cos(azimuth) * (cosine * pole - sine * outward)
    launch = (normal + height) * cosine * outward + (normal * (1 - e2) + height) * sine * pole
    arm = radius + rise
    place = launch + (arm * np.cos(swept) - radius) * up + arm * np.sin(swept) * heading
    velocity = speed * (np.cos(lean + swept) * up + np.sin(lean + swept) * heading)
    return place.T, velocity.T


def zonal_acceleration(position, names):
    """Return accelerations (3, n) of the zonal field: the gradient of its potential, by Legendre
    polynomials.
    """
    field = ZonalField()
    x, y, z = position
    r = np.sqrt(x * x + y * y + z * z)
    s = z / r
    mu = LONG(field.mu_m3_s2)
    ratio = LONG(field.radius_m) / r
    radial = -mu / (r * r)
    along = np.zeros_like(r)
    previous = np.ones_like(s)
    current = s
    slope_before = np.zeros_like(s)
    slope = np.ones_like(s)
    for degree in range(2, 5):
        slope_before, slope = slope, slope_before + (2 * degree - 1) * current
        previous, current = (
            current,
            ((2 * degree - 1) * s * current - (degree - 1) * previous) / degree,
        )
        if f"j{degree}" in names:
            size = mu / (r * r) * LONG(getattr(field, f"j{degree}")) * ratio**degree
            radial = radial + size * (degree + 1) * current
            along = along - size * slope
    # The gradient of sin(latitude) has the length cos(latitude) / r: along is per cosine squared.
    return np.stack(
        [
            radial * x / r - along * s * x / r,
            radial * y / r - along * s * y / r,
            radial * s + along * (1 - s * s),
        ]
    )


def propagated(position_m, velocity_m_s, duration_s, names, steps=64):
    """Return positions and velocities (n, 3) after durations (n,), by Gragg-Bulirsch-Stoer
    extrapolation.
    """
    state = np.concatenate([np.asarray(position_m, LONG).T, np.asarray(velocity_m_s, LONG).T])
    step = np.asarray(duration_s, LONG) / steps

    def rate(at):
        return np.concatenate([at[3:], zonal_acceleration(at[:3], names)])

    sequence = [2 * n for n in range(1, 9)]
    for _ in range(steps):
        table = []
        for count in sequence:
            h = step / count
            k1 = state
            two = state + h * rate(state)
            for _ in range(count - 1):
                k1, two = two, k1 + 2 * h * rate(two)
            row = [(k1 + two + h * rate(two)) / 2]
            for column in range(len(table)):
                factor = (LONG(count) / sequence[len(table) - 1 - column]) ** 2 - 1
                row.append(row[column] + (row[column] - table[-1][column]) / factor)
            table.append(row)
        state = table[-1][-1]
    return state[:3].T, state[3:].T
