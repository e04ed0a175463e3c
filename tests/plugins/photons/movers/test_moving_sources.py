"""Sources that move in scenes: what is refused and where, their kinds in truth and reports, and
classifiers that are not told of them.
"""

import pytest

import opir_core as opir
from opir_core.errors import OpirError
from opir_core.plugin import REPORTED_TYPES

SCENE = {
    "scene": "sky",
    "epoch": "2026-04-01T20:00:00Z",
    "duration_s": 12.0,
    "detection": "snr",
    "classification": "spectral",
    "sensors": [{"model": "SBIRS-GEO", "id": "S1", "orbital_slot_deg": 40.0}],
}
HERE = {"lat_deg": 10.0, "lon_deg": 40.0}
JET = {"heading_deg": 0.0, "height_m": 3000.0, "speed_m_s": 200.0, **HERE}


def scene(*sources, **changes):
    blocks = [{"id": f"B{number}", **block} for number, block in enumerate(sources)]
    return opir.scene_from_mapping({**SCENE, "sources": blocks, **changes})


def refusal(*sources, **changes):
    with pytest.raises(OpirError) as caught:
        opir.compile_plan(scene(*sources, **changes))
    return str(caught.value)


def jet(*legs, **changes):
    return {"model": "aircraft", "at": [JET], "legs": list(legs), **changes}


@pytest.mark.parametrize(
    ("block", "words"),
    [
        (jet({"climb_m_s": 5.0}), ["sources[0].legs[0]", "for_s"]),
        (jet({"for_s": 5.0, "bank_deg": 30.0, "acceleration_m_s2": 1.0}), ["two legs"]),
        (jet({"for_s": 5.0}, {"for_s": 30.0, "acceleration_m_s2": -9.0}), ["legs[1]", "-70 m/s"]),
        (jet({"for_s": 50.0, "climb_m_s": -100.0}), ["legs[0]", "height of", "descend less"]),
        (jet({"for_s": 900.0, "climb_m_s": 300.0}), ["legs[0]", "climb less"]),
        (jet({"for_s": 5.0, "bank_deg": 90.0}), ["legs[0].bank_deg", "85"]),
        (
            {
                "model": "aircraft",
                "at": [{**JET, "speed_m_s": 0.0}],
                "legs": [{"for_s": 9.0, "bank_deg": 9.0}],
            },
            ["legs[0]", "turn needs a speed_m_s"],
        ),
        ({"model": "ships", "at": [{**HERE, "heading": 4.0}]}, ["at[0]", "heading_deg"]),
        ({"model": "ships", "at": [{**HERE, "legs": 4.0}]}, ["at[0]", "legs"]),
        ({"model": "ships"}, ["exactly one of at, csv and field"]),
        ({"model": "storms", "at": [HERE], "bottom_m": 9e3, "top_m": 5e3}, ["bottom_m", "above"]),
        ({"model": "storms", "at": [HERE], "duration_s": 0.1}, ["too short"]),
        ({"model": "storms", "at": [HERE], "area_m2": 4.0}, ["area_m2"]),
        (
            {
                "model": "storms",
                "at": [{**HERE, "end_s": 5000.0}] * 30,
                "flashes_per_minute": 900.0,
            },
            ["sources[0]", "at most 20000", "lower flashes_per_minute"],
        ),
        ({"model": "reentries", "at": [{**HERE, "descent_deg": -4.0}]}, ["descent_deg"]),
        ({"model": "grazers", "at": [{**HERE, "speed_m_s": 4e3}]}, ["speed_m_s"]),
    ],
)
def test_bad_settings_are_refused_with_place_and_way_out(block, words):
    message = refusal(block)
    assert all(word in message for word in words), message


def test_a_kind_must_not_have_the_name_of_a_class_that_is_launched(monkeypatch):
    from opir_photons.movers import courses

    monkeypatch.setattr(
        courses, "ship_sources", lambda *of: courses._straight_on("SRBM", "other", *of)
    )
    launch = {"id": "T1", "type": "SRBM", "launch": HERE, "aim": {"lat_deg": 12.0, "lon_deg": 42.0}}
    launch["launch"] = {**HERE, "time_s": 1.0}
    message = refusal({"model": "ships", "at": [HERE]}, targets=[launch])
    assert "sources[0]: SRBM is a kind of source here and the class of a target" in message


def test_each_kind_is_named_and_no_classifier_is_told():
    blocks = [
        jet({"for_s": 60.0, "climb_m_s": 60.0, "afterburner": True}),
        {"model": "fire_fronts", "at": [{"lat_deg": 0.0, "lon_deg": 30.0}]},
        {"model": "grazers", "at": [{"lat_deg": 15.0, "lon_deg": 50.0}], "start_s": -40.0},
    ]
    moving = scene(*blocks)
    plan = opir.compile_plan(moving)
    assert plan.targets.class_names == ("aircraft", "fire front", "earth grazer")
    assert not plan.targets.is_launch.any()
    assert [row["type"] for row in plan.targets.truth()] == list(plan.targets.class_names)
    summary = opir.simulate(moving).summary
    assert [row["source_type"] for row in summary["sources"]] == list(plan.targets.class_names)
    assert all(row["detections"] > 0 for row in summary["sources"])


@pytest.mark.parametrize("classifier", ["paper", "always"])
def test_classifiers_that_know_the_truth_call_sources_unknown(classifier):
    run = opir.simulate(scene(jet(afterburner=True), classification=classifier))
    assert len(run.detections) > 100
    assert set(run.detections.reported_type.tolist()) == {REPORTED_TYPES.index("UNKNOWN")}


def test_a_constant_probability_of_detection_is_refused_for_them():
    message = refusal(
        {"model": "ships", "at": [HERE]}, detection="constant", classification="paper"
    )
    assert "source type ship" in message
    assert "detection: snr" in message
