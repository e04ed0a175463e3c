"""Sources that move in scenes: what is refused and where, their kinds in truth and reports, and
classifiers that do not know them.
"""

import numpy as np
import pytest
from opir_photons.radiometry import solar_irradiance

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
        ({"model": "reentries", "at": [{**HERE, "descent_deg": -94.0}]}, ["descent_deg"]),
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


def test_each_kind_is_named_and_no_classifier_knows_it():
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


def test_the_busy_sky_has_every_kind_and_says_so():
    sky = opir.load_scene("examples/busy_sky.yaml", overrides=["duration_s=20", "tracker=none"])
    rows = opir.simulate(sky).summary["sources"]
    seen = {row["source_type"] for row in rows if row["detections"] > 0}
    assert seen >= {"aircraft", "re-entry", "earth grazer", "lightning", "fire", "fire front"}
    assert {row["source_type"] for row in rows} - seen <= {"bolide"}


def test_emitters_of_a_block_do_not_depend_on_its_others():
    one = opir.compile_plan(scene({"model": "storms", "at": [HERE], "flashes_per_minute": 60.0}))
    places = [HERE, {"lat_deg": -10.0, "lon_deg": 30.0}]
    two = opir.compile_plan(scene({"model": "storms", "at": places, "flashes_per_minute": 60.0}))
    flashes = one.targets.truth()
    assert len(flashes) < len(two.targets.truth())
    assert list(two.targets.truth()[: len(flashes)]) == list(flashes)


def test_a_block_without_emitters_is_no_error():
    nowhere = {
        "region": {"south_deg": 0.0, "north_deg": 1.0, "west_deg": 0.0, "east_deg": 1.0},
        "per_million_km2": 0.0,
    }
    models = ("ships", "aircraft", "balloons", "reentries", "grazers", "storms")
    empty = scene(*({"model": model, "field": nowhere} for model in models))
    assert opir.simulate(empty).summary["sources"] == []


def test_balloons_shine_in_the_sun_and_not_in_the_shadow_of_the_earth():
    block = {"model": "balloons", "at": [{"lat_deg": 0.0, "lon_deg": 40.0}]}
    lights = []
    for hour in (9, 21):
        lit = scene(block, epoch=f"2026-03-20T{hour:02d}:20:00Z")
        source = opir.compile_plan(lit).sources[0]
        row = np.zeros(1, np.int32)
        place = source.trajectories.position_ecef_m(row, np.ones(1))
        up = place / np.linalg.norm(place)
        aspect = source.signatures.aspect_rad(row, np.ones(1), up)
        columns = (np.ones(1), np.full(1, 30e3), aspect)
        lights.append(float(source.signatures.intensity_w_sr(0, row, *columns)[0]))
    # Full phase at noon: 2/3 of the albedo over pi times the irradiance and the cross-section.
    band = opir.compile_plan(lit).sensors[0].bands[0]
    sunlight = float(solar_irradiance(band.lower_um, band.upper_um))
    assert lights[0] - lights[1] == pytest.approx(2 / (3 * np.pi) * sunlight * 900.0, rel=0.03)
    assert lights[1] < 1e-3 * lights[0]
