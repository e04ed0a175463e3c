"""Histories of sensors are given to the tracks they are of; what cannot be told is told as undecided."""

from itertools import permutations

import numpy as np
import pytest
from attrs import evolve
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.imm.histories import JERK_NOISE_M_S3, Histories, mean_measurements, smooth_boost_s, with_biases
from opir_trackers.imm.history_assignment import assigned_histories
from opir_trackers.lines_of_sight import AngleMeasurements

from opir_core.estimation import tangent_axes
from opir_core.estimation.motion import BOOST, COAST, Motion
from opir_core.flight.forces import Forces
from opir_core.reading import scene_from_mapping
from opir_core.simulation.run import simulate

KEPLER = Forces(zonal=())
COASTING = Motion(COAST, 0.0, KEPLER)
FILTER = ImmFilter(Motion(BOOST, 1.0, KEPLER), COASTING, np.inf, np.inf)
SENSORS_M = 42164e3 * np.array([[np.cos(a), np.sin(a), 0.0] for a in np.radians([10.0, 80.0])])
SIGMA_RAD, END_S = 2e-5, 6.0
FIRST = np.array([4.2e6, 3.9e6, 3.2e6, -1500.0, 2500.0, 5000.0])
UNBIASED = np.zeros(2)

#: Across the plane through both sensors: targets apart along this are told apart by how near their rays pass.
ACROSS = np.cross(SENSORS_M[0] - FIRST[:3], SENSORS_M[1] - FIRST[:3])
ACROSS /= np.linalg.norm(ACROSS)

#: Within that plane, and across the bisector of both lines of sight.
WITHIN = np.cross(ACROSS, FIRST[:3] - SENSORS_M.mean(axis=0))
WITHIN /= np.linalg.norm(WITHIN)


def apart(*shifts_m: np.ndarray) -> np.ndarray:
    """Return the states (n, 6) at the end of targets that differ in place alone."""
    return np.stack([FIRST + np.concatenate([shift, np.zeros(3)]) for shift in shifts_m])


def looks(states: np.ndarray, seed: int = 3) -> tuple[AngleMeasurements, np.ndarray]:
    """Return ten looks a second of both sensors at targets, as sights, and whose sensor each is."""
    rng = np.random.default_rng(seed)
    count = len(states)
    parts, sensors = [], []
    for time_s in np.arange(0.05, END_S, 0.1):
        place = COASTING.propagated(states, np.full(count, time_s - END_S))[:, :3]
        for sensor, origin in enumerate(SENSORS_M):
            off = place - origin
            axes = tangent_axes(off / np.linalg.norm(off, axis=1)[:, None])
            seen = SIGMA_RAD * rng.normal(size=(count, 2))
            whitener = np.tile(np.eye(2) / SIGMA_RAD, (count, 1, 1))
            origins = np.tile(origin, (count, 1))
            parts.append(AngleMeasurements(np.arange(count), np.full(count, time_s), origins, axes, seen, whitener))
            sensors.append(np.full(count, sensor))
    return AngleMeasurements.concatenate(parts), np.concatenate(sensors)


def begun(states: np.ndarray, sigma_m: float = 5000.0) -> ModeEstimates:
    """Return what is known beforehand of as many targets: that they are about the middle of all."""
    count = len(states)
    mean = np.tile(states.mean(axis=0), (count, 1))
    root = np.tile(np.diag(1.0 / np.repeat([sigma_m, 50.0, 20.0, 0.5], 3)), (count, 1, 1))
    boost = np.concatenate([mean, np.zeros((count, 6))], axis=1)
    coast_root = root[:, :COAST, :COAST].copy()
    return ModeEstimates(np.tile([0.0, 1.0], (count, 1)), boost, root, mean, coast_root, np.ones((count, 3)))


def known(states: np.ndarray, order: tuple[int, ...]) -> tuple[Histories, ModeEstimates]:
    """Return histories in which track k has the second sensor's history of target order[k], and what follows."""
    sights, sensor = looks(states)
    holder = np.argsort(order)
    sights = sights.with_track(np.where(sensor == 1, holder[sights.track], sights.track))
    first = begun(states)
    bank = FILTER.updated(first, END_S, sights, END_S)
    means = mean_measurements(FILTER.predicted_measurements(bank, END_S), sights, sensor, 1.0)
    return Histories(np.arange(len(states)), np.zeros(len(states)), first, *means), bank


def errors_m(bank: ModeEstimates, states: np.ndarray) -> np.ndarray:
    return np.linalg.norm(bank.coast_mean[:, :3] - states[:, :3], axis=1)


THREE = apart(0.0 * ACROSS, 1500.0 * ACROSS + 900.0 * WITHIN, 3100.0 * ACROSS - 700.0 * WITHIN)


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_any_exchange_among_three_is_put_right_at_once(order: tuple[int, ...]) -> None:
    histories, bank = known(THREE, order)
    found = assigned_histories(FILTER, histories, bank, END_S, UNBIASED)
    assert sorted(errors_m(bank, THREE) > 600.0) == sorted(k != place for place, k in enumerate(order))
    # Which track is which is free: each has both histories of one target.
    nearest = np.array([np.argmin(errors_m(found.estimates.take([k]), THREE)) for k in range(3)])
    assert sorted(nearest.tolist()) == [0, 1, 2]
    assert (errors_m(found.estimates, THREE[nearest]) < 450.0).all()
    assert (found.histories.doubt < 1e-3).all()
    assert np.allclose(found.reported.coast_mean, found.estimates.coast_mean, atol=1.0)


def test_tracks_that_began_far_off_weigh_one_anothers_histories_all_the_same() -> None:
    """Three rays' breadths apart, and each begun 2 to 4 deviations off: far from all histories, its own as well."""
    shifts = np.array([[0.0, 0.0, 0.0], [6400.0, -2900.0, -1800.0], [-4200.0, 3700.0, -800.0]])
    off = np.array([[0.0, -2700.0, -3000.0], [-700.0, 1900.0, -300.0], [2300.0, 0.0, -300.0]])
    states = apart(*shifts)
    began = states + np.pad(off, ((0, 0), (0, 3)))
    first = evolve(begun(states, 1000.0), coast_mean=began, boost_mean=np.pad(began, ((0, 0), (0, 6))))
    sights, sensor = looks(states)
    # Each sensor's histories are exchanged between the first track and another.
    holder = np.where(sensor == 1, np.array([2, 1, 0])[sights.track], np.array([1, 0, 2])[sights.track])
    sights = sights.with_track(holder)
    bank = FILTER.updated(first, END_S, sights, END_S)
    means = mean_measurements(FILTER.predicted_measurements(bank, END_S), sights, sensor, 1.0)
    histories = Histories(np.arange(3), np.zeros(3), first, *means)
    doubt = assigned_histories(FILTER, histories, bank, END_S, UNBIASED).histories.doubt
    assert (doubt > 0.0).all()


def test_the_order_of_tracks_does_not_matter() -> None:
    histories, bank = known(THREE, (1, 2, 0))
    found = assigned_histories(FILTER, histories, bank, END_S, UNBIASED)
    turn = np.array([2, 0, 1])
    place = np.argsort(turn)
    turned = evolve(
        histories,
        first=histories.first.take(turn),
        measurements=histories.measurements.with_track(place[histories.measurements.track]),
    )
    other = assigned_histories(FILTER, turned, bank.take(turn), END_S, UNBIASED)
    assert np.allclose(other.estimates.coast_mean[place], found.estimates.coast_mean, rtol=0.0, atol=1e-3)
    assert np.allclose(other.histories.doubt[place], found.histories.doubt, atol=1e-9)


def test_what_cannot_be_told_is_told_as_undecided() -> None:
    """Two targets in one plane with both sensors: ghosts explain all looks as well, and lie to both sides of them."""
    states = apart(-1500.0 * WITHIN, 1500.0 * WITHIN)
    ghostly, bank = known(states, (1, 0))
    found = assigned_histories(FILTER, ghostly, bank, END_S, UNBIASED)
    assert ((found.histories.doubt > 0.02) & (found.histories.doubt < 0.98)).all()
    assert np.linalg.norm(found.reported.coast_mean[0, :3] - found.estimates.coast_mean[0, :3]) > 20.0
    told, firm = (FILTER.moments(one)[1][:, :3, :3] for one in (found.reported, found.estimates))
    shift = (
        found.reported.coast_mean[:, :3]
        - states[np.argmin([errors_m(found.reported, states[[k, k]]) for k in (0, 1)], 0), :3]
    )
    square = np.einsum("ni,nij,nj->n", shift, np.linalg.inv(told), shift)
    assert (square < 16.3).all(), "the truth is within what is told (3 degrees, 99.9 %)"
    assert (np.trace(told, axis1=1, axis2=2) > 4.0 * np.trace(firm, axis1=1, axis2=2)).all()


def test_mean_sights_tell_what_all_sights_tell() -> None:
    """But for slopes within a slice, 1/36 of what six say of a velocity: estimates differ by about 1/6 of an error."""
    states = apart(0.0 * ACROSS)
    sights, sensor = looks(states)
    first = begun(states)
    every = FILTER.updated(first, END_S, sights, END_S)
    means, whose = mean_measurements(FILTER.predicted_measurements(every, END_S), sights, sensor, 1.0)
    assert sorted(whose.tolist()) == [0] * int(END_S) + [1] * int(END_S)
    few = FILTER.updated(first, END_S, means, END_S)
    sigma = np.sqrt(np.diag(FILTER.moments(every)[1][0]))
    assert np.allclose(few.coast_mean[0] / sigma, every.coast_mean[0] / sigma, atol=0.6, rtol=0.0)
    assert np.allclose(np.sqrt(np.diag(FILTER.moments(few)[1][0])), sigma, rtol=0.03)


def test_a_history_is_no_surer_than_its_sensors_bias() -> None:
    histories, _ = known(THREE, (0, 1, 2))
    bias = np.array([0.0, 3e-5])
    wide = with_biases(histories, bias)
    sharp = np.einsum("nij,nij->n", wide.whitener, wide.whitener) / 2.0
    for track in range(3):
        mine = histories.measurements.track == track
        assert 1.0 / np.sqrt(sharp[mine & (histories.sensor == 0)].sum()) == pytest.approx(SIGMA_RAD / np.sqrt(60))
        assert 1.0 / sharp[mine & (histories.sensor == 1)].sum() == pytest.approx(SIGMA_RAD**2 / 60 + 3e-5**2)
    assert with_biases(histories, UNBIASED) is histories.measurements


def test_histories_of_some_tracks_keep_their_sights() -> None:
    histories, _ = known(THREE, (0, 1, 2))
    some = histories.of(np.array([True, False, True]))
    assert some.number.tolist() == [0, 2]
    assert np.array_equal(
        some.measurements.measured, histories.measurements.measured[histories.measurements.track != 1]
    )
    again = some.joined(evolve(histories.of(np.array([False, True, False])), number=np.array([7])))
    assert again.number.tolist() == [0, 2, 7]
    assert np.bincount(again.measurements.track).tolist() == [12, 12, 12]


def test_a_boost_is_followed_for_as_long_as_its_jerk_leaves_it_smooth() -> None:
    long_s = smooth_boost_s(720.0, 0.1)
    wander_m = JERK_NOISE_M_S3 * np.sqrt(3.0) * long_s**3.5 / np.sqrt(252.0)
    assert wander_m == pytest.approx(720.0 * np.sqrt(0.1 / long_s))


@pytest.mark.slow
def test_tracks_that_no_history_fits_are_told_with_numbers() -> None:
    """Nine launches from a patch of 8 km: of a ring of tracks that no histories fit, one is left with none."""
    sensors = [
        {"model": "generic-scanner", "id": "A", "orbital_slot_deg": -135.0},
        {"model": "generic-scanner", "id": "B", "orbital_slot_deg": -90.0},
        {"model": "generic-scanner", "id": "C", "orbital_slot_deg": -150.0, "scan_phase": "aligned"},
    ]
    launches = [(34.7 + 0.03 * (k % 3), -120.6 + 0.05 * (k // 3), 5.0 + 0.7 * k) for k in range(9)]
    targets = [
        {
            "id": f"T{number}",
            "type": "ICBM",
            "launch": {"lat_deg": lat_deg, "lon_deg": lon_deg, "time_s": time_s},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
        }
        for number, (lat_deg, lon_deg, time_s) in enumerate(launches)
    ]
    scene = {"scene": "patch", "epoch": "2026-04-01T12:00:00Z", "duration_s": 17, "seed": 3, "tracker": "imm"}
    tracks = simulate(scene_from_mapping({**scene, "sensors": sensors, "targets": targets})).tracks
    assert len(tracks) > 20
    assert np.isfinite(tracks.state).all()
    assert np.isfinite(tracks.state_covariance).all()
