"""Targets of the model gravity-turn in scenes: classes, truth, early shutdown, messages for what
cannot be flown.
"""

import json

import pytest
from geographiclib.geodesic import Geodesic

from opir_core import SceneError, compile_plan, scene_from_mapping

LAUNCH = (34.0, -120.0)


def truth_of(kind, range_m, bearing_deg=270.0, **settings):
    """Return the truth of one target that is aimed at a range."""
    end = Geodesic.WGS84.Direct(*LAUNCH, bearing_deg, range_m)
    target = {
        "id": "T",
        "model": "gravity-turn",
        "type": kind,
        "launch": {"lat_deg": LAUNCH[0], "lon_deg": LAUNCH[1], "time_s": 20.0},
        "aim": {"lat_deg": end["lat2"], "lon_deg": end["lon2"]},
        **settings,
    }
    scene = {
        "scene": "gravity-turn",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 300.0,
        "sensors": [{"constellation": "DSP"}],
        "targets": [target],
    }
    return compile_plan(scene_from_mapping(scene)).targets.truth()[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "range_m", "staging", "stages"),
    [
        ("SRBM", 200e3, "SRBM", 1),
        ("SRBM", 700e3, "SRBM_long", 1),
        ("MRBM", 1500e3, "MRBM", 1),
        ("MRBM", 2700e3, "MRBM_two_stage", 2),
        ("IRBM", 4500e3, "IRBM", 2),
        ("SLBM", 5000e3, "SLBM_two_stage", 2),
        ("SLBM", 9000e3, "SLBM", 3),
        ("ICBM", 9500e3, "ICBM_solid", 3),
    ],
)
def test_every_ballistic_class_has_a_preset_for_its_ranges(kind, range_m, staging, stages):
    truth = truth_of(kind, range_m)
    json.dumps(truth, allow_nan=False)
    assert (truth["staging"], len(truth["stages"]), truth["miss_m"] < 10.0) == (
        staging,
        stages,
        True,
    )
    assert (truth["stages"][0]["ignition_s"], truth["stages"][-1]["burnout_s"]) == (
        20.0,
        truth["burnout_s"],
    )
    assert len(truth["gaps_s"]) == stages - 1


@pytest.mark.parametrize(("kind", "model"), [("SLV", "orbit"), ("HGV", "glide")])
def test_classes_that_do_not_come_down_ballistically_are_refused(kind, model):
    with pytest.raises(
        SceneError, match=f"{kind} has the model {model}, not gravity-turn; omit model"
    ):
        truth_of(kind, 5000e3)


@pytest.mark.slow
def test_lofts_are_higher_and_later_at_the_same_aim():
    flat, usual, steep = (truth_of("IRBM", 4000e3, loft=loft) for loft in (-0.5, 0.0, 0.5))
    assert flat["impact"]["time_s"] < usual["impact"]["time_s"] < steep["impact"]["time_s"]
    assert flat["burnout"]["height_m"] < usual["burnout"]["height_m"] < steep["burnout"]["height_m"]
    assert max(truth["miss_m"] for truth in (flat, usual, steep)) < 10.0


@pytest.mark.slow
def test_a_named_apogee_is_flown_and_named_in_the_truth():
    usual, named, steep = (
        truth_of("ICBM", 9000e3, **settings)
        for settings in ({}, {"apogee_km": 3000.0}, {"loft": 1.0})
    )
    assert usual["impact"]["time_s"] < named["impact"]["time_s"] < steep["impact"]["time_s"]
    assert (named["apogee_km"], "loft" in named, "apogee_km" in usual) == (3000.0, False, False)


@pytest.mark.slow
def test_an_early_shutdown_falls_short():
    full, short = (truth_of("ICBM", 9000e3, early_shutdown_s=time_s) for time_s in (0.0, 3.0))
    assert full["burnout_s"] - short["burnout_s"] == pytest.approx(3.0, abs=1e-9)
    assert full["gaps_s"] == short["gaps_s"]
    impact, aim = (
        (place["lat_deg"], place["lon_deg"]) for place in (short["impact"], short["aim"])
    )
    assert Geodesic.WGS84.Inverse(*LAUNCH, *impact)["s12"] < 8500e3
    assert short["miss_m"] > 500e3
    assert short["miss_m"] == pytest.approx(Geodesic.WGS84.Inverse(*aim, *impact)["s12"], rel=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (
            {"early_shutdown_s": 100.0},
            r"targets\[0\].early_shutdown_s: the last burn cannot be cut off so early",
        ),
        (
            {"staging": "NONE"},
            r"targets\[0\].staging: no staging 'NONE'; there are SRBM, SRBM_long, MRBM",
        ),
        (
            {"staging": "SRBM"},
            r"targets\[0\].aim: the aim point is 9000 km .* fly at most about 3\d\d km",
        ),
        (
            {"apogee_km": 9000.0},
            r"targets\[0\].apogee_km: .* reach it with an apogee of 1\d\d to 69\d\d km",
        ),
        (
            {"apogee_km": 900.0, "loft": 0.5},
            r"targets\[0\].apogee_km: sets the same quantity as loft",
        ),
    ],
)
def test_what_cannot_be_flown_is_reported_with_the_way_out(settings, words):
    with pytest.raises(SceneError, match=words):
        truth_of("ICBM", 9000e3, **settings)
