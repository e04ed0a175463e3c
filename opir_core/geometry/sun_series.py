"""Series for the direction of the Sun: its geometric longitude, and the nutation of the Earth's
axis.

Longitude: P. Bretagnon and J.-L. Simon, Planetary Programs and Tables from -4000 to +2800
(Willmann-Bell, 1986), in the form of E. M. Reingold and N. Dershowitz, Calendrical Calculations,
function solar-longitude. Nutation: J. Meeus, Astronomical Algorithms (2nd ed., 1998), chapter 22,
the four terms of each series above 0.05 arcseconds.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np

from opir_core.arrays import FloatArray


@cache
def _longitude_terms() -> list[list[float]]:
    """Return terms of the longitude: amplitude, 1e-7 rad; phase, deg; rate, deg in a Julian
    century.
    """
    table = Path(__file__).parents[1] / "data" / "sun_longitude.json"
    terms: list[list[float]] = json.loads(table.read_text(encoding="utf-8"))["terms"]
    return terms


def geometric_longitude_rad(centuries: FloatArray) -> FloatArray:
    """Return the geometric longitude of the Sun (...), rad, from the mean equinox of date, without
    aberration.

    `centuries` are Julian centuries of dynamical time since J2000.0. From 1970 to 2099 it is good
    to 1e-5 rad against the theory of the Earth's motion in ERFA.
    """
    total = np.zeros(np.shape(centuries))
    for amplitude, phase, rate in _longitude_terms():
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
