"""Rays within a track's gate that are none of it: what they do to the filter, and how they are told."""

import numpy as np
import pytest
from followed_flights import followed, rows_of, usual
from other_flights import flown

from opir_core.scoring.consistency import nees
from opir_core.tracking.gating import Pairs
from opir_core.tracking.stereo.stray_rays import Strays, doubtful


def pairs_of(track, distance):
    """Return pairs of tracks (n,) with rays at squared distances (n,)."""
    count = len(track)
    none, square = np.zeros(count), np.zeros((count, 2, 2))
    return Pairs(
        np.array(track), np.arange(count), none, np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros((count, 2)),
        square, np.array(distance, dtype=np.float64), none, none,
    )  # fmt: skip


def test_only_tracks_with_an_improbable_ray_or_strays_before_are_looked_at():
    pairs = pairs_of([0, 0, 1, 1, 2], [1.0, 3.0, 2.0, 17.0, 4.0])
    assert doubtful(pairs, np.zeros(3)).tolist() == [1]
    assert doubtful(pairs, np.array([0.0, 0.0, 0.2])).tolist() == [1, 2]


def test_a_share_is_the_mean_of_what_rays_said_and_is_the_same_in_one_go_or_two():
    first = Strays.of(np.array([0.0, 30.0]), np.array([100, 100]))
    assert first.share[0] < 1e-3
    assert first.share[1] == pytest.approx(0.3, abs=0.01)
    whole = Strays.of(np.array([12.0, 33.0]), np.array([140, 140]))
    assert first.after(np.array([12.0, 3.0]), np.array([40, 40])) == pytest.approx(whole.share)


def values_of(strays, count=24, seed=31):
    """Return the NEES (count,) of the filter's states at six tenths of burns, and whether the state is told."""
    truth, values = flown("SRBM", count, seed, "family"), np.full(count, np.nan)
    seeing = usual("SRBM")._replace(outliers=strays, astray_rad=9e-5)
    at = truth.start_s + 0.6 * truth.burn_s
    for tick in followed(truth, seeing, seed, at.max() + 1.0, fitted=False):
        due = np.flatnonzero((at > tick.time_s - 1.0) & (at <= tick.time_s))
        row = rows_of(tick.filtered, tick.shared)[due]
        told, here = tick.filtered.take(row[row >= 0]), due[row >= 0]
        error = told.state - truth.take(here).states(tick.time_s)
        values[here] = nees(error, told.state_covariance)
    return values


def test_three_rays_in_ten_astray_within_the_gate_leave_a_filter_that_knows_how_good_it_is():
    values = values_of(0.3)
    assert np.isfinite(values).all()
    # The mean of 24 χ² of six degrees of freedom is below its bound with 99.9 %; unweighed, it is twice its mean.
    assert values.mean() / 6.0 < 1.0 + 3.1 * np.sqrt(2.0 / (6.0 * 24))
