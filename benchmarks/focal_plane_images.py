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
from scipy import fft

#: Pixels along a frame, cells along a pixel, pixels from one filtered place to the next.
PIXELS = 32
SUB = 5
STEP = 8
#: Samples of a spot along a pixel, for its shares.
SAMPLES = 24


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
    weights: np.ndarray
    target_e: float


class Outputs(NamedTuple):
    """Outputs of the filter (frames, places): without and with a target, the targets' phases
    (frames, places, 2).

    `moved` (frames,) are the distances between the two frames, with drift and registration errors.
    """

    empty: np.ndarray
    target: np.ndarray
    phase: np.ndarray
    moved: np.ndarray


def filtered(images, frames, rng):
    """Return the outputs of a filter over frames, or differences of two."""
    batches = [_batch(images, min(25, frames - start), rng) for start in range(0, frames, 25)]
    return Outputs(*(np.concatenate(columns) for columns in zip(*batches, strict=True)))


def _batch(images, frames, rng):
    field = _field(images, frames, rng)
    turn = rng.uniform(0.0, 2.0 * np.pi, frames)
    drift = images.drift * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    first, second = images.registration * rng.normal(size=(2, frames, 2))
    second += drift
    pixels = _windows(_seen(images, field, first), len(images.weights))
    places = pixels.shape[1]
    phase = rng.uniform(-0.5, 0.5, (frames, places, 2))
    spots = images.target_e * shares(images.spot, phase.reshape(-1, 2), len(images.weights))
    with_target = _counted(images, pixels + spots.reshape(pixels.shape), rng)
    empty = _counted(images, pixels, rng)
    if images.is_difference:
        moved = _windows(_seen(images, field, second), len(images.weights))
        reference = _counted(images, moved, rng)
        empty = empty - reference
        with_target = with_target - reference
    sums = [(frame * images.weights).sum(axis=(2, 3)) for frame in (empty, with_target)]
    return Outputs(*sums, phase, np.linalg.norm(second - first, axis=1))


def _wave_numbers(cells):
    """Return the wave numbers of cells along both axes, radians a pixel."""
    scale = 2.0 * np.pi * SUB
    return scale * np.fft.fftfreq(cells)[:, None], scale * np.fft.rfftfreq(cells)


def _field(images, frames, rng):
    """Return the transforms of fields of cells, each the mean of the radiance in it."""
    cells = PIXELS * SUB
    x, y = _wave_numbers(cells)
    power = (1.0 + (x * x + y * y) * images.scale**2) ** (-0.5 * images.exponent)
    # The integral of the power over all wavenumbers, of which those of the frame are a lattice.
    integral = 2.0 * np.pi / (images.scale**2 * (images.exponent - 2.0))
    power *= (2.0 * np.pi / PIXELS) ** 2 / integral * cells**2
    mean = np.sinc(x / (2.0 * np.pi * SUB)) * np.sinc(y / (2.0 * np.pi * SUB))
    # Single precision is a millionth of the structure.
    white = fft.rfft2(rng.standard_normal((frames, cells, cells), dtype=np.float32))
    return np.asarray(white * (images.structure_e * np.sqrt(power) * mean).astype(np.float32))


def _seen(images, field, shift):
    """Return the electrons that pixels expect (frames, PIXELS, PIXELS) of fields moved by (frames,
    2).
    """
    cells = PIXELS * SUB
    x, y = _wave_numbers(cells)
    moved = field * np.exp(-1j * x * shift[:, :1, None]).astype(field.dtype)
    moved *= np.exp(-1j * y * shift[:, 1:, None]).astype(field.dtype)
    distance = np.minimum(np.arange(cells), cells - np.arange(cells)) / SUB
    kernel = np.exp(-0.5 * np.square(distance / images.spot))
    kernel /= kernel.sum()
    moved *= fft.rfft2(np.outer(kernel, kernel)).astype(field.dtype)
    blurred = fft.irfft2(moved, s=(cells, cells))
    pixels = blurred.reshape(len(shift), PIXELS, SUB, PIXELS, SUB).mean(
        axis=(2, 4), dtype=np.float64
    )
    return np.maximum(pixels + images.background_e, 0.0)


def _windows(frames, width):
    """Return the windows (frames, places, width, width) to which a filter is applied."""
    starts = np.arange(0, PIXELS - width + 1, STEP)
    rows = starts[:, None] + np.arange(width)
    cut = frames[:, rows][:, :, :, rows].transpose(0, 1, 3, 2, 4)
    return cut.reshape(len(frames), len(starts) ** 2, width, width)


def _counted(images, expected_e, rng):
    return rng.poisson(expected_e) + images.read_e * rng.normal(size=expected_e.shape)


def shares(spot, phase, width):
    """Return the shares (n, width, width) of spots (n, 2) about the centre of a window, by sums
    over samples.
    """
    place = (np.arange(width * SAMPLES) + 0.5) / SAMPLES - 0.5 * width
    along, across = (
        np.exp(-0.5 * np.square((place - phase[:, axis, None]) / spot))
        .reshape(-1, width, SAMPLES)
        .sum(axis=2)
        / (SAMPLES * spot * np.sqrt(2.0 * np.pi))
        for axis in (0, 1)
    )
    return along[:, :, None] * across[:, None, :]


def centroid_errors(
    spot,
    noise_e,
    target_e,
    frames,
    rng,
    width=11,
):
    """Return errors (frames, 2), pixels, of places fitted to images of spots by maximum likelihood.

    Brightness and spot are known. `noise_e` is normal noise of a pixel, to which Poisson noise of
    the target adds.
    """
    phase = rng.uniform(-0.5, 0.5, (frames, 2))
    image = rng.poisson(target_e * shares(spot, phase, width)) + noise_e * rng.normal(
        size=(frames, width, width)
    )
    place = phase.copy()
    step = 1e-4
    for _ in range(12):
        expected = target_e * shares(spot, place, width)
        slopes = [
            target_e
            * (shares(spot, place + move, width) - shares(spot, place - move, width))
            / (2.0 * step)
            for move in step * np.eye(2)
        ]
        weight = 1.0 / (noise_e**2 + expected)
        residual = (image - expected) * weight
        # The score of normal noise whose variance depends on the place.
        residual += 0.5 * (np.square(image - expected) * weight - 1.0) * weight
        score = np.stack([(slope * residual).sum(axis=(1, 2)) for slope in slopes], axis=1)
        normal = [[(a * b * weight).sum(axis=(1, 2)) for a in slopes] for b in slopes]
        step_px = np.linalg.solve(np.moveaxis(normal, 2, 0), score[..., None])[..., 0]
        place += np.clip(step_px, -0.2, 0.2)
    return place - phase
