"""One frame of a focal plane with a target before the background, in electrons, and its mask.

The background is a Gaussian field with the spectrum of the scene's structure, the target the
sensor's point spread in the middle of a square pixel, and each pixel's count has the noise of its
electrons, of reading and of conversion.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen
from opir_photons.detection import blur_rad, unlit_electrons_per_s
from opir_photons.radiometry import (
    PointSpread,
    conversion_noise_electrons,
    electrons_per_w_m2,
    structure_spectrum,
)

from opir_bench.stand import Bench, Poses
from opir_core.arrays import BoolArray, FloatArray
from opir_core.errors import ModelError
from opir_core.geometry import components, length
from opir_core.output import OutputFiles
from opir_core.plugin import FocalPlaneConfig

#: The fewest pixels along a side of a frame, and the share of a target's brightest pixel from which
#: one is in its mask.
_FEWEST = 16
_MASKED = 0.05
#: Pixels along the square that a spot is worked out in; beyond it are less than a hundredth of its
#: light.
_WIDEST_SPOT = 32


@frozen(eq=False)
class FocalFrame:
    """A frame of one band: electrons (rows, columns), and its target, background and mask.

    `target` and `background` are electrons without noise.
    """

    band: str
    electrons: FloatArray
    target: FloatArray
    background: FloatArray
    mask: BoolArray
    title: str


@frozen(eq=False)
class FocalArray:
    """Optics, detectors and background that all frames of one band of a sensor share.

    `background_w_m2_sr` (pixels, pixels) is blurred by point spread and pixels.
    """

    band: str
    plane: FocalPlaneConfig
    pixel_rad: float
    electrons_per_w_m2: float
    unlit_e: float
    spread: PointSpread
    background_w_m2_sr: FloatArray

    @classmethod
    def of(
        cls, bench: Bench, poses: Poses, pixels: int, band: int, rng: np.random.Generator
    ) -> "FocalArray":
        """Return a square of pixels of a band, with the background behind the first target.

        Raises `ModelError` for a sensor without a focal plane.
        """
        radiometer = bench.sensor.radiometer
        if not bench.planes or radiometer is None:
            raise ModelError(
                f"{bench.sensor.id} has no focal plane, so no frames; add --set"
                f" 'sensors[0].focal_plane=notional'"
            )
        if pixels < _FEWEST:
            raise ModelError(f"--pixels: give at least {_FEWEST}")
        settings = bench.sensor.bands[band]
        plane = bench.planes[band]
        middle_um = 0.5 * (settings.lower_um + settings.upper_um)
        time_s = plane.integration_time_ms * 1e-3
        optics = (
            plane.aperture_m,
            plane.optics_transmission,
            plane.quantum_efficiency * plane.fill_factor,
        )
        per_unit = float(electrons_per_w_m2(middle_um, *optics, time_s))
        pixel_rad = radiometer.ifov_rad
        spread = PointSpread.of(middle_um, plane.aperture_m, blur_rad(plane), pixel_rad)
        unlit = unlit_electrons_per_s(plane, settings, pixel_rad) * time_s
        behind = _background(bench, poses, band, pixels, pixel_rad, spread, rng)
        return cls(settings.name, plane, pixel_rad, per_unit, unlit, spread, behind)

    def background_e(self, shift: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
        """Return the electrons (pixels, pixels) of the background, shifted by rows and columns.

        The background is periodic.
        """
        radiance = (
            self.background_w_m2_sr
            if shift == (0.0, 0.0)
            else _shifted(self.background_w_m2_sr, shift)
        )
        return np.maximum(radiance, 0.0) * self.pixel_rad**2 * self.electrons_per_w_m2

    def target_e(self, light_w_m2: float, place: tuple[float, float]) -> FloatArray:
        """Return the electrons (pixels, pixels) of a target of an irradiance at a row and column, 0
        in the middle of the first pixel."""
        return (
            light_w_m2
            * self.electrons_per_w_m2
            * _spot(len(self.background_w_m2_sr), self.spread, place)
        )

    def noise_e(self, mean_e: FloatArray) -> FloatArray:
        """Return the standard deviations of pixels with mean electrons of light: photons, unlit,
        reads, conversion.
        """
        plane = self.plane
        read = np.hypot(
            plane.read_noise_e, conversion_noise_electrons(plane.well_capacity_e, plane.bits)
        )
        return np.sqrt(mean_e + self.unlit_e + plane.subframes * read**2)

    def exposed_e(self, mean_e: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return the electrons that pixels with mean electrons of light count in one frame, up to
        full wells.
        """
        counted = mean_e + self.unlit_e + self.noise_e(mean_e) * rng.standard_normal(mean_e.shape)
        return np.clip(counted, 0.0, self.plane.well_capacity_e * self.plane.subframes)


def frame(
    bench: Bench, poses: Poses, pixels: int = 128, seed: int = 1, band: int = 0
) -> FocalFrame:
    """Return a frame of a square of pixels with one posed target in its middle.

    Raises `ModelError` for a sensor without a focal plane.
    """
    rng = np.random.default_rng(seed)
    array = FocalArray.of(bench, poses, pixels, band, rng)
    background = array.background_e()
    middle = float(pixels // 2)
    target = array.target_e(float(bench.light_w_m2(poses)[0, band]), (middle, middle))
    electrons = array.exposed_e(target + background, rng)
    title = (
        f"{bench.sensor.id}, {array.band}: {poses.target_class} at {1e-3 * poses.height_m[0]:g} km"
    )
    return FocalFrame(array.band, electrons, target, background, is_lit(target), title)


def is_lit(target: FloatArray) -> BoolArray:
    """Return the mask of a target: pixels with a share of its brightest pixel's light."""
    return np.asarray(target > _MASKED * target.max(initial=0.0))


def _spot(pixels: int, spread: PointSpread, place: tuple[float, float]) -> FloatArray:
    """Return the shares (pixels, pixels) of a spot's light at a row and column of the frame."""
    wide = min(pixels, _WIDEST_SPOT)
    middle = np.round(place).astype(np.int64)
    shares = _spot_shares(wide, spread, np.subtract(place, middle))
    spot = np.zeros((pixels, pixels))
    corner = middle - wide // 2
    low = np.maximum(corner, 0)
    high = np.minimum(corner + wide, pixels)
    if np.all(low < high):
        inside = tuple(
            slice(start, stop) for start, stop in zip(low - corner, high - corner, strict=True)
        )
        spot[low[0] : high[0], low[1] : high[1]] = np.maximum(shares[inside], 0.0)
    return spot


def _spot_shares(pixels: int, spread: PointSpread, shift: FloatArray) -> FloatArray:
    """Return the shares (pixels, pixels) of a spot that is shifted by parts of a pixel (2,).

    The transform is over a finer grid, which resolves all that the aperture passes.
    """
    fine = math.ceil(spread.limit / math.pi)
    band_limit = 2.0 * math.pi * fine
    wavenumber = np.fft.fftfreq(pixels * fine)
    rows, columns = (np.exp(-1j * band_limit * wavenumber * by) for by in shift.tolist())
    transfer = _transfer(pixels * fine, band_limit, spread) * rows[:, None] * columns[None, :]
    return np.fft.fftshift(np.fft.ifft2(transfer).real[::fine, ::fine]) * fine**2


def _shifted(field: FloatArray, shift: tuple[float, float]) -> FloatArray:
    """Return a periodic field (rows, columns), shifted by rows and columns."""
    down, across = (np.fft.fftfreq(size) * by for size, by in zip(field.shape, shift, strict=True))
    turn = np.exp(-2j * np.pi * (down[:, None] + across[None, :]))
    return np.asarray(np.fft.ifft2(np.fft.fft2(field) * turn).real)


def _transfer(count: int, band_limit: float, spread: PointSpread) -> FloatArray:
    """Return the transfer (count, count) of spot and pixel, wavenumbers up to `band_limit` / 2."""
    wavenumber = band_limit * np.fft.fftfreq(count)
    pixel = np.sinc(0.5 * wavenumber / np.pi)
    return (
        spread.transfer(np.hypot(wavenumber[:, None], wavenumber[None, :]))
        * pixel[:, None]
        * pixel[None, :]
    )


def _field(
    pixels: int, scale: float, exponent: float, spread: PointSpread, rng: np.random.Generator
) -> FloatArray:
    """Return a random field (pixels, pixels) with the spectrum of structure of unit variance.

    `scale` is in pixels; the field is blurred by point spread and pixel. Structure wider than the
    frame is left out.
    """
    wavenumber = 2.0 * np.pi * np.fft.fftfreq(pixels)
    power = structure_spectrum(np.hypot(wavenumber[:, None], wavenumber[None, :]), scale, exponent)
    power[0, 0] = 0.0
    transfer = np.sqrt(power) * _transfer(pixels, 2.0 * math.pi, spread)
    return np.real(np.fft.ifft2(np.fft.fft2(rng.standard_normal((pixels, pixels))) * transfer))


def _background(
    bench: Bench,
    poses: Poses,
    band: int,
    pixels: int,
    pixel_rad: float,
    spread: PointSpread,
    rng: np.random.Generator,
) -> FloatArray:
    """Return radiances of pixels (pixels, pixels) behind a target, W m⁻² sr⁻¹."""
    model, looks = bench.model(poses)
    environment: Any = getattr(model, "environment", None)
    if environment is None or not environment.has_background:
        return np.zeros((pixels, pixels))
    background = environment.background
    number = environment.bands.index(bench.sensor.bands[band])
    views = environment.views(looks)
    if not background.structures:
        return np.full((pixels, pixels), background.radiances_w_m2_sr([number], views)[0][0])
    radiance, rms, kind = background.structured_radiances_w_m2_sr([number], views)
    structure = background.structures[int(kind[0])]
    range_m = length(*components(views.point_ecef_m - looks.sensor_ecef_m))
    scale = structure.scale_m / (float(range_m[0]) * pixel_rad)
    return radiance[0, 0] + rms[0, 0] * _field(pixels, scale, structure.exponent, spread, rng)


def write_frame(focal_frame: FocalFrame, folder: Path) -> list[Path]:
    """Write a frame as PNG and as arrays (`frame.npz`); return the files."""
    paths = [folder / "frame.png", folder / "frame.npz"]
    with OutputFiles(folder=folder) as files:
        with files.writing(paths[0], "frame") as file_part:
            _write_picture(focal_frame, file_part)
        with files.writing(paths[1], "frame") as file_part, file_part.open("wb") as stream:
            arrays = {
                name: getattr(focal_frame, name)
                for name in ("electrons", "target", "background", "mask")
            }
            np.savez_compressed(stream, **arrays)
    return paths


def _write_picture(focal_frame: FocalFrame, path: Path) -> None:
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from opir_report import STYLE

    with matplotlib.rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(5.2, 4.2), layout="constrained", dpi=150)
        FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        millions = 1e-6 * focal_frame.electrons
        low, high = np.percentile(focal_frame.electrons, (0.5, 99.5)) * 1e-6
        image = axes.imshow(millions, cmap="cividis", interpolation="nearest", vmin=low, vmax=high)
        axes.set(title=focal_frame.title, xlabel="column, pixels", ylabel="row, pixels")
        figure.colorbar(image, label="electrons, millions", extend="both")
        figure.savefig(path, format="png")
