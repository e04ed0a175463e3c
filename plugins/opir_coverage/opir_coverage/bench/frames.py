"""One frame of a focal plane with a target before the background, in electrons, with a mask of the
target.

The background is a Gaussian field with the spectrum of the scene's structure, the target the
sensor's point spread in the middle of a square pixel, and each pixel's count has the noise of its
electrons, of reading and of conversion.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen
from numpy.typing import NDArray
from opir_photons.detection import blur_rad, unlit_electrons_per_s
from opir_photons.radiometry import (
    PointSpread,
    conversion_noise_electrons,
    electrons_per_w_m2,
    structure_spectrum,
)

from opir_core.arrays import FloatArray
from opir_core.errors import ModelError
from opir_core.geometry import components, length
from opir_core.output import OutputFiles
from opir_core.plugin import FocalPlaneConfig
from opir_coverage.bench.stand import Bench, Poses

#: The fewest pixels along a side of a frame, and the share of a target's brightest pixel from which
#: one is in its mask.
_FEWEST = 16
_MASKED = 0.05
#: Pixels along the square that a spot is worked out in; beyond it are less than a hundredth of its
#: light.
_WIDEST_SPOT = 32


@frozen(eq=False)
class FocalFrame:
    """A frame of one band: electrons (rows, columns), those of target and background before noise,
    and a mask.
    """

    band: str
    electrons: FloatArray
    target: FloatArray
    background: FloatArray
    mask: NDArray[np.bool_]
    title: str


@frozen(eq=False)
class FocalArray:
    """What frames of one band of a sensor have in common: its optics and detectors, and the
    background behind a target.

    `background_w_m2_sr` (pixels, pixels) is as spot and pixels show it.
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
        """Return a square of pixels of a band, with the background behind the first target; of a
        sensor with one.
        """
        radiometer = bench.sensor.radiometer
        if not bench.planes or radiometer is None:
            raise ModelError(
                f"{bench.sensor.id} has no focal plane, so no frames; add --set"
                f" 'sensors[0].focal_plane=notional'"
            )
        if pixels < _FEWEST:
            raise ModelError(f"--pixels: give at least {_FEWEST}")
        own = bench.sensor.bands[band]
        plane = bench.planes[band]
        middle_um = 0.5 * (own.lower_um + own.upper_um)
        time_s = plane.integration_time_ms * 1e-3
        optics = (
            plane.aperture_m,
            plane.optics_transmission,
            plane.quantum_efficiency * plane.fill_factor,
        )
        per_unit = float(electrons_per_w_m2(middle_um, *optics, time_s))
        pixel_rad = radiometer.ifov_rad
        spread = PointSpread.of(middle_um, plane.aperture_m, blur_rad(plane), pixel_rad)
        unlit = unlit_electrons_per_s(plane, own, pixel_rad) * time_s
        behind = _background(bench, poses, band, pixels, spread, rng)
        return cls(own.name, plane, pixel_rad, per_unit, unlit, spread, behind)

    def background_e(self, shift: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
        """Return the electrons (pixels, pixels) of the background, shifted by rows and columns;
        what leaves comes in again at the other side."""
        seen = (
            self.background_w_m2_sr
            if shift == (0.0, 0.0)
            else _shifted(self.background_w_m2_sr, shift)
        )
        return np.maximum(seen, 0.0) * self.pixel_rad**2 * self.electrons_per_w_m2

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
    """Return a frame of a square of pixels with one posed target in its middle; of a sensor with a
    focal plane.
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


def is_lit(target: FloatArray) -> NDArray[np.bool_]:
    """Return which pixels are in a target's mask: those with enough of its brightest pixel's
    light.
    """
    return np.asarray(target > _MASKED * target.max(initial=0.0))


def _spot(pixels: int, spread: PointSpread, place: tuple[float, float]) -> FloatArray:
    """Return the shares (pixels, pixels) of a spot at a row and column; what falls beside the frame
    is lost.

    By a transform over a finer grid that resolves all that the aperture passes.
    """
    wide = min(pixels, _WIDEST_SPOT)
    fine = math.ceil(spread.most / math.pi)
    whole = np.round(place).astype(np.int64)
    most = 2.0 * math.pi * fine
    phase = [
        np.exp(-1j * most * np.fft.fftfreq(wide * fine) * rest)
        for rest in np.subtract(place, whole).tolist()
    ]
    transfer = _transfer(wide * fine, most, spread) * phase[0][:, None] * phase[1][None, :]
    shares = np.fft.fftshift(np.fft.ifft2(transfer).real[::fine, ::fine]) * fine**2
    spot = np.zeros((pixels, pixels))
    first = whole - wide // 2
    low = np.maximum(first, 0)
    high = np.minimum(first + wide, pixels)
    if np.all(low < high):
        own = tuple(slice(one, other) for one, other in zip(low - first, high - first, strict=True))
        spot[low[0] : high[0], low[1] : high[1]] = np.maximum(shares[own], 0.0)
    return spot


def _shifted(field: FloatArray, shift: tuple[float, float]) -> FloatArray:
    """Return a field (rows, columns), as it goes on periodically, shifted by rows and columns."""
    down, across = (np.fft.fftfreq(size) * by for size, by in zip(field.shape, shift, strict=True))
    turn = np.exp(-2j * np.pi * (down[:, None] + across[None, :]))
    return np.asarray(np.fft.ifft2(np.fft.fft2(field) * turn).real)


def _transfer(count: int, most: float, spread: PointSpread) -> FloatArray:
    """Return the transfer of spot and pixel on the wavenumbers (count, count) of a transform, up to
    `most` / 2.
    """
    wavenumber = most * np.fft.fftfreq(count)
    pixel = np.sinc(0.5 * wavenumber / np.pi)
    return (
        spread.transfer(np.hypot(wavenumber[:, None], wavenumber[None, :]))
        * pixel[:, None]
        * pixel[None, :]
    )


def _field(
    pixels: int, scale: float, exponent: float, spread: PointSpread, rng: np.random.Generator
) -> FloatArray:
    """Return a field with the spectrum of structure of unit variance and a scale in pixels, as spot
    and pixel show it.

    Structure wider than the frame is left out.
    """
    wavenumber = 2.0 * np.pi * np.fft.fftfreq(pixels)
    power = structure_spectrum(np.hypot(wavenumber[:, None], wavenumber[None, :]), scale, exponent)
    power[0, 0] = 0.0
    seen = np.sqrt(power) * _transfer(pixels, 2.0 * math.pi, spread)
    return np.real(np.fft.ifft2(np.fft.fft2(rng.standard_normal((pixels, pixels))) * seen))


def _background(
    bench: Bench,
    poses: Poses,
    band: int,
    pixels: int,
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
    radiometer = bench.sensor.radiometer
    assert radiometer is not None
    range_m = length(*components(views.point_ecef_m - looks.sensor_ecef_m))
    scale = structure.scale_m / (float(range_m[0]) * radiometer.ifov_rad)
    return radiance[0, 0] + rms[0, 0] * _field(pixels, scale, structure.exponent, spread, rng)


def write_frame(made: FocalFrame, folder: Path) -> list[Path]:
    """Write a frame as PNG and as arrays (`frame.npz`); return the files."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from opir_report import STYLE

    paths = [folder / "frame.png", folder / "frame.npz"]
    with OutputFiles(folder=folder) as files:
        with matplotlib.rc_context({**STYLE, "axes.grid": False}):
            figure = Figure(figsize=(5.2, 4.2), layout="constrained", dpi=150)
            FigureCanvasAgg(figure)
            axes = figure.add_subplot()
            low, high = np.percentile(made.electrons, (0.5, 99.5)) * 1e-6
            image = axes.imshow(
                1e-6 * made.electrons, cmap="cividis", interpolation="nearest", vmin=low, vmax=high
            )
            axes.set(title=made.title, xlabel="column, pixels", ylabel="row, pixels")
            figure.colorbar(image, label="electrons, millions", extend="both")
            with files.writing(paths[0], "frame") as part:
                figure.savefig(part, format="png")
        with files.writing(paths[1], "frame") as part, part.open("wb") as stream:
            arrays = {
                name: getattr(made, name) for name in ("electrons", "target", "background", "mask")
            }
            np.savez_compressed(stream, **arrays)
    return paths
