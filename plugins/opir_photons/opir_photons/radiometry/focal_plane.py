"""The focal plane of a sensor: point spread, pixels, electrons, noise, saturation and centroid
accuracy.

A point source makes a Gaussian spot, which square pixels integrate. Widths of spots are standard
deviations per axis, rad; `pixel_rad` is the IFOV of one pixel. Arguments of all functions broadcast
and the results have their common shape; invalid numbers (negative widths, no aperture) give nan or
inf, never an exception.

Sources: J. W. Goodman, Introduction to Fourier Optics, 3rd ed. (2005), section 4.4 (Airy pattern);
E. L. Dereniak and G. D. Boreman, Infrared Detectors and Systems (1996), chapter 5 (noise of
detectors); K. A. Winick, J. Opt. Soc. Am. A 3 (1986) 1809 (Cramér-Rao bound of a centroid). Closed
forms without a source are integrals worked out here.
"""

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf

from opir_core.arrays import FloatArray
from opir_photons.columns import floats
from opir_photons.radiometry.planck import PHOTON_J_UM
from opir_photons.radiometry.quadrature import unit_legendre

#: Width of a spot, in pixels, beyond which it is a wider one in larger pixels.
_SMOOTH = 4.0


def airy_sigma_rad(wavelength_um: ArrayLike, aperture_m: ArrayLike) -> FloatArray:
    """Return the widths of diffraction-limited spots, rad: σ = (√2 / π) λ / D.

    The Gaussian with the power, the peak, 1/(2π σ²) = (π/4) (D/λ)², and the curvature at the peak
    of the Airy pattern of a circular aperture of diameter D, m, at wavelength λ, µm. The Airy
    pattern's rings, 16 % of its power, are in the Gaussian's core.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = math.sqrt(2.0) / math.pi * 1e-6 * floats(wavelength_um)
        return np.asarray(scaled / floats(aperture_m))


def blurred_sigma_rad(
    sigma_rad: ArrayLike, jitter_rad: ArrayLike = 0.0, smear_rad: ArrayLike = 0.0
) -> FloatArray:
    """Return the widths of spots blurred during the integration, rad.

    `jitter_rad` is the standard deviation per axis of line-of-sight jitter that is fast against the
    integration time, or of any other Gaussian blur; `smear_rad` the length of a uniform motion,
    whose variance smear²/12 is shared by both axes: its direction is random.
    """
    sigma, jitter, smear = map(floats, (sigma_rad, jitter_rad, smear_rad))
    return np.asarray(np.sqrt(sigma * sigma + jitter * jitter + smear * smear / 24.0))


@np.errstate(divide="ignore", invalid="ignore")
def ensquared_energy(
    sigma_rad: ArrayLike, pixel_rad: ArrayLike, pixels: ArrayLike = 1, phase: str = "mean"
) -> FloatArray:
    """Return the shares, in [0, 1], of a spot's energy in a square of `pixels` × `pixels` pixels
    about it.

    The square is the one whose centre is nearest to the spot. Over the spot's place in that cell
    (its sub-pixel phase) the share is the `mean` of all places, the `best`, at the centre, or the
    `worst`, at a corner.
    """
    sigma, pixel, count = map(floats, (sigma_rad, pixel_rad, pixels))
    inner = 0.5 * (count - 1.0) * pixel
    outer = 0.5 * (count + 1.0) * pixel
    scale = math.sqrt(2.0) * sigma
    if phase == "best":
        share = erf(0.5 * count * pixel / scale)
    elif phase == "worst":
        share = 0.5 * (_erf(inner, scale) + erf(outer / scale))
    elif phase == "mean":
        share = _mean_erf(inner, outer, pixel, scale)
    else:
        raise ValueError(f"phase: {phase!r} is not one of mean, best, worst")
    return np.asarray(share * share)


def _mean_erf(
    inner: FloatArray, outer: FloatArray, pixel: FloatArray, scale: FloatArray
) -> FloatArray:
    """Return the mean of erf(x / scale) from `inner` to `outer`, a pixel further."""
    falling = np.exp(-np.square(outer / scale)) - np.exp(-np.square(_ratio(inner, scale)))
    integral = (
        outer * erf(outer / scale)
        - inner * _erf(inner, scale)
        + scale * falling / math.sqrt(math.pi)
    )
    # Of wide spots by quadrature, whose terms have one sign.
    wide = sum(
        weight * erf((inner + pixel * node) / scale)
        for node, weight in zip(*unit_legendre(12), strict=True)
    )
    return np.where(pixel < scale, wide, integral / pixel)


def _ratio(length: FloatArray, scale: FloatArray) -> FloatArray:
    """Return length / scale, 0 for no length."""
    return np.where(length == 0.0, 0.0, length / scale)


def _erf(length: FloatArray, scale: FloatArray) -> FloatArray:
    return np.asarray(erf(_ratio(length, scale)))


def electrons_per_w_m2(
    wavelength_um: ArrayLike,
    aperture_m: ArrayLike,
    transmission: ArrayLike,
    quantum_efficiency: ArrayLike,
    integration_s: ArrayLike,
) -> FloatArray:
    """Return the electrons that an irradiance of 1 W/m² at the aperture frees: (π/4) D² τ η t λ /
    (h c).

    Wavelength λ, µm (the middle of a narrow band), aperture diameter D, m, transmission τ of the
    optics, quantum efficiency η, integration time t, s. A point source shares them among pixels
    (`ensquared_energy`); of a background of radiance L, W m⁻² sr⁻¹, a pixel of solid angle ω
    receives the irradiance L ω.
    """
    aperture = floats(aperture_m)
    collected = 0.25 * math.pi * aperture * aperture * floats(transmission)
    collected = collected * floats(quantum_efficiency) * floats(integration_s)
    return np.asarray(collected * floats(wavelength_um) / PHOTON_J_UM)


def noise_electrons(
    background_e: ArrayLike = 0.0,
    dark_e: ArrayLike = 0.0,
    read_e: ArrayLike = 0.0,
    signal_e: ArrayLike = 0.0,
) -> FloatArray:
    """Return the standard deviations of a pixel's count: √(background + dark + signal + read²),
    electrons.

    Collected electrons are Poisson distributed; `read_e` is the standard deviation of reading.
    """
    read = floats(read_e)
    counted = floats(background_e) + floats(dark_e) + floats(signal_e)
    return np.asarray(np.sqrt(counted + read * read))


def noise_equivalent_irradiance(
    noise_e: ArrayLike,
    electrons_per_unit: ArrayLike,
    signal_gain: ArrayLike = 1.0,
    noise_gain: ArrayLike = 1.0,
) -> FloatArray:
    """Return noise-equivalent irradiances at the aperture, W/m²: noise · √(noise gain) / (electrons
    · signal gain).

    `noise_e` is the noise of a pixel, `electrons_per_unit` the electrons of 1 W/m². For n summed
    pixels the signal gain is the ensquared energy of all and the noise gain n; a difference of two
    frames doubles the noise gain.
    """
    noise = floats(noise_e) * np.sqrt(floats(noise_gain))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(noise / (floats(electrons_per_unit) * floats(signal_gain)))


def centroid_sigma_rad(
    pixel_snr: ArrayLike, sigma_rad: ArrayLike, pixel_rad: ArrayLike, signal_e: ArrayLike = np.inf
) -> FloatArray:
    """Return the Cramér-Rao bounds of a spot's position, rad: standard deviations per axis, over
    all sub-pixel phases.

    `pixel_snr` is the whole signal over the noise of one pixel without signal, equal in all pixels;
    `signal_e` the electrons of the signal, whose photon noise adds to it (inf: none). The Fisher
    information of a phase is Σ (A ∂E/∂x)² / (b² + A E) over pixels with shares E of signal A in
    noise b (Winick, eq. 20); the bound's variance is averaged over phases. Summed pixel by pixel:
    `joined_centroid_variance` is for many spots.
    """
    columns = np.broadcast_arrays(*map(floats, (pixel_snr, sigma_rad, pixel_rad, signal_e)))
    widths = zip(*(column.ravel().tolist() for column in columns), strict=True)
    bounds = [_bound(snr, sigma / pixel, signal) * pixel for snr, sigma, pixel, signal in widths]
    return np.array(bounds).reshape(columns[0].shape)


def _bound(snr: float, width: float, signal: float) -> float:
    """Return the bound, in pixels, of a spot of a width in pixels."""
    if width > _SMOOTH:
        larger = width / _SMOOTH
        return larger * _bound(snr / larger, _SMOOTH, signal)
    share, slope = _shares(np.array([width]))
    share = share[0]
    slope = slope[0]
    # All phases of wide spots are alike.
    if width > 1.5:
        share = share[:1]
        slope = slope[:1]
    # Over rows, columns, phases along and phases across; in units of the noise of a pixel.
    squares = share[:, None, :, None] * share[None, :, None, :]
    steep = slope[:, None, :, None] * share[None, :, None, :]
    with np.errstate(divide="ignore"):
        information = (np.square(snr * steep) / (1.0 + snr * snr / signal * squares)).sum(
            axis=(2, 3)
        )
        return math.sqrt(np.mean(1.0 / information))


def centroid_factor_rad(sigma_rad: ArrayLike, pixel_rad: ArrayLike) -> FloatArray:
    """Return the Cramér-Rao bounds of a spot's position without photon noise times the pixel SNR,
    rad.

    As `centroid_sigma_rad`; for wide spots √(8π) σ² / pixel. The sum over pixels is then a product
    of one over rows and one over columns, whose inverses are averaged one by one.
    """
    pixel = floats(pixel_rad)
    width = floats(sigma_rad) / pixel
    share, slope = _shares(np.minimum(width, _SMOOTH))
    with np.errstate(divide="ignore"):
        along = np.mean(1.0 / np.square(slope).sum(axis=-1), axis=-1)
        across = np.mean(1.0 / np.square(share).sum(axis=-1), axis=-1)
    return np.asarray(np.sqrt(along * across) * np.square(np.maximum(width / _SMOOTH, 1.0)) * pixel)


def photon_centroid_variance(sigma_rad: ArrayLike, pixel_rad: ArrayLike) -> FloatArray:
    """Return the variances of a spot's centroid for one electron, rad²: σ² + pixel²/12.

    The Cramér-Rao bound in photon noise alone is this over the electrons of the signal, within 2 %
    from 0.25 pixels on (R. E. Thompson, D. R. Larson and W. W. Webb, Biophys. J. 82 (2002) 2775).
    """
    sigma = floats(sigma_rad)
    pixel = floats(pixel_rad)
    return np.asarray(sigma * sigma + pixel * pixel / 12.0)


def joined_centroid_variance(white: ArrayLike, photons: ArrayLike) -> FloatArray:
    """Return the variances of a centroid from those in white noise alone and in photon noise alone,
    in their unit.

    w + p + p √(w / (2 (w + p))): B. Rieger and S. Stallinga, ChemPhysChem 15 (2014) 664, of which
    it is the bound of wide spots. Standard deviations are within 5 % of `centroid_sigma_rad` for
    spots of 0.25 pixels and wider.
    """
    white_variance = floats(white)
    photon_variance = floats(photons)
    total = white_variance + photon_variance
    share = white_variance / np.maximum(total, np.finfo(np.float64).tiny)
    return np.asarray(total + photon_variance * np.sqrt(0.5 * share))


def _shares(width: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the shares of a spot in rows of pixels, and their slopes, (…, phases, rows), for
    widths in pixels.
    """
    reach = math.ceil(7.0 * float(np.max(width, initial=1.0))) + 1
    narrow = np.asarray(width)[..., None, None]
    # Sub-pixel phases from the centre of a pixel to its edge: the mean over them converges faster
    # than any power.
    phases = (np.arange(32) + 0.5) / 64.0
    off = (phases[:, None] - np.arange(-reach, reach + 1)) / narrow
    step = 0.5 / narrow
    share = 0.5 * (erf((off + step) / math.sqrt(2.0)) - erf((off - step) / math.sqrt(2.0)))
    return share, (_density(off + step) - _density(off - step)) / narrow


def _density(at: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-0.5 * at * at) / math.sqrt(2.0 * math.pi))
