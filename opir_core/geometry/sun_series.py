"""Series for the direction of the Sun: its geometric longitude, and the nutation of the Earth's
axis.

Longitude: P. Bretagnon and J.-L. Simon, Planetary Programs and Tables from -4000 to +2800
(Willmann-Bell, 1986), in the form of E. M. Reingold and N. Dershowitz, Calendrical Calculations,
function solar-longitude. Nutation: J. Meeus, Astronomical Algorithms (2nd ed., 1998), chapter 22,
the four terms of each series above 0.05 arcseconds.
"""

import numpy as np

from opir_core.arrays import FloatArray

#: Terms of the longitude: amplitude, 1e-7 rad; phase, deg; rate, deg in a Julian century.
_LONGITUDE = (
    (403406.0, 270.54861, 0.9287892),
    (195207.0, 340.19128, 35999.1376958),
    (119433.0, 63.91854, 35999.4089666),
    (112392.0, 331.26220, 35998.7287385),
    (3891.0, 317.843, 71998.20261),
    (2819.0, 86.631, 71998.4403),
    (1721.0, 240.052, 36000.35726),
    (660.0, 310.26, 71997.4812),
    (350.0, 247.23, 32964.4678),
    (334.0, 260.87, -19.4410),
    (314.0, 297.82, 445267.1117),
    (268.0, 343.14, 45036.8840),
    (242.0, 166.79, 3.1008),
    (234.0, 81.53, 22518.4434),
    (158.0, 3.50, -19.9739),
    (132.0, 132.75, 65928.9345),
    (129.0, 182.95, 9038.0293),
    (114.0, 162.03, 3034.7684),
    (99.0, 29.8, 33718.148),
    (93.0, 266.4, 3034.448),
    (86.0, 249.2, -2280.773),
    (78.0, 157.6, 29929.992),
    (72.0, 257.8, 31556.493),
    (68.0, 185.1, 149.588),
    (64.0, 69.9, 9037.750),
    (46.0, 8.0, 107997.405),
    (38.0, 197.1, -4444.176),
    (37.0, 250.4, 151.771),
    (32.0, 65.3, 67555.316),
    (29.0, 162.7, 31556.080),
    (28.0, 341.5, -4561.540),
    (27.0, 291.6, 107996.706),
    (27.0, 98.5, 1221.655),
    (25.0, 146.7, 62894.167),
    (24.0, 110.0, 31437.369),
    (21.0, 5.2, 14578.298),
    (21.0, 342.6, -31931.757),
    (20.0, 230.9, 34777.243),
    (18.0, 256.1, 1221.999),
    (17.0, 45.3, 62894.511),
    (14.0, 242.9, -4442.039),
    (13.0, 115.2, 107997.909),
    (13.0, 151.8, 119.066),
    (13.0, 285.3, 16859.071),
    (12.0, 53.3, -4.578),
    (10.0, 126.6, 26895.292),
    (10.0, 205.7, -39.127),
    (10.0, 85.9, 12297.536),
    (10.0, 146.1, 90073.778),
)


def geometric_longitude_rad(centuries: FloatArray) -> FloatArray:
    """Return the geometric longitude of the Sun (...), rad, from the mean equinox of date, without
    aberration.

    `centuries` are Julian centuries of dynamical time since J2000.0. From 1970 to 2099 it is good
    to 1e-5 rad against the theory of the Earth's motion in ERFA.
    """
    total = np.zeros(np.shape(centuries))
    for amplitude, phase, rate in _LONGITUDE:
        total = total + amplitude * np.sin(np.radians(phase + rate * centuries))
    return np.radians(282.7771834 + 36000.76953744 * centuries) + 1e-7 * total


def nutation_rad(centuries: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the nutations in longitude and in obliquity (...), rad, to 2.4e-6 and 5e-7 rad."""
    node = np.radians(125.04452 - 1934.136261 * centuries)
    sun = np.radians(2.0 * (280.4665 + 36000.7698 * centuries))
    moon = np.radians(2.0 * (218.3165 + 481267.8813 * centuries))
    longitude = (
        -17.20 * np.sin(node) - 1.32 * np.sin(sun) - 0.23 * np.sin(moon) + 0.21 * np.sin(2.0 * node)
    )
    obliquity = (
        9.20 * np.cos(node) + 0.57 * np.cos(sun) + 0.10 * np.cos(moon) - 0.09 * np.cos(2.0 * node)
    )
    return np.radians(longitude / 3600.0), np.radians(obliquity / 3600.0)
