"""One frame of a focal plane with a target before the background, in electrons, with a mask of the target.

The background is a Gaussian field with the spectrum of the scene's structure, the target the sensor's point spread in
the middle of a square pixel, and each pixel's count has the noise of its electrons, of reading and of conversion.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen
from numpy.typing import NDArray
from opir_photons.detection import blur_rad, unlit_electrons_per_s
from opir_photons.radiometry import PointSpread, conversion_noise_electrons, electrons_per_w_m2, structure_spectrum

from opir_core.arrays import FloatArray
from opir_core.errors import ModelError
from opir_core.geometry import components, length
from opir_core.output import OutputFiles
from opir_coverage.bench.stand import Bench, Poses

#: The fewest pixels along a side of a frame, and the share of a target's brightest pixel from which one is in its mask.
_FEWEST, _MASKED = 16, 0.05
#: Pixels along the square that a spot is worked out in; beyond it are less than a hundredth of its light.
_WIDEST_SPOT = 32


@frozen(eq=False)
class FocalFrame:
    """A frame of one band: electrons (rows, columns), those of target and background before noise, and a mask."""

    band: str
    electrons: FloatArray
    target: FloatArray
    background: FloatArray
    mask: NDArray[np.bool_]
    title: str


def frame(bench: Bench, poses: Poses, pixels: int = 128, seed: int = 1, band: int = 0) -> FocalFrame:
    """Return a frame of a square of pixels with one posed target in its middle; of a sensor with a focal plane."""
    radiometer = bench.sensor.radiometer
    if not bench.planes or radiometer is None:
        raise ModelError(
            f"{bench.sensor.id} has no focal plane, so no frames; add --set 'sensors[0].focal_plane=notional'"
        )
    if pixels < _FEWEST:
        raise ModelError(f"--pixels: give at least {_FEWEST}")
    own, plane = bench.sensor.bands[band], bench.planes[band]
    middle_um, time_s = 0.5 * (own.lower_um + own.upper_um), plane.integration_time_ms * 1e-3
    optics = plane.aperture_m, plane.optics_transmission, plane.quantum_efficiency * plane.fill_factor
    per_unit = float(electrons_per_w_m2(middle_um, *optics, time_s))
    pixel_rad, rng = radiometer.ifov_rad, np.random.default_rng(seed)
    spread = PointSpread.of(middle_um, plane.aperture_m, blur_rad(plane), pixel_rad)
    behind = _background(bench, poses, band, pixels, spread, rng)
    background = np.maximum(behind, 0.0) * pixel_rad**2 * per_unit
    spot = _spot(pixels, spread)
    target = float(bench.light_w_m2(poses)[0, band]) * per_unit * spot
    mean = target + background + unlit_electrons_per_s(plane, own, pixel_rad) * time_s
    read = np.hypot(plane.read_noise_e, conversion_noise_electrons(plane.well_capacity_e, plane.bits))
    electrons = mean + np.sqrt(mean + plane.subframes * read**2) * rng.standard_normal(mean.shape)
    well = plane.well_capacity_e * plane.subframes
    title = f"{bench.sensor.id}, {own.name}: {poses.target_class} at {1e-3 * poses.height_m[0]:g} km"
    return FocalFrame(own.name, np.clip(electrons, 0.0, well), target, background, spot > _MASKED * spot.max(), title)


def _spot(pixels: int, spread: PointSpread) -> FloatArray:
    """Return the shares (pixels, pixels) of a spot in the middle of a pixel: their sum is 1.

    By a transform over a finer grid that resolves all that the aperture passes.
    """
    wide = min(pixels, _WIDEST_SPOT)
    fine = math.ceil(spread.most / math.pi)
    shares = np.fft.ifft2(_transfer(wide * fine, 2.0 * math.pi * fine, spread)).real[::fine, ::fine] * fine**2
    spot, first = np.zeros((pixels, pixels)), pixels // 2 - wide // 2
    spot[first : first + wide, first : first + wide] = np.fft.fftshift(shares)
    return spot


def _transfer(count: int, most: float, spread: PointSpread) -> FloatArray:
    """Return the transfer of spot and pixel on the wavenumbers (count, count) of a transform, up to `most` / 2."""
    wavenumber = most * np.fft.fftfreq(count)
    pixel = np.sinc(0.5 * wavenumber / np.pi)
    return spread.transfer(np.hypot(wavenumber[:, None], wavenumber[None, :])) * pixel[:, None] * pixel[None, :]


def _field(pixels: int, scale: float, exponent: float, spread: PointSpread, rng: np.random.Generator) -> FloatArray:
    """Return a field with the spectrum of structure of unit variance and a scale in pixels, as spot and pixel show it.

    Structure wider than the frame is left out.
    """
    wavenumber = 2.0 * np.pi * np.fft.fftfreq(pixels)
    power = structure_spectrum(np.hypot(wavenumber[:, None], wavenumber[None, :]), scale, exponent)
    power[0, 0] = 0.0
    seen = np.sqrt(power) * _transfer(pixels, 2.0 * math.pi, spread)
    return np.real(np.fft.ifft2(np.fft.fft2(rng.standard_normal((pixels, pixels))) * seen))


def _background(
    bench: Bench, poses: Poses, band: int, pixels: int, spread: PointSpread, rng: np.random.Generator
) -> FloatArray:
    """Return radiances of pixels (pixels, pixels) behind a target, W m⁻² sr⁻¹."""
    model, looks = bench.model(poses)
    environment: Any = getattr(model, "environment", None)
    if environment is None or not environment.has_background:
        return np.zeros((pixels, pixels))
    background, number = environment.background, environment.bands.index(bench.sensor.bands[band])
    views = environment.views(looks)
    if not background.structures:
        return np.full((pixels, pixels), background.radiances_w_m2_sr([number], views)[0][0])
    radiance, rms, kind = background.structured_radiances_w_m2_sr([number], views)
    structure, radiometer = background.structures[int(kind[0])], bench.sensor.radiometer
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
            image = axes.imshow(1e-6 * made.electrons, cmap="cividis", interpolation="nearest", vmin=low, vmax=high)
            axes.set(title=made.title, xlabel="column, pixels", ylabel="row, pixels")
            figure.colorbar(image, label="electrons, millions", extend="both")
            with files.writing(paths[0], "frame") as part:
                figure.savefig(part, format="png")
        with files.writing(paths[1], "frame") as part, part.open("wb") as stream:
            arrays = {name: getattr(made, name) for name in ("electrons", "target", "background", "mask")}
            np.savez_compressed(stream, **arrays)
    return paths
