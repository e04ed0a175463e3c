"""A setting that nothing in its scene reads is named; one that is read is not: by what runs of
changed scenes write.
"""

from typing import Any

import pytest
from setting_scenes import HOST, SCENES, changed_scenes, digest, is_named, scene_of, unread_paths

import opir_core as opir
from opir_core.host.components import CATALOGUE
from opir_core.reading import scene_mapping
from opir_core.scene.fields import READ_BY, field_infos
from opir_core.simulation import plan_warnings

#: Parts of paths of settings that are read, and change nothing in some of these scenes: `notional`
#: is the default, looks are too few to be interpolated, all bands are bright, a hot body reflects
#: next to nothing, no line of sight passes the limb or another cell of cloud, and no target is slow.
WITHOUT_EFFECT = (
    ".focal_plane$",
    "probability_tolerance$",
    "coincidence_sigma$",
    "body_albedo$",
    "structure.limb.",
    "cloud.cover$",
    "confirmation_speed_m_s$",
)

CASES: list[tuple[str, dict[str, Any], str]] = [
    ("constant", {"atmosphere": "lowtran"}, "atmosphere"),
    ("constant", {"background": "earth"}, "background"),
    ("constant", {"sensors": {"threshold_sigma": 6.0}}, "sensors[0].threshold_sigma"),
    ("constant", {"sensors": {"focal_plane": "notional"}}, "sensors[0].focal_plane"),
    (
        "constant",
        {"sensors": {"band_focal_plane": {"SWIR": {"bits": 10}}}},
        "sensors[0].band_focal_plane",
    ),
    (
        "constant",
        {"sensors": {"false_alarm_susceptibility": "low"}},
        "sensors[0].false_alarm_susceptibility",
    ),
    ("constant", {"targets": {"signature": "plume"}}, "targets[0].signature"),
    (
        "constant",
        {"targets": {"ballistic_coefficient_kg_m2": 2000.0}},
        "targets[0].ballistic_coefficient_kg_m2",
    ),
    (
        "coasts alone",
        {"tracker": {"model": "imm", "modes": "coast", "boost_s": 99.0}},
        "tracker.boost_s",
    ),
    (
        "boosts alone",
        {"tracker": {"model": "imm", "modes": "boost", "coast_noise_m_s": 1.0}},
        "tracker.coast_noise_m_s",
    ),
    ("constant", {"tracking_lag_s": 3.0}, "tracking_lag_s"),
    ("constant", {"preset": "heritage"}, "preset"),
    ("light", {"tracking_order": "report"}, "tracking_order"),
    (
        "light",
        {"sensors": {"detection_probability": {"SRBM": 0.5}}},
        "sensors[0].detection_probability",
    ),
    ("light", {"sensors": {"confusion": {"SRBM": {"SRBM": 1.0}}}}, "sensors[0].confusion"),
    (
        "light",
        {"targets": {"signature": {"model": "plume", "body_area_m2": 9.0}}},
        "targets[0].signature.body_area_m2",
    ),
]


def changed(name: str, changes: dict[str, Any]) -> dict[str, Any]:
    scene = scene_of(name)
    for key, value in changes.items():
        scene[key] = [{**scene[key][0], **value}] if key in ("sensors", "targets") else value
    return scene


@pytest.mark.parametrize(("name", "changes", "path"), CASES, ids=str)
def test_what_nothing_reads_is_named_and_nothing_else(
    name: str, changes: dict[str, Any], path: str
) -> None:
    assert unread_paths(scene_of(name)) == set()
    assert unread_paths(changed(name, changes)) == {path}


def test_the_warning_names_place_and_reason(tmp_path: Any) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(
        "scene: s\nepoch: 2026-04-01T12:00:00Z\nduration_s: 5\ndetection: constant\nsensors:\n"
        "  - {constellation: SBIRS-GEO, threshold_sigma: 6.0}\ntargets: []\n"
    )
    (line,) = plan_warnings(opir.compile_plan(opir.load_scene(path)))
    assert line.startswith(
        "sensors[0].threshold_sigma: nothing in this scene reads it: a detection model that reads"
    )
    assert line.endswith("(line 6, column 32)")


def test_items_of_a_list_share_a_warning() -> None:
    scene = scene_of("constant")
    scene["targets"] = [
        {**scene["targets"][0], "id": f"T{n}", "signature": "plume"} for n in range(3)
    ]
    (line,) = plan_warnings(opir.compile_plan(opir.scene_from_mapping(scene)))
    assert line.startswith("targets[0].signature and 2 more like it: ")


def test_a_scene_that_is_written_out_names_nothing() -> None:
    for name in ("constant", "aligned", "sky", "paper"):
        complete = scene_mapping(opir.scene_from_mapping(scene_of(name), host=HOST))
        assert not unread_paths(complete)


def test_subjects_of_components_and_settings_have_words() -> None:
    names_used = set[str]()
    for hook in CATALOGUE:
        for name in HOST.names(hook):
            component = HOST.component(hook, name)
            config_class = getattr(component, "config", None)
            if config_class is not None:
                names_used |= {
                    component.described,
                    *(info.subject for info in field_infos(config_class).values()),
                }
    assert names_used - {""} <= READ_BY.keys()


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_unread_settings_are_named(name: str) -> None:
    """Bytes of all that a run computes are the judge, not what components declare."""
    usual = digest(scene_of(name))
    wrong = []
    for path, scene in changed_scenes(name):
        unread = unread_paths(scene)
        if unread is None:
            continue
        is_unchanged = digest(scene) == usual
        if is_named(path, unread) != is_unchanged and not (
            is_unchanged and any(piece in f"{path}$" for piece in WITHOUT_EFFECT)
        ):
            wrong.append((path, is_unchanged))
    assert not wrong


@pytest.mark.slow
def test_every_setting_with_a_condition_is_named_in_some_scene() -> None:
    named = set[str]()
    complete = set[str]()
    for name in SCENES:
        for path, scene in changed_scenes(name):
            unread = unread_paths(scene)
            if unread is not None:
                complete.add(path)
                named |= {path} if is_named(path, unread) else set()
    assert len(complete) > 60
    assert complete - named == set()
