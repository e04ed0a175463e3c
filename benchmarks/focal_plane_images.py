"""Frames of a focal plane, pixel by pixel: the reference of the closed forms, with which it shares
no code.

A background with structure is a random field of cells, `SUB` × `SUB` to a pixel, made by the fast
Fourier transform of white noise. It is moved by a phase ramp, blurred with a sampled Gaussian,
added up pixel by pixel, and counted: Poisson electrons and normal read noise. Two frames are
subtracted, filters are applied at places `STEP` pixels apart, targets are drawn onto such places
with all sub-pixel phases. Lengths are in pixels, light in electrons.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

Floats = NDArray[np.float64]

#: Pixels along a frame, cells along a pixel, pixels from one filtered place to the next.
PIXELS = 32
SUB = 5
STEP = 8
#: Frames made at once.
_BATCH = 25
#: Samples of a spot along a pixel, for its shares.
_SAMPLES = 24


class Images(NamedTuple):
    """What frames are made of.

    Width of the spot, structure's scale, exponent and standard deviation, mean background, read
    noise, registration error of a frame along each axis, drift between two frames; whether these
    are subtracted; the filter's weights (m, m); the electrons of a target.
    """

    spot: float
    scale: float
    exponent: float
    structure_e: float
    background_e: float
    read_e: float
    registration: float
    drift: float
    is_difference: bool
    weights: Floats
    target_e: float


class Outputs(NamedTuple):
    """Outputs of the filter (frames, places): without and with a target, the targets' phases
    (frames, places, 2).

    `moved` (frames,) are the distances between the two frames, with drift and registration errors.
    """

    empty: Floats
    target: Floats
    phase: Floats
    moved: Floats


def filtered(images: Images, frames: int, rng: np.random.Generator) -> Outputs:
    """Return the outputs of a filter over frames, or differences of two."""
    parts = [_batch(images, min(_BATCH, frames - start), rng) for start in range(0, frames, _BATCH)]
    return Outputs(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _batch(images: Images, frames: int, rng: np.random.Generator) -> Outputs:
    field = _field(images, frames, rng)
    turn = rng.uniform(0.0, 2.0 * np.pi, frames)
    drift = images.drift * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    off = images.registration * rng.normal(size=(2, frames, 2))
    now = _windows(_seen(images, field, off[0]), len(images.weights))
    places = now.shape[1]
    phase = rng.uniform(-0.5, 0.5, (frames, places, 2))
    spots = images.target_e * shares(images.spot, phase.reshape(-1, 2), len(images.weights))
    with_target = _counted(images, now + spots.reshape(now.shape), rng)
    empty = _counted(images, now, rng)
    if images.is_difference:
        before = _counted(
            images, _windows(_seen(images, field, off[1] + drift), len(images.weights)), rng
        )
        empty = empty - before
        with_target = with_target - before
    sums = [(each * images.weights).sum(axis=(2, 3)) for each in (empty, with_target)]
    return Outputs(sums[0], sums[1], phase, np.linalg.norm(off[1] + drift - off[0], axis=1))


def _field(images: Images, frames: int, rng: np.random.Generator) -> NDArray[np.complex64]:
    """Return the transforms of fields of cells, each the mean of the radiance in it."""
    cells = PIXELS * SUB
    x = 2.0 * np.pi * SUB * np.fft.fftfreq(cells)[:, None]
    y = 2.0 * np.pi * SUB * np.fft.rfftfreq(cells)
    power = (1.0 + (x * x + y * y) * images.scale**2) ** (-0.5 * images.exponent)
    # The integral of the power over all wavenumbers, of which those of the frame are a lattice.
    whole = 2.0 * np.pi / (images.scale**2 * (images.exponent - 2.0))
    power *= (2.0 * np.pi / PIXELS) ** 2 / whole * cells**2
    mean = np.sinc(x / (2.0 * np.pi * SUB)) * np.sinc(y / (2.0 * np.pi * SUB))
    # Single precision is a millionth of the structure.
    white = fft.rfft2(rng.standard_normal((frames, cells, cells), dtype=np.float32))
    return np.asarray(white * (images.structure_e * np.sqrt(power) * mean).astype(np.float32))


def _seen(images: Images, field: NDArray[np.complex64], off: Floats) -> Floats:
    """Return the electrons that pixels expect (frames, PIXELS, PIXELS) of fields moved by (frames,
    2).
    """
    cells = PIXELS * SUB
    x = 2.0 * np.pi * SUB * np.fft.fftfreq(cells)[:, None]
    y = 2.0 * np.pi * SUB * np.fft.rfftfreq(cells)
    moved = field * np.exp(-1j * x * off[:, :1, None]).astype(field.dtype)
    moved *= np.exp(-1j * y * off[:, 1:, None]).astype(field.dtype)
    distance = np.minimum(np.arange(cells), cells - np.arange(cells)) / SUB
    kernel = np.exp(-0.5 * np.square(distance / images.spot))
    kernel /= kernel.sum()
    moved *= fft.rfft2(np.outer(kernel, kernel)).astype(field.dtype)
    blurred = fft.irfft2(moved, s=(cells, cells))
    pixels = blurred.reshape(len(off), PIXELS, SUB, PIXELS, SUB).mean(axis=(2, 4), dtype=np.float64)
    return np.maximum(pixels + images.background_e, 0.0)


def _windows(frames: Floats, width: int) -> Floats:
    """Return the windows (frames, places, width, width) to which a filter is applied."""
    starts = np.arange(0, PIXELS - width + 1, STEP)
    rows = starts[:, None] + np.arange(width)
    cut = frames[:, rows][:, :, :, rows].transpose(0, 1, 3, 2, 4)
    return cut.reshape(len(frames), len(starts) ** 2, width, width)


def _counted(images: Images, expected_e: Floats, rng: np.random.Generator) -> Floats:
    return rng.poisson(expected_e) + images.read_e * rng.normal(size=expected_e.shape)


def shares(spot: float, phase: Floats, width: int) -> Floats:
    """Return the shares (n, width, width) of spots (n, 2) about the centre of a window, by sums
    over samples.
    """
    place = (np.arange(width * _SAMPLES) + 0.5) / _SAMPLES - 0.5 * width
    along, across = (
        np.exp(-0.5 * np.square((place - phase[:, axis, None]) / spot))
        .reshape(-1, width, _SAMPLES)
        .sum(axis=2)
        / (_SAMPLES * spot * np.sqrt(2.0 * np.pi))
        for axis in (0, 1)
    )
    return along[:, :, None] * across[:, None, :]


def centroid_errors(
    spot: float,
    noise_e: float,
    target_e: float,
    frames: int,
    rng: np.random.Generator,
    width: int = 11,
) -> Floats:
    """Return errors (frames, 2), pixels, of places fitted to images of spots by maximum likelihood.

    Brightness and spot are known. `noise_e` is normal noise of a pixel, to which Poisson noise of
    the target adds.
    """
    phase = rng.uniform(-0.5, 0.5, (frames, 2))
    image = rng.poisson(target_e * shares(spot, phase, width)) + noise_e * rng.normal(
        size=(frames, width, width)
    )
    found = phase.copy()
    step = 1e-4
    for _ in range(12):
        expected = target_e * shares(spot, found, width)
        slopes = [
            target_e
            * (shares(spot, found + move, width) - shares(spot, found - move, width))
            / (2.0 * step)
            for move in (np.array([step, 0.0]), np.array([0.0, step]))
        ]
        weight = 1.0 / (noise_e**2 + expected)
        left = (image - expected) * weight
        # The score of normal noise whose variance depends on the place.
        left += 0.5 * (np.square(image - expected) * weight - 1.0) * weight
        score = np.stack([(slope * left).sum(axis=(1, 2)) for slope in slopes], axis=1)
        normal = np.array(
            [[(a * b * weight).sum(axis=(1, 2)) for a in slopes] for b in slopes]
        ).transpose(2, 0, 1)
        found += np.clip(np.linalg.solve(normal, score[..., None])[..., 0], -0.2, 0.2)
    return found - phase
