"""Movies of frames with a target that flies through them, and what is in each frame.

A clip is what the focal plane sees at equal intervals: the background keeps still but for drift and
the error of registration, the target moves on a straight way and its plume changes with height and
burn, noise is new in each frame.
"""

import math
from collections.abc import Sequence

import numpy as np
from attrs import evolve, frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray
from opir_core.errors import ModelError
from opir_core.geometry import ecef_to_geodetic
from opir_coverage.bench.frames import FocalArray, is_lit
from opir_coverage.bench.stand import Bench, PosedTargets, Poses

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
    mask: NDArray[np.bool_]
    time_s: FloatArray
    row: FloatArray
    column: FloatArray
    light_w_m2: FloatArray
    snr: FloatArray

    def __len__(self) -> int:
        return len(self.time_s)

    def boxes(self) -> list[tuple[int, int, int, int] | None]:
        """Return the first column and row, the width and the height of each frame's mask; None
        without one.
        """
        return [_box(each) for each in self.mask]


def _box(mask: NDArray[np.bool_]) -> tuple[int, int, int, int] | None:
    rows = np.flatnonzero(mask.any(axis=1))
    columns = np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    (top, bottom), (left, right) = rows[[0, -1]].tolist(), columns[[0, -1]].tolist()
    return left, top, right - left + 1, bottom - top + 1


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


def clip(bench: Bench, poses: Poses, filming: Filming, seed: int = 1) -> Clip:
    """Return the frames of one posed target at equal intervals, in the middle of which it has its
    pose.
    """
    rng = np.random.default_rng(seed)
    array = FocalArray.of(bench, poses, filming.pixels, filming.band, rng)
    time_s: FloatArray = np.asarray(
        (np.arange(filming.frames) - 0.5 * (filming.frames - 1)) * filming.every_s
    )
    where, flown = _flown(bench, poses, time_s, array.pixel_rad)
    turn = rng.uniform(0.0, 2.0 * math.pi)
    middle = 0.5 * (filming.pixels - 1) + _AROUND * filming.pixels * (rng.uniform(size=2) - 0.5)
    shift = _shifts(array, time_s, turn, rng)
    place = middle[:, None] + np.stack([math.cos(turn) * where, math.sin(turn) * where]) + shift
    light = bench.light_w_m2(flown)[:, filming.band]
    scale = (
        1.0
        if filming.snr is None
        else _scale(array, float(light[filming.frames // 2]), middle, filming.snr, rng)
    )
    made = [
        _exposed(array, scale * float(light[step]), place[:, step], shift[:, step], rng)
        for step in range(filming.frames)
    ]
    electrons, mask, snr = zip(*made, strict=True)
    columns = (time_s - time_s[0], place[0], place[1], scale * light, np.array(snr))
    of = (bench.sensor.id, array.band, poses.target_class, seed, array.pixel_rad, scale)
    return Clip(*of, np.stack(electrons), np.stack(mask), *columns)


def _scale(
    array: FocalArray,
    light_w_m2: float,
    place: FloatArray,
    limits: tuple[float, float],
    rng: np.random.Generator,
) -> float:
    """Return the factor on a target's light that gives its brightest pixel a signal over noise
    between limits.
    """
    wanted = limits[0] * (limits[1] / limits[0]) ** rng.uniform()
    target = array.target_e(light_w_m2, (float(place[0]), float(place[1])))
    background = array.background_e()
    at = np.unravel_index(np.argmax(target), target.shape)
    if target[at] <= 0.0:
        raise ModelError("--snr: the target has no light to scale")
    # With the target's own photons: signal s over √(n² + s) is w where s = w²/2 + √(w⁴/4 + w² n²).
    variance = float(array.noise_e(background)[at]) ** 2
    signal = 0.5 * wanted**2 + math.sqrt(0.25 * wanted**4 + wanted**2 * variance)
    return signal / float(target[at])


def _flown(
    bench: Bench, poses: Poses, time_s: FloatArray, pixel_rad: float
) -> tuple[FloatArray, Poses]:
    """Return how far a target has moved in the frame (N,), pixels, and its poses (N,) along its
    straight way.
    """
    one = PosedTargets.of(bench.plan, poses)
    place = one.place_m[0] + time_s[:, None] * one.velocity_m_s[0]
    sensor_m = np.asarray(bench.sensor.orbit.position_ecef_m(np.array([one.ignition_s[0]])))[0]
    way = one.place_m[0] - sensor_m
    range_m = float(np.linalg.norm(way))
    axis = one.velocity_m_s[0] - (one.velocity_m_s[0] @ way) / range_m**2 * way
    speed = float(np.linalg.norm(axis))
    height_m = np.maximum(np.asarray(ecef_to_geodetic(place).height_m), 0.0)
    burn_s = float(one.burnout_s[0] - one.ignition_s[0])
    flown = evolve(
        poses,
        height_m=height_m,
        burned=poses.burned[0] + time_s / burn_s,
        elevation_rad=np.repeat(poses.elevation_rad[:1], len(time_s)),
        aspect_rad=np.repeat(poses.aspect_rad[:1], len(time_s)),
        speed_m_s=np.repeat(poses.speed_m_s[:1], len(time_s)),
    )
    return time_s * speed / range_m / pixel_rad, flown


def _shifts(
    array: FocalArray, time_s: FloatArray, turn: float, rng: np.random.Generator
) -> FloatArray:
    """Return how far the line of sight moves the picture (2, N), pixels: a drift, and errors of
    registration.
    """
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
    light_w_m2: float,
    place: FloatArray,
    shift: FloatArray,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float32], NDArray[np.bool_], float]:
    """Return a frame, the mask of its target and the signal over noise of the brightest pixel."""
    background = array.background_e((float(shift[0]), float(shift[1])))
    target = array.target_e(light_w_m2, (float(place[0]), float(place[1])))
    mean = background + target
    inside = bool(np.all((place > -0.5) & (place < len(mean) - 0.5)))
    brightest = np.unravel_index(np.argmax(target), target.shape)
    snr = float(target[brightest] / array.noise_e(mean)[brightest]) if inside else 0.0
    mask = is_lit(target) if inside else np.zeros(target.shape, dtype=np.bool_)
    return array.exposed_e(mean, rng).astype(np.float32), mask, snr


def training_clips(count: int) -> Sequence[bool]:
    """Return which clips are for training: the last fifth, at least one of several, is for tests.

    Frames of one clip are alike, so a clip is not split.
    """
    tests = 0 if count == 1 else max(1, round(0.2 * count))
    return [number < count - tests for number in range(count)]
