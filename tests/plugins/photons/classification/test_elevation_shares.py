"""How often what is detected lies at which elevation."""

import numpy as np
import pytest
from opir_photons.classification.synthetic_looks import EARTH_RADIUS_M, LOWEST_SINE
from opir_photons.classification.type_densities import elevation_bin, log_noise_shares


@pytest.mark.parametrize("radius_m", [7.0e6, 4.2164e7])
def test_false_alarm_elevations_match_drawn_directions(radius_m):
    rng = np.random.default_rng(3)
    # Directions over the sphere that meet the Earth, from their closest approach and the distance
    # along them.
    down = rng.uniform(np.sqrt(1.0 - (EARTH_RADIUS_M / radius_m) ** 2), 1.0, 400_000)
    nearest_m = radius_m * np.sqrt(1.0 - down**2)
    sine = np.sqrt(1.0 - (nearest_m / EARTH_RADIUS_M) ** 2)
    counts = np.bincount(elevation_bin(sine), minlength=4) / len(sine)
    ground = (
        np.bincount(elevation_bin(rng.uniform(LOWEST_SINE, 1.0, 400_000)), minlength=4) / 400_000
    )
    np.testing.assert_allclose(np.exp(log_noise_shares(radius_m)), counts / ground, rtol=0.05)
