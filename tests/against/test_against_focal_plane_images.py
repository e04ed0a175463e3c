"""P_d, P_fa, clutter and centroids of the focal plane against frames simulated pixel by pixel.

The frames are those of benchmarks/focal_plane_images.py, which shares no code with the closed
forms; the benchmark has sixty settings of ten thousand frames, these are a few of them. Intervals
hold with 99.99 % each.
"""

import sys

import numpy as np
import pytest
from repository import ROOT

sys.path.append(str(ROOT / "benchmarks"))

from focal_plane import CENTROIDS, Noise, crossed, expected, settings
from focal_plane_images import centroid_errors, filtered
from opir_photons.radiometry import centroid_sigma_rad

SIGMAS = 3.9
FRAMES = 200
SETTINGS = list(settings())
#: Thresholds of which noise alone crosses some often enough.
CROSSED = [number for number, each in enumerate(SETTINGS) if each.threshold <= 2.5][2::5]
#: Clutter of four times the noise, behind filters of each kind.
CLUTTERED = [number for number, each in enumerate(SETTINGS) if each.ratio == 4.0][::4]


@pytest.mark.slow
@pytest.mark.parametrize("number", CROSSED)
def test_thresholds_are_crossed_as_often_as_in_closed_form(number):
    setting = SETTINGS[number]
    outputs = filtered(setting.images, FRAMES, np.random.default_rng([41, number]))
    shares = crossed(setting, outputs)
    for share, chance in zip(shares, expected(setting)[:2], strict=True):
        spread = max(share.std(ddof=1), np.sqrt(chance * (1.0 - chance) / outputs.empty.shape[1]))
        assert share.mean() == pytest.approx(chance, abs=SIGMAS * spread / np.sqrt(FRAMES))


@pytest.mark.slow
@pytest.mark.parametrize("number", CLUTTERED)
def test_the_variance_of_frames_is_noise_and_leaking_structure(number):
    images = SETTINGS[number].images
    outputs = filtered(images, 4 * FRAMES, np.random.default_rng([42, number]))
    mean = 0.0 if images.is_difference else images.weights.sum() * images.background_e
    noise = Noise(images)
    # By the noise of each frame: its displacement makes some frames worse than others.
    share = np.square((outputs.empty - mean) / noise.sigma_moved(outputs.moved)[:, None]).mean(
        axis=1
    )
    assert share.mean() == pytest.approx(1.0, abs=SIGMAS * share.std(ddof=1) / np.sqrt(len(share)))
    assert noise.sigma > 4.0 * np.sqrt(noise.white)


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 4, 7, 11])
def test_fitted_places_of_spots_are_as_good_as_the_bound(number):
    spot, noise_e, target_e = CENTROIDS[number]
    off = np.square(
        centroid_errors(spot, noise_e, target_e, 3000, np.random.default_rng([43, number]))
    ).mean(axis=1)
    bound = float(centroid_sigma_rad(target_e / noise_e, spot, 1.0, target_e)) ** 2
    assert off.mean() == pytest.approx(bound, abs=SIGMAS * off.std(ddof=1) / np.sqrt(len(off)))
