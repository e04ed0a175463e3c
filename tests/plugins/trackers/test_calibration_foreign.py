"""The bins of `benchmarks/calibration_foreign.py`, and its flights under other meridians."""

import sys

import numpy as np
from repository import ROOT

sys.path.append(str(ROOT / "benchmarks"))
from calibration_foreign import (
    LEAST_LAUNCHES,
    MARKS_S,
    MISSILE,
    Event,
    bin_rows,
    joined_bins,
    turned_to_meridian,
)
from foreign_flights import ecef


def test_bins_have_enough_launches_and_are_in_order():
    rng = np.random.default_rng(1)
    for stated in (rng.beta(0.2, 0.4, 500), rng.uniform(size=120), np.full(70, 0.01)):
        number = joined_bins(stated)
        assert np.bincount(number).min() >= LEAST_LAUNCHES
        assert np.all(np.diff(number[np.argsort(stated)]) >= 0)
    assert not joined_bins(rng.uniform(size=LEAST_LAUNCHES - 1)).any()


def test_shares_of_events_as_often_as_stated_lie_in_the_intervals():
    stated = (np.arange(2000) + 0.5) / 2000.0
    right = np.diff(np.floor(np.cumsum(stated)), prepend=0.0) > 0.0
    events = [
        Event(MARKS_S[0], MISSILE, *pair)
        for pair in zip(stated.tolist(), right.tolist(), strict=True)
    ]
    rows = list(bin_rows(events, 2000))
    assert sum(row["launches"] for row in rows) == 2000
    assert all(row["right_low95"] <= row["stated"] <= row["right_high95"] for row in rows)


def test_a_flight_is_turned_about_the_axis():
    latitude, longitude = np.radians([30.0, 170.0]).tolist()
    place = ecef(latitude, longitude)
    rows = np.array([[0.0, *place, *(0.01 * place), 1.0]])
    turned = turned_to_meridian(rows, 170.0, -20.0)[0]
    expected = ecef(latitude, np.radians(-20.0))
    np.testing.assert_allclose(turned, [0.0, *expected, *(0.01 * expected), 1.0], atol=1e-6)
