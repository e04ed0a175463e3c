"""Coasts that a look shuts out are not worked out, and nobody misses them."""

import numpy as np
from attrs import evolve
from opir_estimation import (
    COAST,
    AngleMeasurements,
    ImmFilter,
    ModeEstimates,
    Motion,
    Thrust,
    no_measurements,
    square_root,
    tangent_axes,
)
from opir_estimation.filter.iterated_update import Mode, log_likelihoods, updated
from opir_estimation.filter.thrust import THRUST

from opir_core.flight.forces import Forces
from opir_core.interfaces.columns import names_of

FORCES = Forces()
COUNT = 12
END_S = 40.0
FILTER = ImmFilter(
    Thrust(0.1, 30.0, 3.0, 0.002, FORCES),
    Motion(COAST, 0.01, FORCES),
    150.0,
    1000.0,
    coast_detection=0.01,
)
SENSORS_M = 42164e3 * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def burning(coasts: float) -> ModeEstimates:
    """Return boosts known as well as after a minute of looks, whose coasts are believed in this
    much.
    """
    rng = np.random.default_rng(3)
    sigma = np.repeat([150.0, 15.0, 1.0, 0.001], [3, 3, 3, 1])
    up = np.array([0.6, 0.64, 0.48])
    mean = np.concatenate([6.45e6 * up, 2000.0 * up, 30.0 * up, [0.01]]) + sigma * rng.normal(
        size=(COUNT, THRUST)
    )
    root = np.tile(np.diag(1.0 / sigma), (COUNT, 1, 1))
    weight = np.tile([1.0 - coasts, coasts], (COUNT, 1))
    pace = np.tile([200.0, 15.0, 0.05], (COUNT, 1))
    nobody = np.full((COUNT, COAST), 1e7), np.tile(np.eye(COAST), (COUNT, 1, 1))
    return ModeEstimates(weight, mean, root, *nobody, pace)


def looks_at(bank: ModeEstimates, tracks: np.ndarray) -> AngleMeasurements:
    """Return a second's looks of two sensors at the boosts of tracks, one every tenth of a
    second.
    """
    rng = np.random.default_rng(4)
    track = np.repeat(tracks, 20)
    time_s = END_S - np.tile(np.repeat(np.linspace(0.9, 0.0, 10), 2), len(tracks))
    origin = np.tile(SENSORS_M, (10 * len(tracks), 1))
    place = FILTER.predicted_measurements(bank, END_S).positions(track, time_s)
    apart = place - origin
    axes = tangent_axes(apart / np.linalg.norm(apart, axis=1)[:, None])
    return AngleMeasurements(
        track,
        time_s,
        origin,
        axes,
        2e-5 * rng.normal(size=(len(track), 2)),
        np.tile(5e4 * np.eye(2), (len(track), 1, 1)),
    )


def rows_alike(one: ModeEstimates, other: ModeEstimates, rows: np.ndarray) -> None:
    for name in names_of(ModeEstimates):
        assert np.allclose(
            getattr(one, name)[rows], getattr(other, name)[rows], rtol=1e-12, atol=1e-300
        ), name


def test_silence_finds_the_coast_as_if_no_look_had_been_expected() -> None:
    bank = burning(1e-4)
    expected = FILTER.predicted_open(bank, 1.0)
    whole = FILTER.predicted(bank, 1.0)
    for rows in (np.arange(COUNT), np.arange(1)):
        part = expected.take(rows)
        moved = whole.take(rows)
        dark = FILTER.updated(part, END_S, no_measurements(), 1.0)
        rows_alike(
            FILTER.with_open_coast(dark, part, bank.take(rows), 1.0),
            FILTER.updated(moved, END_S, no_measurements(), 1.0),
            rows,
        )
        assert dark.weight[:, 1].min() > 0.5


def test_of_many_tracks_those_unseen_alone_get_a_coast() -> None:
    bank = burning(1e-4)
    expected = FILTER.predicted_open(bank, 1.0)
    whole = FILTER.predicted(bank, 1.0)
    seen = np.arange(0, COUNT, 2)
    looks = looks_at(expected, seen)
    after = FILTER.with_open_coast(FILTER.updated(expected, END_S, looks, 1.0), expected, bank, 1.0)
    rows_alike(after, FILTER.updated(whole, END_S, looks, 1.0), np.arange(1, COUNT, 2))
    assert np.all(after.coast_mean[seen] == bank.coast_mean[seen])
    assert np.all(after.weight[seen, 1] < 1e-3)
    mean, covariance = FILTER.moments(after)
    assert np.array_equal(mean[seen], after.boost_mean[seen, :COAST])
    reported = square_root.covariance(after.boost_root)[seen, :COAST, :COAST]
    assert np.allclose(covariance[seen], reported, rtol=1e-9)


def test_looks_of_a_second_do_not_tell_a_boost_from_one_just_ended() -> None:
    """What the coast is shut out for: that a target is seen tells, and where it is seen does
    not.
    """
    whole = FILTER.predicted(burning(1e-4), 1.0)
    looks = looks_at(whole, np.arange(COUNT))
    modes = [Mode(FILTER.boost, *whole.boost), Mode(FILTER.coast, *whole.coast)]
    log = [log_likelihoods(mode, updated([mode], END_S, looks, FILTER.rounds)[0]) for mode in modes]
    assert np.all(np.abs(log[0] - log[1]) < 0.5)


def test_where_sensors_follow_bodies_no_coast_is_shut_out() -> None:
    bank = burning(1e-4)
    follows = evolve(FILTER, coast_detection=1.0)
    expected = follows.predicted_open(bank, 1.0)
    whole = follows.predicted(bank, 1.0)
    rows_alike(expected, whole, np.arange(COUNT))
