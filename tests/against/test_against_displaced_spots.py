"""Spots on pixels against images: what filters pass of a true Airy pattern, and what a frame
difference leaves of it.

The images share no code with the closed forms: the pattern is its Bessel function sampled in space,
blurred by a discrete convolution, and added up pixel by pixel for places drawn at random.
"""

from typing import NamedTuple

import numpy as np
import pytest
from opir_photons.radiometry import (
    FilteredSpot,
    FrameDifference,
    PointSpread,
    airy_sigma_rad,
    ensquared_airy_energy,
    ensquared_energy,
    filter_weights,
)
from scipy.ndimage import map_coordinates
from scipy.signal import fftconvolve
from scipy.special import j0, j1

#: Samples along a pixel, and pixels from the centre of the pattern to its edge.
SUB = 16
REACH = 16
#: Standard errors within which a mean of 20 settings lies with 99.9 % in all.
SIGMAS = 4.1
DRAWS = 6000


class Setting(NamedTuple):
    spread: PointSpread
    kind: str
    core: int
    displacement: float
    frames: FrameDifference


def drawn_settings(seed=11):
    """Return 20 settings: apertures from undersampled to Nyquist, blurs, filters, displacements,
    frames.
    """
    rng = np.random.default_rng(seed)
    kinds = (("matched", 1), ("surround", 1), ("sum", 2), ("sum", 1))
    return [
        Setting(
            PointSpread(float(rng.uniform(3.0, 14.0)), float(rng.uniform(0.1, 0.5))),
            *kinds[number % 4],
            float(rng.choice([0.0, 0.3, 0.7, 1.2, 2.0, 3.5])) * float(rng.uniform(0.8, 1.2)),
            FrameDifference(10.0, float(rng.uniform(0.0, 0.2)), float(rng.uniform(0.0, 0.05))),
        )
        for number in range(20)
    ]


SETTINGS = drawn_settings()


class Pattern:
    """A pattern of unit energy, integrated from its corner: shares of pixels are differences of
    four values.
    """

    def __init__(self, cutoff, blur):
        place = (np.arange(2 * REACH * SUB) + 0.5) / SUB - REACH
        radius = np.hypot(place[:, None], place)
        scaled = 0.5 * cutoff * radius
        density = cutoff**2 / (16.0 * np.pi) * np.square(2.0 * j1(scaled) / scaled)
        half = int((5.0 * blur + 1.0) * SUB)
        bell = np.exp(-0.5 * np.square(np.arange(-half, half + 1) / (SUB * blur)))
        kernel = np.outer(bell, bell) / bell.sum() ** 2
        density = fftconvolve(density, kernel, mode="same")
        self.whole = np.zeros((len(place) + 1, len(place) + 1))
        self.whole[1:, 1:] = density.cumsum(axis=0).cumsum(axis=1) / SUB**2

    def shares(self, at, width):
        """Return shares (n, width, width) of the pixels of a window, of spots at (n, 2) from its
        centre.
        """
        edge = np.arange(width + 1) - 0.5 * width
        x, y = ((edge - at[:, axis, None] + REACH) * SUB for axis in (0, 1))
        rows, columns = np.broadcast_arrays(x[:, :, None], y[:, None, :])
        below = map_coordinates(self.whole, [rows, columns], order=1, mode="nearest")
        return np.diff(np.diff(below, axis=1), axis=2)


def drawn_outputs(setting, rng):
    """Return outputs (n,) of the filter for spots now and in the earlier frame, for random places
    and directions.
    """
    weights = weights_of(setting)
    frames = setting.frames
    pattern = Pattern(setting.spread.cutoff, setting.spread.blur)
    place = rng.uniform(-0.5, 0.5, (DRAWS, 2))

    def turned(length):
        turn = rng.uniform(0.0, 2.0 * np.pi, DRAWS)
        return length * np.stack([np.cos(turn), np.sin(turn)], axis=1)

    second_place = place + turned(setting.displacement) + turned(frames.drift_per_s * frames.lag_s)
    second_place += frames.registration * (
        rng.normal(size=(DRAWS, 2)) + rng.normal(size=(DRAWS, 2))
    )
    frame, second_frame = (
        (pattern.shares(at, len(weights)) * weights).sum(axis=(1, 2))
        for at in (place, second_place)
    )
    return frame, second_frame


def weights_of(setting):
    return filter_weights(setting.kind, setting.core, 0.45, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(20))
def test_own_light_left_by_a_frame_difference_is_that_of_images(number):
    setting = SETTINGS[number]
    frame, second_frame = drawn_outputs(setting, np.random.default_rng([51, number]))
    spot = FilteredSpot.of(weights_of(setting), setting.spread)
    error = SIGMAS / np.sqrt(DRAWS)
    # The sampled pattern is off by the light of a cell's curvature, below 1e-3.
    assert float(spot.response()) == pytest.approx(frame.mean(), abs=error * frame.std() + 1e-3)
    removed = float(spot.response(setting.displacement, setting.frames))
    assert removed == pytest.approx(second_frame.mean(), abs=error * second_frame.std() + 1e-3)
    share = spot.own_past(setting.frames).at(np.array([setting.displacement]))[0]
    remaining_share = 1.0 - share
    spread = np.std(second_frame - share * frame) / frame.mean()
    assert remaining_share == pytest.approx(
        1.0 - second_frame.mean() / frame.mean(), abs=error * spread + 2e-3
    )


def test_a_source_that_stays_is_removed_and_one_that_is_far_off_is_not():
    spot = FilteredSpot.of(filter_weights("matched", 1, 0.45, 1.0), PointSpread(6.0, 0.2))
    past = spot.own_past(FrameDifference(10.0, 0.0, 0.0))
    assert past.at(np.zeros(1))[0] == pytest.approx(1.0, abs=1e-12)
    assert abs(past.at(np.array([past.reach - 1e-6]))[0]) < 0.02
    assert past.at(np.array([past.reach + 1.0]))[0] == 0.0


@pytest.mark.parametrize("radius", [0.6, 1.0, 1.63, 2.5])
def test_the_encircled_energy_of_the_pattern_is_rayleighs(radius):
    """1 - J0² - J1² of the radius in π λ / D (Lord Rayleigh, 1881), by the transfer that ensquared
    energies use.
    """
    wavenumber = np.linspace(0.0, 5.0, 200_001)[1:]
    cutoff = 5.0
    radius_px = 2.0 * radius * np.pi / 5.0
    transfer = PointSpread(cutoff, 1e-6).transfer(wavenumber)
    inside = np.trapezoid(radius_px * j1(wavenumber * radius_px) * transfer, wavenumber)
    rayleigh = 1.0 - j0(np.pi * radius) ** 2 - j1(np.pi * radius) ** 2
    assert inside == pytest.approx(rayleigh, abs=1e-4)


@pytest.mark.parametrize("phase", ["mean", "worst"])
@pytest.mark.parametrize("cutoff", [4.0, 7.0, 12.0])
def test_ensquared_energy_of_the_true_pattern_is_that_of_its_image(cutoff, phase):
    rng = np.random.default_rng(3)
    spread = PointSpread(cutoff, 0.15)
    at = rng.uniform(-0.5, 0.5, (DRAWS, 2)) if phase == "mean" else np.full((1, 2), 0.5)
    energy = Pattern(cutoff, 0.15).shares(at, 1)[:, 0, 0]
    result = ensquared_airy_energy(spread, 1, phase)
    assert result == pytest.approx(energy.mean(), abs=4.0 * energy.std() / np.sqrt(DRAWS) + 2e-3)
    # The Gaussian of the same peak has no rings, and more in the pixel.
    sigma = np.hypot(float(airy_sigma_rad(1e6 * 2.0 * np.pi / cutoff, 1.0)), 0.15)
    assert result < float(ensquared_energy(sigma, 1.0, 1, phase))
