"""Temperature from two bands: the ratio of a grey body's intensities depends on nothing else."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opir_core.interfaces.protocols import Band
from opir_core.radiometry.planck import band_radiance, band_radiance_slope

_Floats = NDArray[np.float64]

#: Between these temperatures, K, a ratio is inverted.
COLDEST_K, HOTTEST_K = 50.0, 20_000.0

#: Halvings of the interval of 1/T before Newton's steps: it is narrower than 1e-4 of itself then, where they converge.
_HALVINGS = 16
_STEPS = 4


class Temperature(NamedTuple):
    """Temperatures (n,), K, and their variances (n,), K²."""

    temperature_k: _Floats
    variance_k2: _Floats


def band_ratio(temperature_k: ArrayLike, shorter: Band, longer: Band) -> _Floats:
    """Return the ratios of a grey body's intensities in two bands; `shorter` lies at shorter wavelengths."""
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
    """Return the temperatures of grey bodies from what two bands measure, and the variances of these.

    The measurements may be intensities or irradiances, in one unit, with their variances. The ratio rises with
    temperature where `shorter` begins and ends before `longer` (else `ValueError`), so it has one solution; nan where
    that is not between 50 K and 20 000 K or a measurement is not positive. The variance is that of first order,
    (v₁/m₁² + v₂/m₂²) / (d ln ratio / dT)², for independent errors, which are to be small beside the measurements.
    """
    if not (shorter.lower_um < longer.lower_um and shorter.upper_um < longer.upper_um):
        raise ValueError(f"band {shorter.name} does not lie at shorter wavelengths than {longer.name}")
    first, second = np.asarray(shorter_w, dtype=np.float64), np.asarray(longer_w, dtype=np.float64)
    wanted = np.log(np.where(first > 0.0, first, np.nan)) - np.log(np.where(second > 0.0, second, np.nan))
    temperature = _inverted(np.atleast_1d(wanted), shorter, longer).reshape(wanted.shape)
    relative = np.asarray(shorter_variance) / first**2 + np.asarray(longer_variance) / second**2
    slope = _log_slope(temperature, shorter, longer)
    return Temperature(temperature, relative / slope**2)


def _inverted(wanted: _Floats, shorter: Band, longer: Band) -> _Floats:
    """Return the temperatures of log ratios (n,): halving in 1/T, where they are nearly straight, then Newton."""
    cold = np.full_like(wanted, 1.0 / COLDEST_K)
    hot = np.full_like(wanted, 1.0 / HOTTEST_K)
    ends = _log_ratio(np.array([COLDEST_K, HOTTEST_K]), shorter, longer)
    for _ in range(_HALVINGS):
        middle = 0.5 * (cold + hot)
        is_colder = wanted < _log_ratio(1.0 / middle, shorter, longer)
        cold, hot = np.where(is_colder, cold, middle), np.where(is_colder, middle, hot)
    temperature = 2.0 / (cold + hot)
    for _ in range(_STEPS):
        miss = wanted - _log_ratio(temperature, shorter, longer)
        # A step in 1/T: d/d(1/T) is -T² d/dT.
        temperature = 1.0 / (1.0 / temperature - miss / (temperature**2 * _log_slope(temperature, shorter, longer)))
    return np.where((wanted >= ends[0]) & (wanted <= ends[1]), temperature, np.nan)


def _log_ratio(temperature: _Floats, shorter: Band, longer: Band) -> _Floats:
    first, second = (band_radiance(temperature, band.lower_um, band.upper_um) for band in (shorter, longer))
    return np.log(first) - np.log(second)


def _log_slope(temperature: _Floats, shorter: Band, longer: Band) -> _Floats:
    """Return d ln ratio / dT, 1/K."""
    slopes = [
        band_radiance_slope(temperature, band.lower_um, band.upper_um)
        / band_radiance(temperature, band.lower_um, band.upper_um)
        for band in (shorter, longer)
    ]
    return slopes[0] - slopes[1]
