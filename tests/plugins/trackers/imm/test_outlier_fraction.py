"""Rays within a track's gate that are none of it: what they do to the filter, and how they are
reported.
"""

import numpy as np
import pytest
from attrs import evolve
from drawn_flights import flown
from hypothesis import given, strategies as st
from opir_estimation import GatedPairs
from opir_scoring.containments import nees
from opir_trackers.imm.outliers import (
    FRACTIONS,
    OutlierFractions,
    clean_log_likelihood,
    fraction_log_likelihood,
    suspect_tracks,
)
from tracked_flights import followed, rows_of, usual

from examples import examples

GATE = 4.5


def pairs_of(track, distance):
    """Return pairs of tracks (n,) with rays at squared distances (n,)."""
    count = len(track)
    none = np.zeros(count)
    return GatedPairs(
        np.array(track), np.arange(count), none, np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros((count, 2)),
        np.array(distance, dtype=np.float64), none, none,
    )  # fmt: skip


def test_only_tracks_with_an_improbable_ray_or_strays_before_are_looked_at():
    pairs = pairs_of([0, 0, 1, 1, 2], [1.0, 3.0, 2.0, 17.0, 4.0])
    assert suspect_tracks(pairs, np.zeros(3)).tolist() == [1]
    assert suspect_tracks(pairs, np.array([0.0, 0.0, 0.2])).tolist() == [1, 2]


def squares_of(outliers, tracks, rays, seed):
    """Return how far off (tracks, rays) rays are, squared: with unit errors, or evenly within the
    gate.
    """
    rng = np.random.default_rng(seed)
    square = rng.chisquare(2, (tracks, rays))
    return np.where(
        rng.random((tracks, rays)) < outliers, GATE**2 * rng.random((tracks, rays)), square
    )


def nothing_of(tracks):
    """Return what is known of the shares of a number of tracks before any ray."""
    return OutlierFractions(np.zeros((tracks, len(FRACTIONS))))


def reported_by(square):
    """Return what rays (tracks, rays) tell of shares (tracks, shares)."""
    track = np.repeat(np.arange(len(square)), square.shape[1])
    return fraction_log_likelihood(square.ravel(), GATE, track, len(square))


@pytest.mark.parametrize(
    ("outliers", "rays"), [(0.0, 40), (0.1, 200), (0.3, 60), (0.3, 400), (0.6, 60)]
)
def test_the_share_of_strays_is_found_from_few_rays_on(outliers, rays):
    share = nothing_of(400).after(reported_by(squares_of(outliers, 400, rays, 1))).share
    # What is believed beforehand is three rays without strays, and shares below one in a hundred
    # are on no grid.
    drawn = outliers * 3.0 / rays + 0.01
    assert share.mean() == pytest.approx(
        outliers, abs=drawn + 3.3 * share.std() / np.sqrt(len(share))
    )


def test_rays_beyond_the_gate_say_nothing_of_the_share_within():
    near = squares_of(0.3, 5, 50, 2)
    far = np.concatenate([near, np.full((5, 20), 1.01 * GATE**2), np.full((5, 20), 1e6)], axis=1)
    assert reported_by(far) == pytest.approx(reported_by(near), rel=1e-12)


@examples(60)
@given(seed=st.integers(0, 10**6), outliers=st.floats(0.0, 1.0), cut=st.integers(0, 300))
def test_a_share_is_a_share_and_the_same_in_one_go_or_two_and_in_any_order(seed, outliers, cut):
    square = squares_of(outliers, 3, 300, seed)
    whole = nothing_of(3).after(reported_by(square))
    assert np.all((whole.share >= 0.0) & (whole.share <= FRACTIONS[-1]))
    parts = nothing_of(3).after(reported_by(square[:, :cut])).after(reported_by(square[:, cut:]))
    assert parts.log == pytest.approx(whole.log, rel=1e-9, abs=1e-9)
    assert nothing_of(3).after(reported_by(square[:, ::-1])).log == pytest.approx(
        whole.log, rel=1e-9, abs=1e-9
    )
    assert whole.take(np.array([2])).share == pytest.approx(whole.share[2:])


def test_before_any_ray_one_in_a_hundred_strays_and_rays_without_any_make_it_fewer():
    nothing = nothing_of(1)
    assert nothing.share == pytest.approx(0.01, abs=5e-4)
    pairs = evolve(pairs_of([0] * 30, [1.0] * 30), sigma_rad=np.ones(30))
    clean = nothing.after(clean_log_likelihood(pairs, nothing, GATE)).share
    assert clean < 0.5 * nothing.share
    # In a gate four times as wide a stray ray would have passed for one of the track's.
    vague = evolve(pairs, log_volume=np.full(30, np.log(4.0) * 2.0))
    assert nothing.after(clean_log_likelihood(vague, nothing, GATE)).share == pytest.approx(
        nothing.share
    )


def values_of(outliers, count=24, seed=31):
    """Return the NEES (count,) of the filter's states at six tenths of burns, and whether the state
    is reported.
    """
    truth = flown("SRBM", count, seed, "smooth")
    values = np.full(count, np.nan)
    seeing = usual("SRBM")._replace(outliers=outliers, astray_rad=9e-5)
    at = truth.start_s + 0.6 * truth.burn_s
    for tick in followed(truth, seeing, seed, at.max() + 1.0):
        due = np.flatnonzero((at > tick.time_s - 1.0) & (at <= tick.time_s))
        row = rows_of(tick.reported, tick.shared)[due]
        reported = tick.reported.take(row[row >= 0])
        here = due[row >= 0]
        error = reported.state - truth.take(here).states(tick.time_s)
        values[here] = nees(error, reported.state_covariance)
    return values


@pytest.mark.slow
def test_three_rays_in_ten_astray_within_the_gate_leave_a_filter_that_knows_how_good_it_is():
    values = values_of(0.3)
    assert np.isfinite(values).all()
    # The mean of 24 χ² of six degrees of freedom is within its bounds with 99.8 %; unweighed, it is
    # twice its mean.
    assert abs(values.mean() / 6.0 - 1.0) < 3.1 * np.sqrt(2.0 / (6.0 * 24))
