"""The density of the air against the U.S. Standard Atmosphere, 1976: other programs below 86 km,
its table above.
"""

import json

import numpy as np
import pytest
from repository import DATA

from opir_core.flight.atmosphere_density import density_kg_m3

CASES = json.loads((DATA / "reference_cases.json").read_text(encoding="utf-8"))["cases"]
CASE = next(case for case in CASES if case["id"] == "us76_table")

#: Geometric height, km, and density, kg/m³: the standard (NASA-TM-X-74335), table I; every height
#: given to four digits.
UPPER = {
    86: 6.958e-6,
    90: 3.416e-6,
    95: 1.393e-6,
    100: 5.604e-7,
    105: 2.325e-7,
    110: 9.708e-8,
    115: 4.289e-8,
    120: 2.222e-8,
    130: 8.152e-9,
    140: 3.831e-9,
    150: 2.076e-9,
    160: 1.233e-9,
    180: 5.194e-10,
    200: 2.541e-10,
    250: 6.073e-11,
    300: 1.916e-11,
    350: 7.014e-12,
    400: 2.803e-12,
    450: 1.184e-12,
    500: 5.215e-13,
    600: 1.137e-13,
    700: 3.070e-14,
    800: 1.136e-14,
    900: 5.759e-15,
    1000: 3.561e-15,
}


def test_table_to_80_km():
    rows = CASE["expected"]["rows"]
    result = density_kg_m3([row["z_km"] * 1e3 for row in rows])
    np.testing.assert_allclose(result, [row["rho_kg_m3"] for row in rows], rtol=1e-9)
    np.testing.assert_allclose(result, [row["ambiance_rho"] for row in rows], rtol=CASE["tol"])


def test_printed_densities():
    rows = CASE["published"]["rows"]
    result = density_kg_m3([row["z_km"] * 1e3 for row in rows])
    np.testing.assert_allclose(result, [row["rho_kg_m3"] for row in rows], rtol=5e-5)


def test_upper_table():
    result = density_kg_m3(np.array(list(UPPER)) * 1e3)
    np.testing.assert_allclose(result, list(UPPER.values()), rtol=5e-3)


@pytest.mark.parametrize("height_m", [-5000.0, -1000.0, 3210.0, 23456.0, 45678.0, 62500.0, 84999.0])
def test_every_height_below_86_km_against_the_definition(height_m):
    np.testing.assert_allclose(density_kg_m3(height_m), defined_density(height_m), rtol=1e-9)


def defined_density(height_m):
    """Integrate the standard's hydrostatic equation by its own closed forms, layer after layer,
    from sea level.
    """
    bases = [0.0, 11e3, 20e3, 32e3, 47e3, 51e3, 71e3, 84852.0]
    lapses = [-6.5e-3, 0.0, 1e-3, 2.8e-3, 0.0, -2.8e-3, -2e-3]
    g0 = 9.80665
    molar_mass = 28.9644e-3
    gas = 8.31432
    geopotential = 6356766.0 * height_m / (6356766.0 + height_m)
    temperature = 288.15
    pressure = 101325.0
    for base, top, lapse in zip(bases[:-1], bases[1:], lapses, strict=True):
        rise = min(geopotential, top) - base
        if lapse == 0.0:
            pressure *= np.exp(-g0 * molar_mass * rise / (gas * temperature))
        else:
            pressure *= (1.0 + lapse * rise / temperature) ** (-g0 * molar_mass / (gas * lapse))
        temperature += lapse * rise
        if geopotential <= top:
            break
    return pressure * molar_mass / (gas * temperature)
