"""Launch points by `imm` of ascents that share no code with it and come out of clouds, before two
scanners of 10 Hz.
"""

import numpy as np
import pytest
from attrs import evolve
from drawn_ascents import ascents
from drawn_flights import ROWS, Seeing
from tracked_flights import followed, rows_of

from opir_core.geometry import ecef_to_geodetic

pytestmark = pytest.mark.slow

SEEING = Seeing(period_s=0.1, sigma_rad=20e-6, chance=0.72)

#: 95 % points of χ² of two and of one degree of freedom.
HELD_PLACE = 5.99
HELD_TIME = 3.84


def hidden(kind, count, seed):
    """Return ascents that nobody sees below drawn heights of 4 to 12 km."""
    truth, _ = ascents(kind, count, seed)
    top_m = np.random.default_rng(seed).uniform(4e3, 12e3, len(truth))
    height_m = ecef_to_geodetic(truth.position_m.reshape(-1, 3)).height_m.reshape(len(truth), ROWS)
    share = np.argmax(height_m > top_m[:, None], axis=1) / (ROWS - 1)
    dark = truth.dark.copy()
    # Of two dark spells the second, if any, is long after the launch.
    dark[:, 1] = np.stack([np.zeros(len(truth)), share], axis=1)
    return evolve(truth, dark=dark), truth.start_s + share * truth.burn_s


@pytest.mark.parametrize(("kind", "area_km2"), [("orbit", 60.0), ("three", 15.0)])
def test_where_and_when_what_comes_out_of_clouds_was_launched(kind, area_km2):
    """Paths followed back to rest as cubics have regions of 116 and 30 km²."""
    truth, seen_s = hidden(kind, 8, 21)
    *_, last = followed(truth, SEEING, 21, seen_s.max() + 12.0, forecast="none")
    rows = rows_of(last.reported, last.shared)
    assert (rows >= 0).all()
    launch = last.reported.launch[rows]
    spread = last.reported.launch_covariance[rows]
    site = ecef_to_geodetic(truth.position_m[:, 0])
    radius_m = np.linalg.norm(truth.position_m[:, 0], axis=1)
    north = (launch[:, 0] - site.latitude_rad) * radius_m
    east = (launch[:, 1] - site.longitude_rad) * radius_m * np.cos(site.latitude_rad)
    off = np.stack([east, north], axis=1)
    level = spread[:, :2, :2]
    squared = np.sum(off * np.linalg.solve(level, off[:, :, None])[:, :, 0], axis=1)
    assert np.mean(squared < HELD_PLACE) >= 0.8
    assert np.mean((launch[:, 2] - truth.start_s) ** 2 < HELD_TIME * spread[:, 2, 2]) >= 0.8
    assert np.median(np.hypot(east, north)) < 1500.0
    assert 1e-6 * np.pi * HELD_PLACE * np.median(np.sqrt(np.linalg.det(level))) < area_km2
