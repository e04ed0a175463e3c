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
from opir_photons.columns import floats
from opir_photons.radiometry.quadrature import legendre

#: Planck's constant, J s, and Boltzmann's, J/K (exact, SI 2019).
PLANCK_J_S = 6.62607015e-34
BOLTZMANN_J_K = 1.380649e-23

#: Photon energy times wavelength, J µm.
PHOTON_J_UM = PLANCK_J_S * SPEED_OF_LIGHT_M_S * 1e6

#: First radiation constant for radiance, 2hc², W µm⁴ m⁻² sr⁻¹.
FIRST_RADIATION_W_UM4_M2_SR = 2.0 * PLANCK_J_S * SPEED_OF_LIGHT_M_S**2 * 1e24
#: Second radiation constant, hc/k, µm K.
SECOND_RADIATION_UM_K = PLANCK_J_S * SPEED_OF_LIGHT_M_S / BOLTZMANN_J_K * 1e6

#: The constant of Stefan and Boltzmann's law, 2 π⁵ k⁴ / (15 h³ c²), W m⁻² K⁻⁴.
STEFAN_BOLTZMANN_W_M2_K4 = (
    2.0 * np.pi**5 * BOLTZMANN_J_K**4 / (15.0 * PLANCK_J_S**3 * SPEED_OF_LIGHT_M_S**2)
)


@np.errstate(all="ignore")
def planck_radiance(temperature_k: ArrayLike, wavelength_um: ArrayLike) -> FloatArray:
    """Return spectral radiances of black bodies, W m⁻² sr⁻¹ µm⁻¹; arguments broadcast. 0 at 0 K,
    nan below it.

    Source: Planck's law with the exact constants of the SI of 2019.
    """
    temperature = floats(temperature_k)
    wavelength = floats(wavelength_um)
    x = SECOND_RADIATION_UM_K / (wavelength * np.where(temperature < 0.0, np.nan, temperature))
    # In this order, with e⁻ˣ as a square, no factor leaves the range of floats before the result
    # does.
    falling = np.exp(-0.5 * x)
    level = FIRST_RADIATION_W_UM4_M2_SR / -np.expm1(-x) * falling
    return np.asarray(level / wavelength**5 * falling)


def band_radiance(temperature_k: ArrayLike, lower_um: ArrayLike, upper_um: ArrayLike) -> FloatArray:
    """Return in-band radiances of black bodies, W m⁻² sr⁻¹; arguments broadcast.

    Relative error at most 1e-12 from 100 K to 6000 K in bands between 1 and 30 µm of any width, and
    finite at all temperatures from 0 K. A band without width has radiance 0; one with its edges
    swapped has the negative radiance, as an integral has; nan for wavelengths or temperatures below
    0.
    """
    temperature = floats(temperature_k)
    scale = FIRST_RADIATION_W_UM4_M2_SR / SECOND_RADIATION_UM_K**4
    return scale * temperature**4 * _integral(temperature, lower_um, upper_um, 3)


def band_photon_radiance(
    temperature_k: ArrayLike, lower_um: ArrayLike, upper_um: ArrayLike
) -> FloatArray:
    """Return in-band radiances of black bodies in photons s⁻¹ m⁻² sr⁻¹; as `band_radiance`."""
    temperature = floats(temperature_k)
    # The first radiation constant in photons is 2c, in photons s⁻¹ µm³ m⁻² sr⁻¹.
    scale = 2.0 * SPEED_OF_LIGHT_M_S * 1e18 / SECOND_RADIATION_UM_K**3
    return scale * temperature**3 * _integral(temperature, lower_um, upper_um, 2)


def band_radiance_slope(
    temperature_k: ArrayLike, lower_um: ArrayLike, upper_um: ArrayLike
) -> FloatArray:
    """Return how in-band radiances of black bodies rise with temperature, W m⁻² sr⁻¹ K⁻¹; as
    `band_radiance`.
    """
    temperature = floats(temperature_k)
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
    size = floats(projected_area_m2) * floats(emissivity)
    return size * band_radiance(temperature_k, lower_um, upper_um)


@np.errstate(all="ignore")
def _integral(
    temperature: FloatArray, lower_um: ArrayLike, upper_um: ArrayLike, power: int
) -> FloatArray:
    """Return ∫ xᵖ / (eˣ - 1) dx over a band for p = 2, 3 and, for p = 4, ∫ x⁴ eˣ / (eˣ - 1)² dx."""
    lower = floats(lower_um)
    upper = floats(upper_um)
    short = np.minimum(lower, upper)
    long = np.maximum(lower, upper)
    invalid = (short < 0.0) | (temperature < 0.0) | np.isnan(short + long + temperature)
    start, half = _interval(short, long, temperature)
    total = np.zeros(np.broadcast_shapes(start.shape, temperature.shape))
    for node, weight in np.transpose(legendre(72)).tolist():
        total = total + weight * _integrand(start + half * (1.0 + node), power)
    return np.where(invalid, np.nan, np.where(upper < lower, -1.0, 1.0) * half * total)


def _interval(
    short: FloatArray, long: FloatArray, temperature: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the start and half the length of the interval of x over which a band is integrated."""
    # Beyond 1e6 the exponential overflows, and the radiance underflows.
    start = np.minimum(SECOND_RADIATION_UM_K / (long * temperature), 1e6)
    # The difference of the ends, x(short) - x(long), without cancellation.
    span = np.minimum(start * ((long - short) / short), 50.0)
    start, span = np.broadcast_arrays(start, np.where(long > short, span, 0.0))
    return start, 0.5 * span


def _integrand(x: FloatArray, power: int) -> FloatArray:
    """Return the integrand, with e⁻ˣ, which cannot overflow."""
    falling = np.exp(-x)
    share: FloatArray = falling / -np.expm1(-x)
    if power == 4:
        return np.where(x > 0.0, x**4 * share / -np.expm1(-x), 0.0)
    return np.where(x > 0.0, x**power * share, 0.0)


#: Bounds of temperatures that follow from measurements, K.
COLDEST_K = 50.0
HOTTEST_K = 20_000.0


class Temperature(NamedTuple):
    """Temperatures (n,), K, and their variances (n,), K²."""

    temperature_k: FloatArray
    variance_k2: FloatArray


@np.errstate(all="ignore")
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
    signals = [floats(shorter_w), floats(longer_w)]
    logarithms = [np.log(np.where(signal > 0.0, signal, np.nan)) for signal in signals]
    log_ratio = logarithms[0] - logarithms[1]
    temperature = _inverted(np.atleast_1d(log_ratio), shorter, longer).reshape(log_ratio.shape)
    relative = (
        np.asarray(shorter_variance) / signals[0] ** 2
        + np.asarray(longer_variance) / signals[1] ** 2
    )
    slope = _log_slope(temperature, shorter, longer)
    return Temperature(temperature, relative / slope**2)


def _inverted(log_ratio: FloatArray, shorter: Band, longer: Band) -> FloatArray:
    """Return the temperatures of log ratios (n,): bisection in 1/T, where they are nearly linear,
    to 1e-4 of its interval, then Newton.
    """
    least, largest = _log_ratio(np.array([COLDEST_K, HOTTEST_K]), shorter, longer)
    temperature = _bisected(log_ratio, shorter, longer)
    for _ in range(4):
        miss = log_ratio - _log_ratio(temperature, shorter, longer)
        # A step in 1/T: d/d(1/T) is -T² d/dT.
        fall = temperature**2 * _log_slope(temperature, shorter, longer)
        temperature = 1.0 / (1.0 / temperature - miss / fall)
    return np.where((log_ratio >= least) & (log_ratio <= largest), temperature, np.nan)


def _bisected(log_ratio: FloatArray, shorter: Band, longer: Band) -> FloatArray:
    cold = np.full_like(log_ratio, 1.0 / COLDEST_K)
    hot = np.full_like(log_ratio, 1.0 / HOTTEST_K)
    for _ in range(16):
        middle = 0.5 * (cold + hot)
        is_colder = log_ratio < _log_ratio(1.0 / middle, shorter, longer)
        cold = np.where(is_colder, cold, middle)
        hot = np.where(is_colder, middle, hot)
    return 2.0 / (cold + hot)


def _log_ratio(temperature: FloatArray, shorter: Band, longer: Band) -> FloatArray:
    """Return ln of the ratio of a grey body's intensities in two bands."""
    logarithms = [
        np.log(band_radiance(temperature, band.lower_um, band.upper_um))
        for band in (shorter, longer)
    ]
    return logarithms[0] - logarithms[1]


def _log_slope(temperature: FloatArray, shorter: Band, longer: Band) -> FloatArray:
    """Return d ln ratio / dT, 1/K."""
    slopes = [
        band_radiance_slope(temperature, band.lower_um, band.upper_um)
        / band_radiance(temperature, band.lower_um, band.upper_um)
        for band in (shorter, longer)
    ]
    return slopes[0] - slopes[1]
