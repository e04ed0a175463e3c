"""Scores: each figure against a case whose answer is known without it."""

import numpy as np
import pytest
from attrs import evolve
from opir_scoring import (
    consistency,
    containment,
    evidence_of_run,
    ground_error,
    nees,
    ownership,
    true_states_ecef,
)
from opir_scoring.containments import innovations, on_normal_scale, proportion, root_mean_square
from scipy.stats import chi2
from scored_scene import SCENE

import opir_core as opir
from opir_core import compile_plan, run_of_plan
from opir_core.reading import scene_from_mapping

RNG = np.random.default_rng(11)


def random_covariance(size):
    root = RNG.normal(size=(size, size)) * np.logspace(0, 4, size)[:, None]
    return root @ root.T


def test_nees_is_the_squared_length_of_whitened_errors():
    covariance = np.stack([random_covariance(6) for _ in range(20)])
    white = RNG.normal(size=(20, 6))
    error = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), white)
    assert nees(error, covariance) == pytest.approx(np.sum(white**2, axis=1), rel=1e-6)


def test_nees_of_unknown_and_invalid_covariances():
    covariance = np.stack(
        [np.eye(2), np.full((2, 2), np.nan), -np.eye(2), np.ones((2, 2)) * 2.0 - np.eye(2)]
    )
    value = nees(np.ones((4, 2)), covariance)
    assert value[0] == pytest.approx(2.0)
    assert np.isnan(value[1])
    assert np.isinf(value[2:]).all()


def test_honest_samples_pass_and_others_do_not():
    honest = chi2(6).rvs(2000, random_state=3)
    result = consistency(honest, 6)
    assert result.is_inside
    assert result.p_value > 0.001
    assert not consistency(1.3 * honest, 6).is_inside
    # Half far too large, half far too small: the mean is right, the distribution is not.
    mixed = np.where(np.arange(2000) % 2 == 0, 0.2, 1.8) * honest
    assert abs(consistency(mixed, 6).mean / 6.0 - 1.0) < 0.1
    assert consistency(mixed, 6).p_value < 1e-6


def test_containment_of_honest_ellipses_is_nominal():
    values = chi2(2).rvs(5000, random_state=5)
    for nominal in (0.5, 0.9, 0.95):
        share, low, high = containment(values, 2, nominal)
        assert low < nominal < high
        assert share == pytest.approx(nominal, abs=0.02)


def test_a_proportions_interval_is_wilsons():
    # Brown, Cai and DasGupta, Statistical Science 16 (2001): no interval beyond [0, 1], none of
    # length 0 at 0 of n.
    assert proportion(0, 10) == pytest.approx((0.0, 0.0, 0.27753), abs=1e-5)
    assert proportion(10, 10)[2] == pytest.approx(1.0)
    assert np.isnan(proportion(0, 0)).all()


def test_radii_that_are_reported_are_judged_as_they_are_reported():
    reported = np.array([0.8, 1.9, 2.6])
    edges = np.square(np.concatenate([reported * (1.0 - 1e-9), reported * (1.0 + 1e-9)]))
    scaled = on_normal_scale(edges, np.tile(reported, (6, 1)))
    for nominal, inside in ((0.5, 1), (0.9, 2), (0.95, 3)):
        assert np.count_nonzero(scaled <= chi2.ppf(nominal, 2)) == inside + (inside - 1)


def test_scales_of_radii_rise_where_radii_are_reported():
    values = np.append(np.linspace(0.0, 30.0, 301), [np.inf, np.nan])
    scaled = on_normal_scale(values, np.tile([0.8, 1.9, 2.6], (303, 1)))
    assert np.all(np.diff(scaled[:302]) > 0.0)
    assert np.isnan(scaled[302])
    assert np.array_equal(
        on_normal_scale(values, np.full((303, 3), np.nan)), values, equal_nan=True
    )
    for freedom in (2, 6):
        usual = np.tile(np.sqrt(chi2.ppf([0.5, 0.9, 0.95], freedom)), (303, 1))
        assert on_normal_scale(values, usual, freedom) == pytest.approx(
            values, rel=1e-12, nan_ok=True
        )


def test_errors_that_depend_on_each_other_widen_the_interval():
    error = np.repeat(RNG.normal(size=20), 50)
    alone = root_mean_square(error)
    together = root_mean_square(error, np.repeat(np.arange(20), 50))
    assert alone[0] == together[0]
    assert together[2] - together[1] > 4.0 * (alone[2] - alone[1])
    assert np.isnan(root_mean_square(error, np.zeros(1000, dtype=np.int64))[1:]).all()


def test_a_root_mean_square_has_its_interval_about_it():
    value, low, high = root_mean_square(RNG.normal(size=500) * 3.0)
    assert low < value < high
    assert value == pytest.approx(3.0, rel=0.15)
    assert np.isnan(root_mean_square(np.array([np.nan]))).all()


def judged_innovations(scale):
    """Return the innovations of a tracker that errs `scale` times as much as it says."""
    plan = compile_plan(scene_from_mapping({**SCENE, "duration_s": 130.0}))
    evidence = evidence_of_run(run_of_plan(plan), plan)
    reported = evidence.tracks.take(evidence.tracks.track == evidence.tracks.track[0])
    reported = reported.take((reported.tick_s > 30.0) & (reported.tick_s < 129.0))
    rng = np.random.default_rng(2)
    sigma = np.array([400.0] * 3 + [5.0] * 3)
    state = true_states_ecef(plan, np.zeros(len(reported), dtype=np.int32), reported.tick_s)
    state = state + scale * sigma * rng.normal(size=state.shape)
    reported = evolve(
        reported, state=state, state_covariance=np.tile(np.diag(sigma**2), (len(reported), 1, 1))
    )
    evidence = evolve(evidence, tracks=reported)
    return innovations(evidence, ownership(evidence))


@pytest.mark.slow
def test_innovations_of_an_honest_tracker_are_chi_squared():
    result = judged_innovations(1.0)
    assert len(result) > 80
    honest = consistency(result.nis, 2, 0.999)
    assert honest.is_inside
    assert honest.p_value > 0.001
    assert not consistency(judged_innovations(3.0).nis, 2, 0.999).is_inside


def test_the_true_velocity_at_burnout_is_that_of_the_burnout() -> None:
    """Where thrust is greatest, and the truth ends: half a step of a plain difference would be off
    by 9 m/s there.
    """
    plan = opir.compile_plan(
        opir.load_scene("tests/scenes/pacific_test_range.yaml", overrides=["outputs=[]"])
    )
    everyone = np.arange(3, dtype=np.int32)
    states = true_states_ecef(plan, everyone, plan.targets.burnout_s[everyone])
    reported = [each["burnout"]["velocity_ecef_m_s"] for each in plan.targets.truth()]
    assert states[:, 3:] == pytest.approx(np.array(reported), abs=0.1)
    at_rest = true_states_ecef(plan, everyone, plan.targets.ignition_s[everyone])
    assert at_rest[:, 3:] == pytest.approx(0.0, abs=0.1)


def test_true_states_are_those_of_the_trajectory():
    plan = compile_plan(scene_from_mapping(SCENE))
    times = np.array([5.0, 10.0, 80.0, 200.0, 5000.0])
    states = true_states_ecef(plan, np.zeros(5, dtype=np.int32), times)
    assert np.isnan(states[[0, 4]]).all()
    boost = plan.targets.trajectories[0].flight.path
    position, velocity = boost.state(np.zeros(3, dtype=np.int64), times[1:4])
    assert np.abs(states[1:4, :3] - position).max() < 0.02
    assert np.abs(states[1:4, 3:] - velocity).max() < 0.1


def test_errors_on_the_ground_are_as_long_as_the_way_over_it():
    """A third of the way round the Earth, where a plane at the estimate would say 5500 km."""
    place = np.radians([[0.0, 120.0], [0.0, 0.05], [0.0, 10.0]])
    point = np.zeros((3, 3))
    error = ground_error(point, np.column_stack([place, np.zeros(3)]))
    length = 6378137.0 * place[:, 1]
    assert error[:, 0] == pytest.approx(-length, rel=1e-6)
    assert error[:, 1] == pytest.approx(0.0, abs=0.01)
    north = ground_error(
        point, np.array([[np.pi / 2, 0.0, 0.0], [0.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])
    )
    # The quarter of the meridian of WGS 84.
    assert north[0] == pytest.approx([0.0, -10001965.729], abs=0.01)
    assert north[1].tolist() == [0.0, 0.0]
    assert np.isnan(north[2]).all()


@pytest.mark.slow
@pytest.mark.parametrize("clusters", [2, 3, 5, 20])
def test_intervals_of_few_tracks_are_calibrated(clusters):
    rng = np.random.default_rng(4)
    held = 0
    trials = 1000
    for _ in range(trials):
        size = np.linalg.norm(rng.normal(size=(clusters, 3)), axis=1)
        ticks = rng.integers(3, 8, clusters)
        _, low, high = root_mean_square(
            np.repeat(size, ticks), np.repeat(np.arange(clusters), ticks)
        )
        held += low <= np.sqrt(3.0) <= high
    assert 0.92 < held / trials < 0.98
