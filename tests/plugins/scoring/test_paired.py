"""Trackers are compared at the ticks that all of them have, and coverage stands beside."""

import numpy as np
import pytest
from attrs import evolve
from opir_scoring import (
    ScoreSettings,
    comparison_text,
    evidence_of_run,
    paired_figures,
    scorecard_of,
    scorecard_text,
    scored_run,
    true_states_ecef,
)
from scipy.stats import ttest_rel
from scored_scene import SCENE

from opir_core import compile_plan, run_of_plan
from opir_core.plugin import Tracks
from opir_core.reading import scene_from_mapping

SETTINGS = ScoreSettings()
LATE_S = 50.0


@pytest.fixture(scope="module")
def seen():
    """Return the evidence of a run whose one launch, at 10 s, burns on to the end at 90 s, and its
    true states.
    """
    plan = compile_plan(scene_from_mapping(SCENE))
    run = run_of_plan(plan)
    evidence = evidence_of_run(run, plan)
    return evidence, true_states_ecef(
        plan, np.zeros(len(run.tracks), dtype=np.int32), run.tracks.tick_s
    )


def estimating(seen, errors_m, from_s=0.0):
    """Return the scored runs of a tracker of points, m off, as many as there are errors (before
    `LATE_S`, later).
    """
    evidence, true = seen
    runs = []
    for number, (early_m, later_m) in enumerate(errors_m):
        rows = np.flatnonzero(evidence.tracks.tick_s >= from_s)
        tracks = evidence.tracks.take(rows)
        off_m = np.where(tracks.tick_s < LATE_S, early_m, later_m)
        tracks = evolve(
            tracks,
            state=true[rows] + off_m[:, None] * np.eye(6)[0],
            state_covariance=np.full((len(rows), 6, 6), np.nan),
        )
        plan = evolve(evidence.plan, scene=evolve(evidence.plan.scene, seed=number))
        runs.append(scored_run(evolve(evidence, plan=plan, tracks=tracks), SETTINGS))
    return runs


def test_a_late_start_wins_nothing(seen):
    early = [(2000.0, 300.0), (2100.0, 310.0), (1900.0, 305.0)]
    late = [(np.nan, 400.0), (np.nan, 415.0), (np.nan, 395.0)]
    runs = {"early": estimating(seen, early), "late": estimating(seen, late, LATE_S)}
    result = paired_figures(runs, SETTINGS)
    assert result["ticks"]["late"] == result["common_ticks"] < result["ticks"]["early"]
    table = result["states"]["position_energy_m"]
    assert result["best"] == "early"
    assert result["certain"] == ["late"]
    assert table["errors"] == pytest.approx(
        {"early": 305.0, "late": np.mean([400.0, 415.0, 395.0])}
    )
    # As many ticks in each run: the jackknife is Student's paired test of the means of runs.
    expected = ttest_rel([400.0, 415.0, 395.0], [300.0, 310.0, 305.0]).confidence_interval()
    assert table["differences"]["late"]["interval_95"] == pytest.approx(
        [expected.low, expected.high]
    )
    cards = {name: scorecard_of(own, SETTINGS) for name, own in runs.items()}
    assert "Best on the" in comparison_text(result, cards)
    # Each by itself says the opposite, so coverage is beside.
    early_m, late_m = (
        np.concatenate([run.states.position_energy_m for run in own]).mean()
        for own in runs.values()
    )
    assert late_m < early_m
    assert (
        cards["late"].figures["completeness"]["value"]
        < cards["early"].figures["completeness"]["value"]
    )


def test_the_better_of_few_ticks_is_named_with_its_coverage(seen):
    runs = {
        "whole": estimating(seen, [(500.0, 500.0), (510.0, 510.0)]),
        "late": estimating(seen, [(np.nan, 100.0), (np.nan, 101.0)], LATE_S),
    }
    cards = {name: scorecard_of(own, SETTINGS) for name, own in runs.items()}
    text = comparison_text(paired_figures(runs, SETTINGS), cards)
    assert "late covers" in text
    assert "the verdict is of the common ones alone" in text


def test_what_differs_from_run_to_run_is_not_certain(seen):
    runs = {
        "one": estimating(seen, [(100.0, 100.0), (300.0, 300.0), (200.0, 200.0)]),
        "other": estimating(seen, [(210.0, 210.0), (190.0, 190.0), (230.0, 230.0)]),
    }
    result = paired_figures(runs, SETTINGS)
    assert result["best"] == "one"
    assert result["certain"] == []
    cards = {name: scorecard_of(own, SETTINGS) for name, own in runs.items()}
    assert "No tracker is certain to be the best" in comparison_text(result, cards)


def test_a_time_at_which_another_is_better_is_named(seen):
    runs = {
        "steady": estimating(seen, [(200.0, 200.0), (201.0, 201.0)]),
        "starting": estimating(seen, [(100.0, 900.0), (101.0, 901.0)]),
    }
    cards = {name: scorecard_of(own, SETTINGS) for name, own in runs.items()}
    text = comparison_text(paired_figures(runs, SETTINGS), cards)
    assert "have: steady" in text
    assert "starting is better at 0-20 s, 20-40 s" in text


def test_a_tracker_without_estimates_spoils_no_comparison(seen):
    runs = {
        "one": estimating(seen, [(100.0, 100.0)]),
        "other": estimating(seen, [(200.0, 200.0)]),
        "silent": estimating(seen, [(np.nan, np.nan)]),
    }
    result = paired_figures(runs, SETTINGS)
    assert result["without_estimates"] == ["silent"]
    assert result["common_ticks"] == result["ticks"]["one"] > 0
    cards = {name: scorecard_of(own, SETTINGS) for name, own in runs.items()}
    assert "silent never estimates a state" in comparison_text(result, cards)


def test_figures_of_some_launches_have_their_share_beside_them(seen):
    """Of two launches that are detected one is tracked."""
    evidence, _ = seen
    untracked = evolve(evidence, tracks=Tracks.empty(), track=np.full(len(evidence.track), -1))
    runs = [*estimating(seen, [(100.0, 100.0)]), scored_run(untracked, SETTINGS)]
    card = scorecard_of(runs, SETTINGS)
    for figure, share in (
        ("tracks_a_launch", 0.5),
        ("first_track_after_s", 0.5),
        ("completeness", 1.0),
    ):
        assert card.figures[figure]["share"] == share
    assert card.figures["completeness"]["value"] < 0.6
    lines = scorecard_text({"mine": card}).splitlines()
    (after,) = [line for line in lines if line.startswith("first track after, s")]
    assert after.endswith("(50 %)")
    (covered,) = [line for line in lines if line.startswith("completeness")]
    assert "%" not in covered
    text = comparison_text(paired_figures({"mine": runs}, SETTINGS), {"mine": card})
    assert next(
        line for line in text.splitlines() if line.startswith("first track after")
    ).endswith("(50 %)")
