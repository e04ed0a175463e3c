"""The density of the 1976 standard above 86 km as two polynomials: how they were found, and how
well they fit.

Below 86 km the standard is a formula. Above, it is a table of integrals over six gases; within 0.5
% two polynomials in ln rho are the same, and, unlike interpolation between the table's heights,
have no kinks for an integrator to meet. It printed the coefficients in
`opir_core/data/us_standard_1976.json`.
"""

import numpy as np
from numpy.polynomial import chebyshev, polynomial

#: Geometric height, km, and density, kg/m³ (U.S. Standard Atmosphere, 1976, NASA-TM-X-74335, table
#: I).
TABLE = {
    86: 6.958e-6,
    90: 3.416e-6,
    95: 1.393e-6,
    100: 5.604e-7,
    105: 2.325e-7,
    110: 9.708e-8,
    115: 4.289e-8,
    120: 2.222e-8,
    125: 1.291e-8,
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

#: Floor and top, km, the stretch 1/k of height above the floor, km, and the degree. Lower degrees
#: fit worse, higher ones make waves in the scale height between the table's heights.
LAYERS = ((86, 120, np.inf, 6), (120, 1000, 500.0, 9))

#: The ends of a layer weigh this much, so that layers meet.
END_WEIGHT = 1e4


def stretched(height_km: np.ndarray, floor: float, top: float, stretch: float) -> np.ndarray:
    """Return x in [-1, 1], as `opir_core.flight.atmosphere_density` has it."""
    above = height_km - floor
    return 2.0 * above * (1.0 / (top - floor) + 1.0 / stretch) / (1.0 + above / stretch) - 1.0


def main() -> None:
    for floor, top, stretch, degree in LAYERS:
        height = np.array([each for each in TABLE if floor <= each <= top], dtype=float)
        log_density = np.log([TABLE[int(each)] for each in height])
        weights = np.where((height == floor) | (height == top), END_WEIGHT, 1.0)
        x = stretched(height, floor, top, stretch)
        fit = chebyshev.cheb2poly(chebyshev.chebfit(x, log_density, degree, w=weights))
        rounded = [float(f"{each:.9g}") for each in fit]
        worst = np.abs(np.expm1(polynomial.polyval(x, rounded) - log_density)).max()
        print(f"{floor} to {top} km, worst {worst:.2%} of the table:", *rounded)


if __name__ == "__main__":
    main()
