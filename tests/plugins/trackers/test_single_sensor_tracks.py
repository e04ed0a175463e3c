"""One sensor alone: a target's range is hardly known, its track says so, and is one from first
light to the end.
"""

import numpy as np
import pytest
from opir_scoring import evidence_of_run
from opir_scoring.containments import nees
from opir_scoring.evidence import ownership, true_states_ecef
from opir_trackers.imm.prune import are_below_ground, are_uncertain, have_come_down
from repository import EXAMPLES, TEST_SCENES

from opir_core.planning.plan import compile_plan
from opir_core.reading import load_scene
from opir_core.simulation.run import run_of_plan

SCENE = TEST_SCENES / "pacific_test_range.yaml"
ALONE = "sensors=[{model: SBIRS-GEO, id: A, orbital_slot_deg: -150}]"

#: χ² of six degrees of freedom that is exceeded once in 100 000.
RARE = 33.1


@pytest.mark.slow
def test_what_one_sensor_sees_is_one_track_a_launch_that_says_how_little_it_knows() -> None:
    plan = compile_plan(
        load_scene(SCENE, overrides=[ALONE, "duration_s=180", "tracker=imm", "seed=8"])
    )
    evidence = evidence_of_run(run_of_plan(plan), plan)
    owners = ownership(evidence)
    assert sorted(owners.target.tolist()) == [0, 1, 2]
    launched = (evidence.tracks.tick_s % 20.0 == 0.0) & (evidence.tracks.probability_launch > 0.5)
    reported = evidence.tracks.take(np.flatnonzero(launched))
    target = owners.target[np.searchsorted(owners.track, reported.track)]
    away = reported.state - true_states_ecef(plan, target, reported.tick_s)
    known = np.flatnonzero(np.isfinite(away).all(axis=1))
    assert len(known) >= 12
    assert np.sqrt(np.trace(reported.state_covariance[:, :3, :3], axis1=1, axis2=2)).max() > 5e3
    assert nees(away, reported.state_covariance)[known].max() < RARE


def test_an_estimate_below_the_ground_ends_a_track_that_is_silent_or_sure() -> None:
    position = np.tile([6.378137e6 - 60e3, 0.0, 0.0], (3, 1))
    covariance = np.stack([np.eye(6) * sigma_m**2 for sigma_m in (1e3, 1e5, 1e5)])
    assert are_below_ground(position).all()
    assert have_come_down(position, covariance, np.array([False, False, True])).tolist() == [
        True,
        False,
        True,
    ]
    assert not have_come_down(
        position + np.array([50e3, 0.0, 0.0]), covariance, np.ones(3, dtype=bool)
    ).any()


@pytest.mark.parametrize(
    "variances", [(1.0, 1.0, 1.0), (0.6, 0.3, 2.1), (2.1, 0.6, 0.3), (0.3, 2.1, 0.6)]
)
def test_a_seen_track_comes_down_three_sigmas_of_its_position_below_the_lowest_height(
    variances: tuple[float, ...],
) -> None:
    """Of 10 km in all three axes together: 50 km below the ground, 20 km of which every track may
    be.
    """
    position = np.array([[6.378137e6 - depth_m, 0.0, 0.0] for depth_m in (49e3, 51e3)])
    covariance = np.tile(np.diag([*(1e8 / 3.0 * np.array(variances)), 1.0, 1.0, 1.0]), (2, 1, 1))
    assert have_come_down(position, covariance, np.zeros(2, dtype=bool)).tolist() == [False, True]
    assert are_uncertain(covariance, 9.9e3).all()
    assert not are_uncertain(covariance, 10.1e3).any()


@pytest.mark.slow
def test_a_sensor_that_sees_a_launch_near_its_horizon_says_how_little_it_knows() -> None:
    """The ray meets a height that is off by kilometres hundreds of kilometres from the target."""
    squares = []
    for seed in range(4):
        looks = "sensors=[{model: SBIRS-GEO, id: A, orbital_slot_deg: 160}]"
        plan = compile_plan(
            load_scene(SCENE, overrides=[looks, "duration_s=70", "tracker=imm", f"seed={seed}"])
        )
        evidence = evidence_of_run(run_of_plan(plan), plan)
        owners = ownership(evidence)
        target = owners.target[np.searchsorted(owners.track, evidence.tracks.track)]
        reported = evidence.tracks.take(
            np.flatnonzero((target == 0) & (evidence.tracks.tick_s == 40.0))
        )
        away = reported.state - true_states_ecef(
            plan, np.zeros(len(reported), dtype=np.int64), reported.tick_s
        )
        squares += nees(away, reported.state_covariance).tolist()
    assert len(squares) == 4
    assert max(squares) < RARE


def test_the_state_of_a_launch_is_as_sure_as_it_says_before_it_is_recognised() -> None:
    """A mixture with a source that stands held one in ten: a thousand fires are expected for one
    launch.
    """
    squares = []
    for seed in (12, 14):
        plan = compile_plan(
            load_scene(
                EXAMPLES / "first_light.yaml",
                overrides=["duration_s=60", "tracker=imm", f"seed={seed}"],
            )
        )
        tracks = run_of_plan(plan).tracks
        reported = tracks.take(np.flatnonzero(tracks.probability_launch < 0.5))
        away = reported.state - true_states_ecef(
            plan, np.zeros(len(reported), dtype=np.int64), reported.tick_s
        )
        squares += nees(away, reported.state_covariance).tolist()
    assert len(squares) > 30
    assert np.mean(np.array(squares) < 12.59) >= 0.9
    # Few tracks, whose ticks are correlated: four times the covariance is a quarter of one, and
    # below both.
    assert 0.26 < np.mean(squares) / 6.0 < 1.5
