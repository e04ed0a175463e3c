"""Flights in extended precision: the boost by quadrature, free flight under zonal gravity by
extrapolation.
"""

from functools import cache

import mpmath as mp
import numpy as np

from opir_core.flight.forces import ZonalField

LONG = np.longdouble
_ORDER = 16
_PANELS = 48


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


def boost_states(site, azimuth_rad, speed_m_s, angle_rad, profiles, elapsed_s):
    """Return positions and velocities (n, 3) of boosts in ECEF, `elapsed_s` (n,) after ignition, by
    quadrature in time.

    `site` are latitude, longitude (rad) and height (m), (n,) each; the course is that of the class
    profiles.
    """
    latitude, longitude, height = (np.asarray(v, LONG) for v in site)
    burn, start, k, exponent = (
        np.array([getattr(profile, name) for profile in profiles], LONG)
        for name in ("burn_time_s", "pitch_start_s", "speed_shape", "pitch_exponent")
    )
    azimuth, speed, elapsed = (np.asarray(v, LONG) for v in (azimuth_rad, speed_m_s, elapsed_s))
    turn = LONG(mp.nstr(mp.pi / 2, 30)) - np.asarray(angle_rad, LONG)
    half_pi = LONG(mp.nstr(mp.pi / 2, 30))
    a = LONG(6378137.0)
    f = LONG(1.0 / 298.257223563)
    e2 = f * (2 - f)
    w = 1 - e2 * np.sin(latitude) ** 2
    normal = a / np.sqrt(w)
    meridian = normal * (1 - e2) / w
    curvature = np.cos(azimuth) ** 2 / (meridian + height) + np.sin(azimuth) ** 2 / (
        normal + height
    )
    radius = 1 / curvature
    nodes, to_node = _gauss()

    def course(t):
        u = np.maximum((t - start) / (burn - start), 0)
        return speed * np.expm1(k * t / burn) / np.expm1(k), turn * np.sin(half_pi * u**exponent)

    # The turn is smooth in the fourth root of its share; the vertical part has a closed form.
    def risen(t):
        y = k * t / burn
        small = sum(y**n / LONG(mp.nstr(mp.factorial(n), 30)) for n in range(2, 24))
        return speed * burn / k * np.where(y < 2, small, np.expm1(y) - y) / np.expm1(k)

    rise = risen(np.minimum(elapsed, start))
    swept = np.zeros_like(rise)
    fraction = np.maximum((elapsed - start) / (burn - start), 0) ** LONG(0.25)
    step = fraction / _PANELS
    for panel in range(_PANELS):
        x = step * panel + step * nodes[:, None]
        t = start + (burn - start) * x**4
        v, lean = course(t)
        pace = 4 * x**3 * (burn - start) * step
        climb = to_node @ (pace * v * np.cos(lean))
        swept += (
            to_node[-1][:, None] * (pace * v * np.sin(lean) / (radius + rise + climb[:-1]))
        ).sum(axis=0)
        rise = rise + climb[-1]
    v, lean = course(elapsed)
    s = np.sin(latitude)
    c = np.cos(latitude)
    sl = np.sin(longitude)
    cl = np.cos(longitude)
    up = np.stack([c * cl, c * sl, s])
    east = np.stack([-sl, cl, 0 * sl])
    north = np.stack([-s * cl, -s * sl, c])
    heading = np.sin(azimuth) * east + np.cos(azimuth) * north
    launch = np.stack(
        [(normal + height) * c * cl, (normal + height) * c * sl, (normal * (1 - e2) + height) * s]
    )
    place = (
        launch
        + ((radius + rise) * np.cos(swept) - radius) * up
        + (radius + rise) * np.sin(swept) * heading
    )
    velocity = v * (np.cos(lean + swept) * up + np.sin(lean + swept) * heading)
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
