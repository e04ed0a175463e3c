"""Movies of frames with a target that flies through them, and what is in each frame.

A clip is what the focal plane sees at equal intervals: the background keeps still but for drift and
the error of registration, the target moves on a straight way and its plume changes with height and
burn, noise is new in each frame.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from attrs import evolve, frozen
from numpy.typing import NDArray

from opir_bench.frames import FocalArray, is_lit
from opir_bench.stand import Bench, PosedTargets, Poses
from opir_core.arrays import BoolArray, FloatArray
from opir_core.errors import ModelError
from opir_core.geometry import ecef_to_geodetic

#: Places of targets in the middle of a clip: within this share of the frame around its centre.
_AROUND = 0.5


@frozen(eq=False)
class Clip:
    """Frames of one band (N, rows, columns) in electrons, masks of the target, and (N,) of each
    frame its time, s, the target's row and column in pixels, irradiance at the aperture, W/m², and
    signal over noise of its brightest pixel.

    Row 0 is the first; places are those of pixels' middles. The signal is 0 where the target is
    beside the frame. `scale` is the factor on the target's light, 1 for the class's own.
    """

    sensor: str
    band: str
    target_class: str
    seed: int
    pixel_rad: float
    scale: float
    electrons: NDArray[np.float32]
    mask: BoolArray
    time_s: FloatArray
    row: FloatArray
    column: FloatArray
    light_w_m2: FloatArray
    snr: FloatArray

    def __len__(self) -> int:
        return len(self.time_s)

    def boxes(self) -> list[tuple[int, int, int, int] | None]:
        """Return first column and row, width and height of each frame's mask; None without one."""
        return [_box(mask) for mask in self.mask]


def _box(mask: BoolArray) -> tuple[int, int, int, int] | None:
    rows = np.flatnonzero(mask.any(axis=1))
    columns = np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    (first_row, last_row), (first_column, last_column) = (
        rows[[0, -1]].tolist(),
        columns[[0, -1]].tolist(),
    )
    return first_column, first_row, last_column - first_column + 1, last_row - first_row + 1


@frozen(kw_only=True)
class Filming:
    """How clips are made: frames, the time between them, s, pixels along a side, and the band by
    its number.

    With `snr`, two limits, light is scaled so that the signal over noise of the target's brightest
    pixel in the middle of the clip is between them, uniform in its logarithm.
    """

    frames: int
    every_s: float
    pixels: int = 128
    band: int = 0
    snr: tuple[float, float] | None = None

    def __attrs_post_init__(self) -> None:
        if self.frames < 1 or self.every_s <= 0.0:
            raise ModelError("--movie: give at least 1; --every: give a time above 0")
        if self.snr is not None and not 0.0 < self.snr[0] <= self.snr[1]:
            raise ModelError("--snr: give two numbers above 0, the smaller first")

    def times_s(self) -> FloatArray:
        """Return the times (frames,) of frames, s, from the middle of the clip."""
        return np.asarray((np.arange(self.frames) - 0.5 * (self.frames - 1)) * self.every_s)


def clip(bench: Bench, poses: Poses, filming: Filming, seed: int = 1) -> Clip:
    """Return the frames of one target at equal intervals; in the middle of them it has its pose."""
    rng = np.random.default_rng(seed)
    array = FocalArray.of(bench, poses, filming.pixels, filming.band, rng)
    time_s = filming.times_s()
    distance, flown = _flown(bench, poses, time_s, array.pixel_rad)
    turn = rng.uniform(0.0, 2.0 * math.pi)
    direction = np.array([math.cos(turn), math.sin(turn)])
    middle = 0.5 * (filming.pixels - 1) + _AROUND * filming.pixels * (rng.uniform(size=2) - 0.5)
    shift = _shifts(array, time_s, turn, rng)
    place = middle[:, None] + direction[:, None] * distance + shift
    light = bench.light_w_m2(flown)[:, filming.band]
    scale = _scale(array, float(light[filming.frames // 2]), middle, filming.snr, rng)
    electrons, mask, snr = _exposed(array, scale * light, place, shift, rng)
    optics = (bench.sensor.id, array.band, poses.target_class, seed, array.pixel_rad, scale)
    return Clip(
        *optics, electrons, mask, time_s - time_s[0], place[0], place[1], scale * light, snr
    )


def _scale(
    array: FocalArray,
    light_w_m2: float,
    place: FloatArray,
    limits: tuple[float, float] | None,
    rng: np.random.Generator,
) -> float:
    """Return the factor on a target's light for an SNR of its brightest pixel between limits.

    Without limits it is 1.
    """
    if limits is None:
        return 1.0
    ratio = limits[0] * (limits[1] / limits[0]) ** rng.uniform()
    target = array.target_e(light_w_m2, _row_and_column(place))
    background = array.background_e()
    at = np.unravel_index(np.argmax(target), target.shape)
    if target[at] <= 0.0:
        raise ModelError("--snr: the target has no light to scale")
    # With the target's own photons: signal s over √(n² + s) is w where s = w²/2 + √(w⁴/4 + w² n²).
    variance = float(array.noise_e(background)[at]) ** 2
    signal = 0.5 * ratio**2 + math.sqrt(0.25 * ratio**4 + ratio**2 * variance)
    return signal / float(target[at])


def _flown(
    bench: Bench, poses: Poses, time_s: FloatArray, pixel_rad: float
) -> tuple[FloatArray, Poses]:
    """Return a target's distances (N,) from the middle of its way, pixels, and poses (N,)."""
    targets = PosedTargets.of(bench.plan, poses)
    velocity = targets.velocity_m_s[0]
    ignition_s = targets.ignition_s[:1]
    place = targets.place_m[0] + time_s[:, None] * velocity
    way = targets.place_m[0] - np.asarray(bench.sensor.orbit.position_ecef_m(ignition_s))[0]
    range_m = float(np.linalg.norm(way))
    speed = float(np.linalg.norm(velocity - (velocity @ way) / range_m**2 * way))
    height_m = np.maximum(np.asarray(ecef_to_geodetic(place).height_m), 0.0)
    burn_s = float(targets.burnout_s[0] - ignition_s[0])
    unchanged: dict[str, Any] = {
        name: np.repeat(getattr(poses, name)[:1], len(time_s))
        for name in ("elevation_rad", "aspect_rad", "speed_m_s")
    }
    burned = poses.burned[0] + time_s / burn_s
    flown = evolve(poses, height_m=height_m, burned=burned, **unchanged)
    return time_s * speed / range_m / pixel_rad, flown


def _shifts(
    array: FocalArray, time_s: FloatArray, turn: float, rng: np.random.Generator
) -> FloatArray:
    """Return the shifts (2, N) of the background, pixels: drift and errors of registration."""
    drift = 1e-6 * array.plane.drift_urad_s * time_s / array.pixel_rad
    jitter = (
        1e-6
        * array.plane.registration_urad
        / array.pixel_rad
        * rng.standard_normal((2, len(time_s)))
    )
    return np.asarray(np.stack([math.sin(turn) * drift, math.cos(turn) * drift]) + jitter)


def _exposed(
    array: FocalArray,
    light_w_m2: FloatArray,
    place: FloatArray,
    shift: FloatArray,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float32], BoolArray, FloatArray]:
    """Return frames (N, rows, columns), masks of the target, and SNRs (N,)."""
    frames = [
        _exposed_frame(array, light, place[:, step], shift[:, step], rng)
        for step, light in enumerate(light_w_m2.tolist())
    ]
    electrons, mask, snr = zip(*frames, strict=True)
    return np.stack(electrons), np.stack(mask), np.array(snr)


def _exposed_frame(
    array: FocalArray,
    light_w_m2: float,
    place: FloatArray,
    shift: FloatArray,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float32], BoolArray, float]:
    """Return a frame, the mask of its target and the signal over noise of the brightest pixel."""
    background = array.background_e(_row_and_column(shift))
    target = array.target_e(light_w_m2, _row_and_column(place))
    mean = background + target
    inside = bool(np.all((place > -0.5) & (place < len(mean) - 0.5)))
    brightest = np.unravel_index(np.argmax(target), target.shape)
    snr = float(target[brightest] / array.noise_e(mean)[brightest]) if inside else 0.0
    mask = is_lit(target) if inside else np.zeros(target.shape, dtype=np.bool_)
    return array.exposed_e(mean, rng).astype(np.float32), mask, snr


def _row_and_column(values: FloatArray) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def training_clips(count: int) -> Sequence[bool]:
    """Return whether each clip is for training; the last fifth, at least one of several, tests.

    Frames of one clip are alike, so a clip is not split.
    """
    tests = 0 if count == 1 else max(1, round(0.2 * count))
    return [number < count - tests for number in range(count)]
