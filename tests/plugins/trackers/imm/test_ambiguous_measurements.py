"""Rays that two near tracks may have: shares against all explanations written out, and what follows from them."""

import numpy as np
import pytest
from attrs import evolve
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.imm.histories import Histories, reweighted, updated_with_likelihood
from opir_trackers.imm.history_assignment import swap_log_likelihoods
from opir_trackers.imm.measurement_weights import AmbiguousMeasurements
from opir_trackers.lines_of_sight import AngleMeasurements

from opir_core.estimation import tangent_axes
from opir_core.estimation.motion import BOOST, COAST, Motion
from opir_core.flight.forces import Forces

KEPLER = Forces(zonal=())
COASTING = Motion(COAST, 0.0, KEPLER)
FILTER = ImmFilter(Motion(BOOST, 1.0, KEPLER), COASTING, np.inf, np.inf)
SENSORS_M = 42164e3 * np.array([[np.cos(a), np.sin(a), 0.0] for a in np.radians([10.0, 80.0])])
SIGMA_RAD, END_S, ODDS, PRIOR_M, PRIOR_M_S = 2e-5, 6.0, 7.0, 3000.0, 50.0
MIDDLE = np.array([4.2e6, 3.9e6, 3.2e6, -1500.0, 2500.0, 5000.0])

#: Across the plane through both sensors, and within it across the bisector of both lines of sight.
ACROSS = np.cross(SENSORS_M[0] - MIDDLE[:3], SENSORS_M[1] - MIDDLE[:3])
ACROSS /= np.linalg.norm(ACROSS)
WITHIN = np.cross(ACROSS, MIDDLE[:3] - SENSORS_M.mean(axis=0))
WITHIN /= np.linalg.norm(WITHIN)

#: An error of one look, m.
LOOK_M = SIGMA_RAD * float(np.linalg.norm(MIDDLE[:3] - SENSORS_M[0]))


def half(shift_m: np.ndarray) -> np.ndarray:
    """Return the states (2, 6) of two targets this far apart."""
    return MIDDLE + np.concatenate([np.stack([0.5 * shift_m, -0.5 * shift_m]), np.zeros((2, 3))], axis=1)


def bank_of(states: np.ndarray) -> ModeEstimates:
    """Return estimates about states (2, 6), as sure as what was known of both beforehand."""
    root = np.tile(np.diag(1.0 / np.repeat([PRIOR_M, PRIOR_M_S, 20.0, 0.5], 3)), (2, 1, 1))
    boost = np.concatenate([states, np.zeros((2, 6))], axis=1)
    return ModeEstimates(
        np.tile([0.0, 1.0], (2, 1)), boost, root, states.copy(), root[:, :COAST, :COAST].copy(), np.ones((2, 3))
    )


def planes(time_s: float, sensor: int) -> np.ndarray:
    """Return the axes (3, 3) of the plane in which the middle is seen."""
    off = COASTING.propagated(MIDDLE[None], np.array([time_s - END_S]))[0, :3] - SENSORS_M[sensor]
    return tangent_axes((off / np.linalg.norm(off))[None])[0]


def in_plane(states: np.ndarray, time_s: float, sensor: int) -> np.ndarray:
    """Return where (2, 2) targets in states at the end are seen at a time."""
    place = COASTING.propagated(states, np.full(len(states), time_s - END_S))[:, :3]
    local = (place - SENSORS_M[sensor]) @ planes(time_s, sensor).T
    return local[:, :2] / local[:, 2:]


TIMES_S = np.arange(0.05, END_S, 0.1)


def scene(states: np.ndarray, seed: int) -> tuple[Histories, np.ndarray]:
    """Return histories of two tracks, each of which may have all rays, and the rays (120, 2, 2), shuffled in scans."""
    rng = np.random.default_rng(seed)
    rays = np.stack([in_plane(states, time_s, sensor) for time_s in TIMES_S for sensor in (0, 1)])
    rays = rays + SIGMA_RAD * rng.normal(size=rays.shape)
    turn = rng.integers(0, 2, len(rays))
    rays = np.stack([rays[np.arange(len(rays)), turn], rays[np.arange(len(rays)), 1 - turn]], axis=1)
    scan = np.arange(len(rays))
    second, sensor = (scan // 2) // 10, scan % 2
    middle = [(k + 0.5, s) for k in range(int(END_S)) for s in (0, 1)]
    axes = np.stack([planes(*one) for one in middle])
    spot = np.arange(2 * len(middle)) % len(middle)
    sights = AngleMeasurements(
        np.arange(2 * len(middle)) // len(middle),
        np.array([one[0] for one in middle])[spot],
        SENSORS_M[[one[1] for one in middle]][spot],
        axes[spot],
        np.zeros((len(spot), 2)),
        np.tile(np.eye(2), (len(spot), 1, 1)),
    )
    rows = np.array([(t, s, r) for t in (0, 1) for s in scan for r in (0, 1)])
    contested = AmbiguousMeasurements(
        measurement=rows[:, 0] * len(middle) + 2 * second[rows[:, 1]] + sensor[rows[:, 1]],
        line=2 * rows[:, 1] + rows[:, 2],
        scan=rows[:, 1],
        measured=rays[rows[:, 1], rows[:, 2]],
        sigma_rad=np.full(len(rows), SIGMA_RAD),
        log_odds=np.full(len(rows), ODDS),
        weight=np.full(len(rows), 0.5),
        end_s=np.full(len(rows), END_S),
    )
    first = bank_of(np.stack([MIDDLE, MIDDLE]))
    sensors = np.array([one[1] for one in middle])[spot]
    return Histories(np.arange(2), np.zeros(2), first, sights, sensors, contested), rays


def explained(states: np.ndarray, rays: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the log likelihood of all rays, with what was known before, and the odds (120, 2, 2) of track and ray.

    The seven ways in which two tracks may have two rays are written out.
    """
    total, ratios = 0.0, []
    for scan, (one, other) in enumerate(rays):
        seen = in_plane(states, TIMES_S[scan // 2], scan % 2)
        ratio = np.exp(
            ODDS - 0.5 * np.array([[np.sum((s - r) ** 2) for r in (one, other)] for s in seen]) / SIGMA_RAD**2
        )
        ratios.append(ratio)
        total += np.log(1.0 + ratio.sum() + ratio[0, 0] * ratio[1, 1] + ratio[0, 1] * ratio[1, 0])
    prior = (states - MIDDLE) / np.repeat([PRIOR_M, PRIOR_M_S], 3)
    return total - 0.5 * float(np.sum(prior * prior)), np.stack(ratios)


def test_shares_are_the_probabilities_over_all_explanations() -> None:
    states = half(0.8 * LOOK_M * ACROSS)
    histories, rays = scene(states, 1)
    ratio = explained(states, rays)[1]
    whole = 1.0 + ratio.sum(axis=(1, 2)) + ratio[:, 0, 0] * ratio[:, 1, 1] + ratio[:, 0, 1] * ratio[:, 1, 0]
    share = ratio * (1.0 + ratio[:, ::-1, ::-1]) / whole[:, None, None]
    told = reweighted(FILTER, histories, bank_of(states), END_S)[0].contested.weight.reshape(2, len(rays), 2)
    # A line of sight stands for a second: within it a path that is off moves by no more than a few metres.
    assert np.allclose(told, share.transpose(1, 0, 2), atol=0.02)


def test_every_turn_raises_the_likelihood_of_all_rays() -> None:
    histories, rays = scene(half(1.5 * LOOK_M * ACROSS), 2)
    bank = bank_of(half(0.3 * LOOK_M * ACROSS + 200.0 * WITHIN))
    reached = [explained(bank.coast_mean, rays)[0]]
    for _ in range(12):
        histories, bank = reweighted(FILTER, histories, bank, END_S)
        reached.append(explained(bank.coast_mean, rays)[0])
    assert np.diff(reached).min() > -0.05
    assert reached[-1] > reached[0] + 20.0


@pytest.mark.slow
def test_near_targets_are_not_driven_apart() -> None:
    """A look takes the nearer ray: two targets 1.2 errors apart would come out 1.5 apart, by the folded normal."""
    shift, found = 1.2 * LOOK_M, []
    for seed in range(20):
        histories, _ = scene(half(shift * ACROSS), 100 + seed)
        bank = bank_of(half(shift * ACROSS))
        for _ in range(15):
            histories, bank = reweighted(FILTER, histories, bank, END_S)
        found.append(float((bank.coast_mean[0, :3] - bank.coast_mean[1, :3]) @ ACROSS))
    error = np.std(found, ddof=1) / np.sqrt(len(found))
    assert error < 0.05 * LOOK_M
    assert abs(np.mean(found) - shift) < 3.88 * error  # 99.9 % of Student's t with 19 degrees of freedom


def crossed(states: np.ndarray) -> np.ndarray:
    """Return two states that follow from each target's first sensor and the other's second: ghosts."""
    seen = np.stack([in_plane(states, END_S, sensor) for sensor in (0, 1)])
    rows = [planes(END_S, sensor)[:2] / np.linalg.norm(MIDDLE[:3] - SENSORS_M[sensor]) for sensor in (0, 1)]
    matrix = np.concatenate(rows)
    ghosts = states.copy()
    for one, other in ((0, 1), (1, 0)):
        place = np.linalg.lstsq(matrix, np.concatenate([seen[0, one], seen[1, other]]), rcond=None)[0]
        ghosts[one, :3] = MIDDLE[:3] + place
    return ghosts


def test_an_exchange_is_judged_by_what_both_settle_into() -> None:
    """From the ghosts it gains what it loses from the targets, though shares lean to wherever the tracks are."""
    states = half(0.9 * LOOK_M * ACROSS + 1.4 * LOOK_M * WITHIN)
    histories, rays = scene(states, 5)
    settled, gains = [], []
    for start in (states, crossed(states)):
        known, bank = histories, bank_of(start)
        for _ in range(15):
            known, bank = reweighted(FILTER, known, bank, END_S)
        others = known.measurements.with_track(
            np.where(known.sensor == 1, 1 - known.measurements.track, known.measurements.track)
        )
        after = updated_with_likelihood(
            FILTER, evolve(known.first, weight=bank.weight, detection_rate=bank.detection_rate), END_S, others
        )[1]
        gain, _ = swap_log_likelihoods(FILTER, known, bank, END_S, 1, np.array([[0, 1]]), after)
        settled.append(explained(bank.coast_mean, rays)[0])
        gains.append(float(gain[0]))
    assert settled[0] > settled[1] + 3.0
    assert gains[0] == pytest.approx(settled[1] - settled[0], abs=1.5)
    assert gains[1] == pytest.approx(settled[0] - settled[1], abs=1.5)


def test_what_settled_tracks_had_is_the_less_others() -> None:
    histories, _ = scene(half(1.0 * LOOK_M * ACROSS), 6)
    known, _ = reweighted(FILTER, histories, bank_of(half(1.0 * LOOK_M * ACROSS)), END_S)
    theirs = known.contested.weight[known.measurements.track[known.contested.measurement] == 1]
    left = known.of(np.array([True, False])).contested
    assert np.allclose(np.exp(left.log_odds - ODDS), np.maximum(1.0 - theirs, 1e-6))


def test_what_a_removed_measurement_had_of_a_line_is_left_to_nobody_else():
    lines = AmbiguousMeasurements(
        measurement=np.array([0, 1, 1, 2]),
        line=np.array([0, 0, 3, 3]),
        scan=np.array([0, 0, 1, 1]),
        measured=np.zeros((4, 2)),
        sigma_rad=np.full(4, SIGMA_RAD),
        log_odds=np.zeros(4),
        weight=np.array([0.75, 0.25, 0.5, 0.5]),
        end_s=np.zeros(4),
    )
    left = lines.without(np.array([True, False, False]), np.array([-1, 0, 1]))
    assert left.measurement.tolist() == [0, 0, 1]
    assert np.exp(left.log_odds) == pytest.approx([0.25, 1.0, 1.0])
