"""One frame of a focal plane with a target before the background, in electrons, with a mask of the target.

The background is a Gaussian field with the spectrum of the scene's structure, the target a Gaussian spot shared among
square pixels, and each pixel's count has the noise of its electrons and of reading.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen
from numpy.typing import NDArray
from opir_photons.radiometry import airy_sigma_rad, blurred_sigma_rad, electrons_per_w_m2, structure_spectrum
from scipy.special import erf

from opir_core.arrays import FloatArray
from opir_core.errors import ModelError
from opir_core.output import OutputFiles
from opir_coverage.bench.stand import Bench, Poses

#: The fewest pixels along a side of a frame, and the share of a target's brightest pixel from which one is in its mask.
_FEWEST, _MASKED = 16, 0.05


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
    plane, radiometer = bench.focal_plane(), bench.sensor.radiometer
    if not plane or radiometer is None:
        raise ModelError(
            f"{bench.sensor.id} has no focal plane, so no frames; add --set 'sensors[0].focal_plane=notional'"
        )
    if pixels < _FEWEST:
        raise ModelError(f"--pixels: give at least {_FEWEST}")
    own = bench.sensor.bands[band]
    middle_um, time_s = 0.5 * (own.lower_um + own.upper_um), plane["integration_time_ms"] * 1e-3
    optics = plane["aperture_m"], plane["optics_transmission"], plane["quantum_efficiency"]
    per_unit = float(electrons_per_w_m2(middle_um, *optics, time_s))
    pixel_rad, rng = radiometer.ifov_rad, np.random.default_rng(seed)
    found = bench.signals(poses)
    behind, rms, scale = _background(bench, poses, band)
    field = behind + rms * _field(pixels, scale / (float(found.range_m[0]) * pixel_rad), rng)
    background = np.maximum(field, 0.0) * pixel_rad**2 * per_unit
    spot = _spot(pixels, _width_rad(plane, middle_um, time_s) / pixel_rad)
    target = float(found.irradiance_w_m2[0, band]) * per_unit * spot
    dark = plane["dark_current_e_s"] * time_s
    read = plane["read_noise_e"] * np.sqrt(plane["subframes"])
    mean = target + background + dark
    electrons = mean + np.sqrt(mean + read * read) * rng.standard_normal(mean.shape)
    well = plane["well_capacity_e"] * plane["subframes"]
    title = f"{bench.sensor.id}, {own.name}: {poses.target_class} at {1e-3 * poses.height_m[0]:g} km"
    return FocalFrame(own.name, np.clip(electrons, 0.0, well), target, background, spot > _MASKED * spot.max(), title)


def _width_rad(plane: Mapping[str, Any], middle_um: float, time_s: float) -> float:
    blur = float(np.hypot(plane["blur_urad"], plane["jitter_urad"])) * 1e-6
    smear = plane["drift_urad_s"] * time_s * 1e-6
    return float(blurred_sigma_rad(airy_sigma_rad(middle_um, plane["aperture_m"]), blur, smear))


def _spot(pixels: int, sigma: float) -> FloatArray:
    """Return the shares of a spot in the middle of a pixel, of a width in pixels."""
    edge = (np.arange(pixels + 1) - pixels // 2 - 0.5) / (np.sqrt(2.0) * sigma)
    share = 0.5 * np.diff(erf(edge))
    return share[:, None] * share[None, :]


def _field(pixels: int, scale: float, rng: np.random.Generator) -> FloatArray:
    """Return a field of unit variance with the spectrum of structure of a scale in pixels; 0 without a scale."""
    if not scale > 0.0:
        return np.zeros((pixels, pixels))
    frequency = np.fft.fftfreq(pixels)
    across = np.hypot(frequency[:, None], frequency[None, :])
    power = structure_spectrum(2.0 * np.pi * across, scale, 3.0)
    power[0, 0] = 0.0
    white = np.fft.fft2(rng.standard_normal((pixels, pixels)))
    field = np.real(np.fft.ifft2(white * np.sqrt(power)))
    return np.asarray(field / field.std())


def _background(bench: Bench, poses: Poses, band: int) -> tuple[float, float, float]:
    """Return the radiance behind a target, its rms, W m⁻² sr⁻¹, and the scale of its structure, m."""
    model, looks = bench.model(poses)
    environment: Any = getattr(model, "environment", None)
    if environment is None or not environment.has_background:
        return 0.0, 0.0, 0.0
    background, number = environment.background, environment.bands.index(bench.sensor.bands[band])
    if not background.structures:
        return float(background.radiances_w_m2_sr([number], environment.views(looks))[0][0]), 0.0, 0.0
    radiance, rms, kind = background.structured_radiances_w_m2_sr([number], environment.views(looks))
    return float(radiance[0, 0]), float(rms[0, 0]), float(background.structures[int(kind[0])].scale_m)


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
