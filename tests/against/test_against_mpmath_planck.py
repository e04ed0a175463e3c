"""In-band radiance against 40-digit integrals: 100 K to 6000 K, 1 to 30 µm, bands of every
width.
"""

import mpmath as mp
import numpy as np
import pytest
from opir_photons.radiometry.planck import (
    band_photon_radiance,
    band_radiance,
    band_radiance_slope,
    planck_radiance,
)

H = mp.mpf("6.62607015e-34")
K = mp.mpf("1.380649e-23")
C = mp.mpf(299792458)


def drawn_bands(count):
    rng = np.random.default_rng(20260401)
    for _ in range(count):
        temperature = float(np.exp(rng.uniform(np.log(100.0), np.log(6000.0))))
        lower = float(rng.uniform(1.0, 29.0))
        yield temperature, lower, min(30.0, lower + float(10.0 ** rng.uniform(-9.0, 1.4)))


CASES = [
    (100.0, 1.0, 30.0),
    (6000.0, 1.0, 30.0),
    (100.0, 1.0, 1.0001),
    (6000.0, 29.0, 30.0),
    *drawn_bands(6),
]


def above(x, power):
    """Return ∫ xᵖ / (eˣ - 1) dx from x to infinity, by the series of 1 / (eˣ - 1) in e⁻ˣ,
    integrated term by term.
    """
    total = mp.mpf(0)
    number = 0
    term = mp.mpf(1)
    while term > total * mp.mpf(10) ** (-mp.mp.dps):
        number += 1
        terms = (
            mp.ff(power, k) * x ** (power - k) / mp.mpf(number) ** (k + 1) for k in range(power + 1)
        )
        term = mp.exp(-number * x) * mp.fsum(terms)
        total += term
    return total


def between(temperature, lower, upper, power):
    """Return the integral over a band, with enough digits that narrow bands keep forty of them."""
    low, high = (
        H * C / (K * mp.mpf(temperature) * mp.mpf(um) * mp.mpf("1e-6")) for um in (upper, lower)
    )
    if power < 4:
        return above(low, power) - above(high, power)
    # By parts: d(1 / (eˣ - 1)) is -eˣ / (eˣ - 1)².
    edges = low**4 / mp.expm1(low) - high**4 / mp.expm1(high)
    return edges + 4 * (above(low, 3) - above(high, 3))


def watts(temperature, lower, upper):
    return (
        2
        * H
        * C**2
        * (K * mp.mpf(temperature) / (H * C)) ** 4
        * between(temperature, lower, upper, 3)
    )


def photons(temperature, lower, upper):
    return 2 * C * (K * mp.mpf(temperature) / (H * C)) ** 3 * between(temperature, lower, upper, 2)


def rise(temperature, lower, upper):
    scale = 2 * H * C**2 * (K / (H * C)) ** 4 * mp.mpf(temperature) ** 3
    return scale * between(temperature, lower, upper, 4)


def radiance(temperature, metres):
    return 2 * H * C**2 / metres**5 / mp.expm1(H * C / (metres * K * temperature))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("function", "reference"),
    [(band_radiance, watts), (band_photon_radiance, photons), (band_radiance_slope, rise)],
    ids=["watts", "photons", "slope"],
)
def test_bands_agree_to_1e_12(function, reference):
    result = function(*np.array(CASES).T)
    for value, case in zip(result.tolist(), CASES, strict=True):
        with mp.workdps(60):
            exact = reference(*case)
            assert abs(float((mp.mpf(value) - exact) / exact)) < 1e-12, case


def test_spectra_agree_to_rounding():
    # At 50 K and 0.4 µm the exponent is 719: e⁻ˣ alone is no normal float, and eˣ none at all.
    for temperature, lower, _ in [*CASES, (50.0, 0.4, 0.0)]:
        with mp.workdps(40):
            exact = radiance(mp.mpf(temperature), mp.mpf(lower) * mp.mpf("1e-6")) * mp.mpf("1e-6")
        # The exponent carries the rounding of its argument.
        assert (
            abs(float((mp.mpf(float(planck_radiance(temperature, lower))) - exact) / exact)) < 2e-13
        )
