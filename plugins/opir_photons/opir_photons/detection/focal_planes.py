"""Figures of a focal plane for the detection model `snr`: noise, clutter, saturation and centroids.

All is referred to irradiance at the aperture: noise is divided by the share of a source's light
that the spatial filter passes, so the signal of a look is the target's whole irradiance. A CFAR
threshold divides the SNR by its loss: noise is that much larger.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from attrs import frozen
from numpy.polynomial import chebyshev
from scipy.special import ndtr

from opir_core.arrays import FloatArray, IndexArray
from opir_core.errors import ModelError
from opir_core.interfaces import Radiometer, Structure
from opir_core.plugin import Background, Band, FocalPlaneConfig
from opir_photons.columns import floats
from opir_photons.detection.cfar import cfar_loss
from opir_photons.radiometry.clutter import FrameDifference, SpatialTransfer
from opir_photons.radiometry.detector import (
    conversion_noise_electrons,
    dark_electrons_per_s,
    warm_optics_photons_per_s,
)
from opir_photons.radiometry.filtered_spots import FilteredSpot, OwnPast, ensquared_airy_energy
from opir_photons.radiometry.focal_plane import (
    airy_sigma_rad,
    blurred_sigma_rad,
    centroid_factor_rad,
    electrons_per_w_m2,
    joined_centroid_variance,
    noise_electrons,
    noise_equivalent_irradiance,
    photon_centroid_variance,
)
from opir_photons.radiometry.pixel_filters import filter_weights, noise_gain
from opir_photons.radiometry.point_spread import PointSpread

#: Logarithms of the ranges, m, of a clutter table: its middle, and half its width, for scenes 10 km
#: to 1e6 km away.
_MIDDLE = 0.5 * math.log(1e9 * 1e4)
_HALF = 0.5 * math.log(1e9 / 1e4)


@frozen(eq=False)
class ClutterTable:
    """Residual amplitudes of a structure of unit rms, by range: a Chebyshev series in the logarithm
    of the range, to within 2e-4.
    """

    coefficients: FloatArray

    @classmethod
    def of(
        cls,
        structure: Structure,
        pixel_rad: float,
        transfer: SpatialTransfer,
        frames: FrameDifference | None,
    ) -> "ClutterTable":
        """Return the table of a structure behind a filter."""
        node = chebyshev.chebpts1(25)
        scale = structure.scale_m / (np.exp(_MIDDLE + _HALF * node) * pixel_rad)
        variance = transfer.variance(scale, structure.exponent, frames)
        logarithm = 0.5 * np.log(np.maximum(variance, np.finfo(np.float64).tiny))
        return cls(floats(chebyshev.chebfit(node, logarithm, 24)))

    def amplitude(self, range_m: FloatArray) -> FloatArray:
        """Return the residual standard deviations (n,) of a structure of unit rms at ranges (n,), m."""
        place = np.clip((np.log(range_m) - _MIDDLE) / _HALF, -1.0, 1.0)
        return np.asarray(np.exp(chebyshev.chebval(place, self.coefficients)))


@frozen(eq=False)
class FocalPlaneTerms:
    """Figures of a focal plane, by band.

    `filters` are the transfers of spot, pixel and spatial filter, `frames` is the temporal filter,
    all in pixels, which are `pixel_rad` wide. `photon_gain` is the factor on the variance of
    background photons, `clutter_gain` that on the amplitude of clutter in a pixel; `clutter` (B,
    structures) are tables; `well_w_m2` the irradiance in a pixel that fills its well, of which a
    source puts `peak_share` into one pixel. `own_past` is the share of a source's own light that
    the temporal filter subtracts; empty without one. A centroid in noise alone is off by `centroid_rad` over
    the SNR, one electron by `spot_rad`; `electron_w_m2` is the irradiance of one electron.
    """

    pixel_rad: float
    filters: tuple[SpatialTransfer, ...]
    frames: FrameDifference | None
    nei_w_m2: tuple[float, ...]
    collection_m2_s: float
    photon_gain: FloatArray
    clutter_gain: FloatArray
    clutter: tuple[tuple[ClutterTable, ...], ...]
    well_w_m2: FloatArray
    peak_share: FloatArray
    centroid_rad: FloatArray
    spot_rad: FloatArray
    electron_w_m2: FloatArray
    own_past: tuple[OwnPast, ...]

    def clutter_w_m2_sr(
        self, rms: FloatArray, structure: IndexArray, range_m: FloatArray
    ) -> FloatArray:
        """Return clutter (B, n), W m⁻² sr⁻¹ in a pixel, of structures (n,) of radiances' rms (B, n)
        at ranges (n,).
        """
        clutter = rms * self.clutter_gain[:, None]
        for number in np.unique(structure).tolist():
            rows = np.flatnonzero(structure == number)
            for band, tables in enumerate(self.clutter):
                clutter[band, rows] *= tables[number].amplitude(range_m[rows])
        return clutter

    def clutter_correlation(
        self, structure: Structure, range_m: float, interval_s: FloatArray
    ) -> FloatArray:
        """Return the correlations (B, k) of clutter in one cell in scans that are intervals (k,),
        s, apart.
        """
        scale = structure.scale_m / (range_m * self.pixel_rad)
        return np.array(
            [
                transfer.correlation(scale, structure.exponent, interval_s, self.frames)
                for transfer in self.filters
            ]
        )

    def saturation_w_m2(self, behind_w_m2: FloatArray | float) -> FloatArray:
        """Return the irradiances (B, n) of targets that fill a well, before a background in a pixel
        (B, n).
        """
        room = np.maximum(self.well_w_m2[:, None] - behind_w_m2, 0.0)
        return np.asarray(room / self.peak_share[:, None])

    def centroid_variance(self, snr: FloatArray, noise: FloatArray) -> FloatArray:
        """Return the variances (n,), rad², of centroids in the best band, of signals (n, B) in
        noise (n, B), W/m².
        """
        # No division by zero for signals over noise, and irradiances, W/m².
        least = 1e-30
        best = np.full(len(snr), np.inf)
        for band in range(snr.shape[1]):
            signal = np.maximum(snr[:, band], least)
            spot = self.spot_rad[band] ** 2
            # One electron places a spot: the brightest pixel holds more.
            white = np.minimum(np.square(self.centroid_rad[band] / signal), spot)
            photons = spot * self.electron_w_m2[band] / np.maximum(signal * noise[:, band], least)
            np.minimum(best, np.minimum(joined_centroid_variance(white, photons), spot), out=best)
        return best


@frozen(eq=False)
class LineOfSightError:
    """Standard deviations of lines of sight: `floor_rad`, and that of a centroid, with or without a
    focal plane.
    """

    floor_rad: float
    ifov_rad: float
    plane: FocalPlaneTerms | None

    def sigma_rad(self, snr: FloatArray, noise: FloatArray, best: FloatArray) -> FloatArray:
        """Return standard deviations (n,) per axis, of signals (n, B), the `best` (n,), in noise
        (n, B), W/m².
        """
        if self.plane is None:
            spread: FloatArray = self.ifov_rad / best
            spread *= spread
        else:
            spread = self.plane.centroid_variance(snr, noise)
        spread += self.floor_rad * self.floor_rad
        return np.sqrt(spread, out=spread)


def focal_plane_terms(
    radiometer: Radiometer, bands: Sequence[Band], background: Background
) -> FocalPlaneTerms | None:
    """Return the figures of a radiometer's focal planes in its bands, or None without one."""
    if not radiometer.focal_planes:
        return None
    return _terms(radiometer, tuple(bands), tuple(background.structures))


@lru_cache(maxsize=64)
def _terms(
    radiometer: Radiometer, bands: tuple[Band, ...], structures: tuple[Structure, ...]
) -> FocalPlaneTerms:
    pixel = radiometer.ifov_rad
    planes = radiometer.focal_planes
    frames = _frames(planes[0], pixel)
    terms = [_BandTerms.of(plane, band, pixel) for plane, band in zip(planes, bands, strict=True)]

    def column(name: str) -> FloatArray:
        return np.array([getattr(term, name) for term in terms])

    per_unit = column("per_unit")
    share = column("passed")
    noise = column("noise")
    frame_noise = noise * (1.0 if frames is None else 2.0)
    loss = np.array([_loss(radiometer.threshold, plane) for plane in planes])
    computed = noise_equivalent_irradiance(column("noise_e"), per_unit, share, frame_noise)
    nei = np.array(radiometer.nei_w_m2)
    collection = np.array([_collection_m2_s(plane) for plane in planes])
    filters = tuple(SpatialTransfer.of(term.weights, term.spread) for term in terms)
    return FocalPlaneTerms(
        pixel_rad=pixel,
        filters=filters,
        frames=frames,
        nei_w_m2=tuple((np.where(np.isnan(nei), computed, nei) * loss).tolist()),
        collection_m2_s=float(collection[0]),
        photon_gain=frame_noise * np.square(loss / share) * collection[0] / collection,
        clutter_gain=loss / share,
        clutter=_clutter_tables(filters, structures, pixel, frames),
        well_w_m2=column("room_e") / per_unit,
        peak_share=np.array([ensquared_airy_energy(term.spread, 1, term.phase) for term in terms]),
        centroid_rad=centroid_factor_rad(column("sigma_rad"), pixel)
        * share
        / (loss * np.sqrt(noise)),
        spot_rad=np.sqrt(photon_centroid_variance(column("sigma_rad"), pixel)),
        electron_w_m2=1.0 / per_unit,
        own_past=() if frames is None else tuple(term.spot.own_past(frames) for term in terms),
    )


def _clutter_tables(
    filters: Sequence[SpatialTransfer],
    structures: Sequence[Structure],
    pixel: float,
    frames: FrameDifference | None,
) -> tuple[tuple[ClutterTable, ...], ...]:
    return tuple(
        tuple(ClutterTable.of(structure, pixel, transfer, frames) for structure in structures)
        for transfer in filters
    )


@frozen(eq=False)
class _BandTerms:
    """Figures of one band's focal plane; `noise_e` is of a pixel and frame without background,
    `room_e` its well.
    """

    phase: str
    sigma_rad: float
    spread: PointSpread
    weights: FloatArray
    spot: FilteredSpot
    passed: float
    noise: float
    per_unit: float
    noise_e: float
    room_e: float

    @classmethod
    def of(cls, plane: FocalPlaneConfig, band: Band, pixel: float) -> "_BandTerms":
        """Return the terms of a focal plane in a band, for pixels of an angular width."""
        middle_um = 0.5 * (band.lower_um + band.upper_um)
        time_s = plane.integration_time_ms * 1e-3
        blur = blur_rad(plane)
        sigma = float(blurred_sigma_rad(airy_sigma_rad(middle_um, plane.aperture_m), blur))
        weights = filter_weights(plane.spatial_filter, plane.core_pixels, sigma, pixel)
        spread = PointSpread.of(middle_um, plane.aperture_m, blur, pixel)
        spot = FilteredSpot.of(weights, spread, plane.phase)
        efficiency = plane.quantum_efficiency * plane.fill_factor
        per_unit = electrons_per_w_m2(
            middle_um, plane.aperture_m, plane.optics_transmission, efficiency, time_s
        )
        unlit_e = unlit_electrons_per_s(plane, band, pixel) * time_s
        conversion_e = conversion_noise_electrons(plane.well_capacity_e, plane.bits)
        read_e = np.hypot(plane.read_noise_e, conversion_e) * math.sqrt(plane.subframes)
        return cls(
            phase=plane.phase,
            sigma_rad=sigma,
            spread=spread,
            weights=weights,
            spot=spot,
            passed=float(spot.response()),
            noise=noise_gain(weights),
            per_unit=float(per_unit),
            noise_e=float(noise_electrons(dark_e=unlit_e, read_e=read_e)),
            room_e=max(plane.well_capacity_e * plane.subframes - unlit_e, 0.0),
        )


def unlit_electrons_per_s(plane: FocalPlaneConfig, band: Band, pixel_rad: float) -> float:
    """Return the electrons per s of a pixel without light from outside: dark current and warm
    optics.
    """
    pitch_m = pixel_rad * plane.f_number * plane.aperture_m
    dark = plane.dark_current_e_s
    if dark is None:
        dark = float(
            dark_electrons_per_s(
                band.upper_um, plane.detector_temperature_k, pitch_m, plane.fill_factor
            )
        )
    edges = band.lower_um, band.upper_um
    emissivity = 1.0 - plane.optics_transmission
    warm = warm_optics_photons_per_s(
        plane.optics_temperature_k, *edges, emissivity, plane.f_number, pitch_m
    )
    return dark + float(warm) * plane.quantum_efficiency * plane.fill_factor


def _collection_m2_s(plane: FocalPlaneConfig) -> float:
    """Return aperture times electrons per photon at it times integration time."""
    efficiency = plane.optics_transmission * plane.quantum_efficiency * plane.fill_factor
    return math.pi / 4.0 * plane.aperture_m**2 * efficiency * plane.integration_time_ms * 1e-3


def _loss(threshold: float, plane: FocalPlaneConfig) -> float:
    """Return the CFAR loss at a threshold, standard deviations; 1 where the noise is known."""
    if plane.reference_cells is None:
        return 1.0
    # A P_fa of 0.16 to 8e-24.
    if not 1.0 <= threshold <= 10.0:
        raise ModelError(
            "focal_plane.reference_cells: the loss of a threshold above 10 or below 1 standard"
            " deviations is not worked out; change threshold_sigma or false_alarm_probability"
        )
    return float(cfar_loss(ndtr(-threshold), plane.reference_cells))


def blur_rad(plane: FocalPlaneConfig) -> float:
    """Return the width of spots besides diffraction, rad: blur, jitter and drift."""
    smear = plane.drift_urad_s * plane.integration_time_ms * 1e-3
    return float(blurred_sigma_rad(plane.blur_urad * 1e-6, plane.jitter_urad * 1e-6, smear * 1e-6))


def _frames(plane: FocalPlaneConfig, pixel_rad: float) -> FrameDifference | None:
    if plane.temporal_filter == "none":
        return None
    per_pixel = 1e-6 / pixel_rad
    return FrameDifference(
        plane.lag_s, plane.registration_urad * per_pixel, plane.drift_urad_s * per_pixel
    )
