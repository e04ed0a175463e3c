"""Black bodies: spectral and in-band radiance, in watts and in photons, and temperature from two
bands.

With x = c₂ / (λT) the radiance of a band is C T⁴ ∫ x³ / (eˣ - 1) dx, and in photons C' T³ ∫ x² /
(eˣ - 1) dx. The integrand is smooth and positive, so Gauss-Legendre quadrature over the band has no
cancellation however narrow the band is; beyond 50 above its lower end the remainder is below 1e-17.
With 72 nodes it is exact to rounding (1e-13) over such a span; the rounding of x in the
exponential, x · 2e-16, bounds the rest.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.plugin import Band

#: Planck's constant, J s, and Boltzmann's, J/K (exact, SI 2019).
PLANCK_J_S = 6.62607015e-34
BOLTZMANN_J_K = 1.380649e-23

#: First radiation constant for radiance, 2hc², W µm⁴ m⁻² sr⁻¹.
FIRST_RADIATION_W_UM4_M2_SR = 2.0 * PLANCK_J_S * SPEED_OF_LIGHT_M_S**2 * 1e24
#: The same in photons, 2c, photons s⁻¹ µm³ m⁻² sr⁻¹.
FIRST_PHOTON_UM3_S_M2_SR = 2.0 * SPEED_OF_LIGHT_M_S * 1e18
#: Second radiation constant, hc/k, µm K.
SECOND_RADIATION_UM_K = PLANCK_J_S * SPEED_OF_LIGHT_M_S / BOLTZMANN_J_K * 1e6


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(72)
_SPAN = 50.0
#: Beyond this the exponential overflows, and the radiance underflows.
_FARTHEST = 1e6


@np.errstate(over="ignore", under="ignore", divide="ignore", invalid="ignore")
def planck_radiance(temperature_k: ArrayLike, wavelength_um: ArrayLike) -> FloatArray:
    """Return spectral radiances of black bodies, W m⁻² sr⁻¹ µm⁻¹; arguments broadcast. 0 at 0 K,
    nan below it.

    Source: Planck's law with the exact constants of the SI of 2019.
    """
    return _spectral(temperature_k, wavelength_um, FIRST_RADIATION_W_UM4_M2_SR, 5)


@np.errstate(over="ignore", under="ignore", divide="ignore", invalid="ignore")
def planck_photon_radiance(temperature_k: ArrayLike, wavelength_um: ArrayLike) -> FloatArray:
    """Return spectral radiances of black bodies in photons s⁻¹ m⁻² sr⁻¹ µm⁻¹; as
    `planck_radiance`.
    """
    return _spectral(temperature_k, wavelength_um, FIRST_PHOTON_UM3_S_M2_SR, 4)


def band_radiance(temperature_k: ArrayLike, lower_um: ArrayLike, upper_um: ArrayLike) -> FloatArray:
    """Return in-band radiances of black bodies, W m⁻² sr⁻¹; arguments broadcast.

    Relative error at most 1e-12 from 100 K to 6000 K in bands between 1 and 30 µm of any width, and
    finite at all temperatures from 0 K. A band without width has radiance 0; one with its edges
    swapped has the negative radiance, as an integral has; nan for wavelengths or temperatures below
    0.
    """
    temperature = np.asarray(temperature_k, dtype=np.float64)
    scale = FIRST_RADIATION_W_UM4_M2_SR / SECOND_RADIATION_UM_K**4
    return scale * temperature**4 * _integral(temperature, lower_um, upper_um, 3)


def band_photon_radiance(
    temperature_k: ArrayLike, lower_um: ArrayLike, upper_um: ArrayLike
) -> FloatArray:
    """Return in-band radiances of black bodies in photons s⁻¹ m⁻² sr⁻¹; as `band_radiance`."""
    temperature = np.asarray(temperature_k, dtype=np.float64)
    scale = FIRST_PHOTON_UM3_S_M2_SR / SECOND_RADIATION_UM_K**3
    return scale * temperature**3 * _integral(temperature, lower_um, upper_um, 2)


def band_radiance_slope(
    temperature_k: ArrayLike, lower_um: ArrayLike, upper_um: ArrayLike
) -> FloatArray:
    """Return how in-band radiances of black bodies rise with temperature, W m⁻² sr⁻¹ K⁻¹; as
    `band_radiance`.
    """
    temperature = np.asarray(temperature_k, dtype=np.float64)
    scale = FIRST_RADIATION_W_UM4_M2_SR / SECOND_RADIATION_UM_K**4
    return scale * temperature**3 * _integral(temperature, lower_um, upper_um, 4)


def grey_body_intensity(
    temperature_k: ArrayLike,
    projected_area_m2: ArrayLike,
    emissivity: ArrayLike,
    lower_um: ArrayLike,
    upper_um: ArrayLike,
) -> FloatArray:
    """Return in-band radiant intensities of grey bodies, W/sr, of an area as it is seen from the
    sensor, m².
    """
    size = np.asarray(projected_area_m2, dtype=np.float64) * np.asarray(
        emissivity, dtype=np.float64
    )
    return size * band_radiance(temperature_k, lower_um, upper_um)


def _spectral(
    temperature_k: ArrayLike, wavelength_um: ArrayLike, scale: float, power: int
) -> FloatArray:
    temperature = np.asarray(temperature_k, dtype=np.float64)
    wavelength = np.asarray(wavelength_um, dtype=np.float64)
    x = SECOND_RADIATION_UM_K / (wavelength * np.where(temperature < 0.0, np.nan, temperature))
    # In this order, with e⁻ˣ as a square, no factor leaves the range of floats before the result
    # does.
    falling = np.exp(-0.5 * x)
    return np.asarray(scale / -np.expm1(-x) * falling / wavelength**power * falling)


@np.errstate(over="ignore", under="ignore", divide="ignore", invalid="ignore")
def _integral(
    temperature: FloatArray, lower_um: ArrayLike, upper_um: ArrayLike, power: int
) -> FloatArray:
    """Return ∫ xᵖ / (eˣ - 1) dx over a band for p = 2, 3 and, for p = 4, ∫ x⁴ eˣ / (eˣ - 1)² dx."""
    lower = np.asarray(lower_um, dtype=np.float64)
    upper = np.asarray(upper_um, dtype=np.float64)
    short = np.minimum(lower, upper)
    long = np.maximum(lower, upper)
    invalid = (short < 0.0) | (temperature < 0.0) | np.isnan(short + long + temperature)
    start = np.minimum(SECOND_RADIATION_UM_K / (long * temperature), _FARTHEST)
    # The difference of the ends, x(short) - x(long), without cancellation.
    span = np.minimum(start * ((long - short) / short), _SPAN)
    span = np.where(long > short, span, 0.0)
    start, span = np.broadcast_arrays(start, span)
    half = 0.5 * span
    total = np.zeros(np.broadcast_shapes(start.shape, temperature.shape))
    for node, weight in zip(_NODES.tolist(), _WEIGHTS.tolist(), strict=True):
        total = total + weight * _integrand(start + half * (1.0 + node), power)
    return np.where(invalid, np.nan, np.where(upper < lower, -1.0, 1.0) * half * total)


def _integrand(x: FloatArray, power: int) -> FloatArray:
    """Return the integrand, with e⁻ˣ, which cannot overflow."""
    falling = np.exp(-x)
    share: FloatArray = falling / -np.expm1(-x)
    if power == 4:
        return np.where(x > 0.0, x**4 * share / -np.expm1(-x), 0.0)
    return np.where(x > 0.0, x**power * share, 0.0)


#: Bounds of the temperature, K.
COLDEST_K = 50.0
HOTTEST_K = 20_000.0

#: Bisections of the interval of 1/T, to 1e-4 of it, before Newton's steps.
_HALVINGS = 16
_STEPS = 4


class Temperature(NamedTuple):
    """Temperatures (n,), K, and their variances (n,), K²."""

    temperature_k: FloatArray
    variance_k2: FloatArray


def band_ratio(temperature_k: ArrayLike, shorter: Band, longer: Band) -> FloatArray:
    """Return the ratios of a grey body's intensities in two bands; `shorter` lies at shorter
    wavelengths.
    """
    return np.exp(_log_ratio(np.asarray(temperature_k, dtype=np.float64), shorter, longer))


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def two_colour_temperature(
    shorter_w: ArrayLike,
    longer_w: ArrayLike,
    shorter_variance: ArrayLike,
    longer_variance: ArrayLike,
    shorter: Band,
    longer: Band,
) -> Temperature:
    """Return the temperatures of grey bodies from measurements in two bands, and their variances.

    The measurements are intensities or irradiances, in one unit, with their variances. The ratio
    rises with temperature where `shorter` begins and ends before `longer` (else `ValueError`), so
    it has one solution; nan where that is not between 50 K and 20 000 K or a measurement is not
    positive. The variance is of first order, (v₁/m₁² + v₂/m₂²) / (d ln ratio / dT)², for
    independent errors that are small beside the measurements.
    """
    if not (shorter.lower_um < longer.lower_um and shorter.upper_um < longer.upper_um):
        raise ValueError(
            f"band {shorter.name} does not lie at shorter wavelengths than {longer.name}"
        )
    first = np.asarray(shorter_w, dtype=np.float64)
    second = np.asarray(longer_w, dtype=np.float64)
    wanted = np.log(np.where(first > 0.0, first, np.nan)) - np.log(
        np.where(second > 0.0, second, np.nan)
    )
    temperature = _inverted(np.atleast_1d(wanted), shorter, longer).reshape(wanted.shape)
    relative = np.asarray(shorter_variance) / first**2 + np.asarray(longer_variance) / second**2
    slope = _log_slope(temperature, shorter, longer)
    return Temperature(temperature, relative / slope**2)


def _inverted(wanted: FloatArray, shorter: Band, longer: Band) -> FloatArray:
    """Return the temperatures of log ratios (n,): bisection in 1/T, where they are nearly linear,
    then Newton.
    """
    cold = np.full_like(wanted, 1.0 / COLDEST_K)
    hot = np.full_like(wanted, 1.0 / HOTTEST_K)
    ends = _log_ratio(np.array([COLDEST_K, HOTTEST_K]), shorter, longer)
    for _ in range(_HALVINGS):
        middle = 0.5 * (cold + hot)
        is_colder = wanted < _log_ratio(1.0 / middle, shorter, longer)
        cold = np.where(is_colder, cold, middle)
        hot = np.where(is_colder, middle, hot)
    temperature = 2.0 / (cold + hot)
    for _ in range(_STEPS):
        miss = wanted - _log_ratio(temperature, shorter, longer)
        # A step in 1/T: d/d(1/T) is -T² d/dT.
        temperature = 1.0 / (
            1.0 / temperature - miss / (temperature**2 * _log_slope(temperature, shorter, longer))
        )
    return np.where((wanted >= ends[0]) & (wanted <= ends[1]), temperature, np.nan)


def _log_ratio(temperature: FloatArray, shorter: Band, longer: Band) -> FloatArray:
    first, second = (
        band_radiance(temperature, band.lower_um, band.upper_um) for band in (shorter, longer)
    )
    return np.log(first) - np.log(second)


def _log_slope(temperature: FloatArray, shorter: Band, longer: Band) -> FloatArray:
    """Return d ln ratio / dT, 1/K."""
    slopes = [
        band_radiance_slope(temperature, band.lower_um, band.upper_um)
        / band_radiance(temperature, band.lower_um, band.upper_um)
        for band in (shorter, longer)
    ]
    return slopes[0] - slopes[1]
