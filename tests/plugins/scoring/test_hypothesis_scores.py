"""Hypotheses of made-up tracks of launches, fires, bolides and false alarms: scores, recognition,
false launches.
"""

from functools import cache

import numpy as np
import pytest
from attrs import evolve
from opir_scoring import (
    RunEvidence,
    ScoreSettings,
    open_set_rate,
    ownership,
    reliability,
    scorecard,
    scorecard_text,
)
from opir_scoring.hypothesis_scores import AGES, hypothesis_scores, true_hypotheses
from opir_scoring.launch_recognition import recognition
from opir_scoring.proper_scores import LEAST_PROBABILITY, share_above
from opir_testing import stub_estimates

from opir_core import compile_plan
from opir_core.reading import scene_from_mapping

LAUNCH = {"lat_deg": 28.5, "lon_deg": -140.6}
SCENE = {
    "scene": "hypotheses",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 1800.0,
    "sensors": [{"model": "SBIRS-GEO", "id": "A", "orbital_slot_deg": -150.0}],
    "targets": [
        {
            "id": "M",
            "type": "IRBM",
            "launch": {**LAUNCH, "time_s": 10.0},
            "aim": {"lat_deg": 12.0, "lon_deg": 177.7},
        },
        {"id": "S", "type": "SLV", "azimuth_deg": 90.0, "launch": {**LAUNCH, "time_s": 12.0}},
    ],
    "sources": [
        {"id": "fire", "model": "fires", "at": [{"lat_deg": 20.0, "lon_deg": -150.0}]},
        {
            "id": "meteor",
            "model": "bolides",
            "at": [{"lat_deg": 20.0, "lon_deg": -140.0, "start_s": 60.0}],
        },
    ],
    "detection": "snr",
    "tracker": "none",
}
#: Tracks by number: of M, S, the fire, the bolide, a false alarm.
NAMES = ("IRBM", "SLV", "ground source", "bolide", "noise")


@cache
def plan():
    return compile_plan(scene_from_mapping(SCENE))


def names():
    return [hypothesis.name for hypothesis in plan().hypotheses]


def stated(name, probability):
    """Return probabilities with that of one hypothesis; the rest is spread evenly."""
    remainder = np.full(len(names()), (1.0 - probability) / (len(names()) - 1))
    remainder[names().index(name)] = probability
    return remainder


def evidence_of(rows):
    """Return a run with tracks; rows are tick, track and probabilities."""
    rows = sorted(rows, key=lambda row: row[:2])
    tick_s, track, probability = (np.array(column) for column in zip(*rows, strict=True))
    launch = np.isin([each.group for each in plan().hypotheses], ("missile", "orbit", "glide"))
    tracks = evolve(
        stub_estimates(len(rows), tick_s=tick_s),
        track=track.astype(np.int64),
        hypothesis_probability=probability,
        probability_launch=probability[:, launch].sum(axis=1),
    )
    seen = np.arange(5)
    return RunEvidence(
        plan=plan(),
        tracks=tracks,
        time_s=seen + 20.0,
        sensor=np.zeros(5, dtype=np.int32),
        sigma_rad=np.full(5, 1e-5),
        track=np.where(np.isin(seen, track), seen, -1),
        target=np.array([0, 1, 2, 3, -1], dtype=np.int32),
        direction_ecef=np.zeros((5, 3)),
        sensor_ecef_m=np.zeros((5, 3)),
    )


def test_each_track_has_the_hypothesis_of_what_it_follows():
    evidence = evidence_of([(20.0, track, stated("noise", 0.5)) for track in range(5)])
    owners = ownership(evidence)
    assert [names()[number] for number in true_hypotheses(evidence, owners)] == list(NAMES)
    assert owners.target.tolist() == [0, 1, -1, -1, -1]
    left_out = [names()[number] for number in true_hypotheses(evidence, owners, ("SLV", "fire"))]
    assert left_out == ["IRBM", "none of these", "ground source", "bolide", "noise"]


def test_kinds_with_names_of_their_own_are_none_of_these_or_what_they_resemble():
    place = {"lat_deg": 20.0, "lon_deg": -150.0}
    models = ("aircraft", "fire_fronts", "grazers", "fires")
    sources = [{"id": model, "model": model, "at": [place]} for model in models]
    moving = compile_plan(scene_from_mapping({**SCENE, "targets": [], "sources": sources}))
    evidence = evolve(
        evidence_of([(20.0, track, stated("noise", 0.5)) for track in range(5)]), plan=moving
    )
    evidence = evolve(evidence, target=np.array([0, 1, 2, 3, -1], dtype=np.int32))
    true = true_hypotheses(evidence, ownership(evidence))
    expected = ["none of these", "ground source", "bolide", "ground source", "noise"]
    assert [names()[number] for number in true] == expected


def test_a_track_is_scored_at_each_age_that_it_reaches_and_last():
    probabilities = {20.0: 0.2, 24.0: 0.4, 26.0: 0.6, 33.0: 0.9}
    rows = [
        (tick_s, 0, stated("IRBM", probability)) for tick_s, probability in probabilities.items()
    ]
    evidence = evidence_of([*rows, (22.0, 2, stated("ground source", 0.0))])
    scores = hypothesis_scores(evidence, ownership(evidence))
    own = scores.take(scores.truth == names().index("IRBM"))
    assert [AGES[age] for age in own.age] == ["0 s", "5 s", "10 s", "last estimate"]
    np.testing.assert_allclose(own.log_score, -np.log([0.2, 0.4, 0.6, 0.9]))
    share = 0.1 / (len(names()) - 1)
    assert own.brier[-1] == pytest.approx(0.1**2 + (len(names()) - 1) * share**2)
    assert own.confidence[-1] == 0.9
    fire = scores.take(scores.truth != names().index("IRBM"))
    np.testing.assert_allclose(fire.log_score, -np.log(LEAST_PROBABILITY))


def test_nothing_is_true_of_a_track_without_detections():
    evidence = evidence_of([(20.0, track, stated("noise", 0.5)) for track in (0, 9)])
    scores = hypothesis_scores(evidence, ownership(evidence))
    assert set(scores.truth) == {names().index("IRBM")}


def test_a_tracker_that_weighs_nothing_has_no_scores():
    evidence = evidence_of([(20.0, 0, stated("IRBM", 0.9))])
    silent = evolve(evidence, tracks=stub_estimates(1, tick_s=20.0))
    assert not len(hypothesis_scores(silent, ownership(silent)))
    result = scorecard([silent]).figures["recognition"]
    assert np.isnan(result["false_launches_an_hour"]["value"])
    assert np.isnan(result["launches_recognised"]["value"])
    assert "by age of the track" not in scorecard_text({"silent": scorecard([silent])})


def test_the_stated_probability_of_a_launch_has_those_of_unknown_classes():
    evidence = evidence_of([(20.0, 0, stated("none of these", 0.5))])
    tracks = evolve(evidence.tracks, probability_launch=np.array([0.99]))
    evidence = evolve(evidence, tracks=tracks)
    assert set(hypothesis_scores(evidence, ownership(evidence)).launch) == {0.99}
    assert repr(scorecard([evidence])).startswith("<Scorecard: 1 run, ")


def test_launches_are_recognised_and_false_ones_counted():
    rows = [
        (20.0, 0, stated("ground source", 0.9)),
        (21.0, 0, stated("IRBM", 0.7)),
        (25.0, 0, stated("IRBM", 0.999)),
        (20.0, 1, stated("noise", 0.9)),
        # Above the threshold once, and not at the end.
        (20.0, 2, stated("IRBM", 0.7)),
        (21.0, 2, stated("ground source", 0.99)),
        (21.0, 3, stated("bolide", 0.99)),
    ]
    evidence = evidence_of(rows)
    result = recognition(evidence, ownership(evidence), 0.5)
    assert result.false_launches == 1
    assert result.hours == 0.5
    assert result.recognised_after_s.tolist() == [11.0, np.inf]
    assert result.sure_after_s.tolist() == [15.0, np.inf]
    assert recognition(evidence, ownership(evidence), 0.95).false_launches == 0
    figures = scorecard([evidence]).figures["recognition"]
    assert figures["false_launches_an_hour"]["value"] == 2.0
    # Garwood's exact interval of one event, in half an hour.
    np.testing.assert_allclose(
        figures["false_launches_an_hour"]["interval_95"], [0.0506, 11.143], atol=1e-3
    )
    assert figures["launches_recognised"]["value"] == 0.5
    assert figures["launches"][0] == {
        "seed": 0,
        "target": "M",
        "recognised_after_s": 11.0,
        "sure_after_s": 15.0,
    }
    text = scorecard_text({"mine": scorecard([evidence], ScoreSettings(unknown=("SLV",)))})
    assert "false launches per hour" in text
    assert "never" in text
    assert "unknown" in text


def test_classes_that_are_left_out_are_unknown():
    rows = [(20.0, track, stated(name, 0.8)) for track, name in enumerate(NAMES)]
    rows[1] = (20.0, 1, stated("none of these", 0.9))
    by_age = scorecard([evidence_of(rows)], ScoreSettings(unknown=("SLV",))).figures["hypotheses"][
        "by_age"
    ]
    assert by_age[-1]["unknown_tracks"] == 1
    assert by_age[-1]["none_auroc"] == 1.0
    assert by_age[-1]["oscr"] == 1.0
    assert by_age[-1]["right"]["value"] == 1.0
    confusion = scorecard([evidence_of(rows)]).figures["hypotheses"]["confusion"]
    assert confusion["SLV"] == {"none of these": 1}
    assert confusion["bolide"] == {"bolide": 1}


def test_calibrated_probabilities_are_reliable():
    rng = np.random.default_rng(3)
    probability = rng.uniform(size=20_000)
    rows = reliability(probability, rng.uniform(size=20_000) < probability)
    assert sum(row["samples"] for row in rows) == 20_000
    for row in rows:
        assert row["value"] == pytest.approx(row["stated_mean"], abs=0.06)
    sure = reliability(np.full(100, 0.995), np.arange(100) < 78)[-1]
    assert sure["value"] == 0.78
    assert sure["interval_95"][1] < 0.9


def test_areas_under_curves_are_those_of_thresholds():
    rng = np.random.default_rng(4)
    known = np.round(rng.normal(1.0, 1.0, 60), 1)
    unknown = np.round(rng.normal(0.0, 1.0, 40), 1)
    is_right = rng.uniform(size=60) < 0.7
    levels = np.concatenate([[np.inf], np.unique(np.concatenate([known, unknown]))[::-1]])
    true, right, false = (
        np.array(
            [
                np.mean(passed >= level) if what is None else np.mean((passed >= level) & what)
                for level in levels
            ]
        )
        for passed, what in ((known, None), (known, is_right), (unknown, None))
    )
    assert share_above(known, unknown) == pytest.approx(np.trapezoid(true, false))
    assert open_set_rate(known, is_right, unknown) == pytest.approx(np.trapezoid(right, false))
    assert np.isnan(open_set_rate(known, is_right, unknown[:0]))
