"""An override sets one value, and is checked as if the scene said so."""

from pathlib import Path
from typing import Any

import pytest
from attrs import evolve
from fake_components import good_mapping
from scene_reading import HOST, PAGE, problems, read

from opir_core.reading import load_scene, scene_from_mapping


@pytest.mark.parametrize(
    ("override", "path", "value"),
    [
        ("seed=11", "seed", 11),
        ("scene='a # b'", "name", "a # b"),
        ("scene=a # b: c", "name", "a # b: c"),
        ("sensors[1].scan_period_ms=50", "sensors.1.model.config.scan_period_ms", 50.0),
        (" sensors[1].rows = 5 ", "sensors.1.model.config.rows", 5),
        (
            "sensors[1].detection_probability.IRBM=0.5",
            "sensors.1.model.config.detection_probability.IRBM",
            0.5,
        ),
        ("sensors[1].edges_um=[1, 2.5]", "sensors.1.model.config.edges_um", (1.0, 2.5)),
        ("sensors[1].edges_um=null", "sensors.1.model.config.edges_um", None),
        ("sensors[1].bands[0]=LWIR", "sensors.1.model.config.bands.0", "LWIR"),
        ("targets[1].id=T9", "targets.1.id", "T9"),
        ("tracker=none", "tracker.name", "none"),
        ("tracker.window_s=3", "tracker.config.window_s", 3.0),
        ("outputs[0].jsonl.path=-", "outputs.0.config.path", "-"),
    ],
)
def test_an_override_sets_one_value(override: str, path: str, value: Any) -> None:
    values: Any = read(override)
    for step in path.split("."):
        is_container = isinstance(values, tuple | dict)
        values = (
            values[int(step) if isinstance(values, tuple) else step]
            if is_container
            else getattr(values, step)
        )
    assert values == value
    assert type(values) is type(value)


def test_an_override_sets_nothing_else() -> None:
    scene = read("seed=11")
    assert evolve(scene, seed=7) == read()


def test_an_override_of_every_item_is_one_of_each() -> None:
    assert read("targets[*].launch.time_s=3") == read(
        *(f"targets[{row}].launch.time_s=3" for row in range(2))
    )
    assert read("targets[*].launch.time_s=3") != read("targets[0].launch.time_s=3")
    assert read("sensors[1].bands[*]=LWIR").sensors != read().sensors


def test_an_override_opens_a_name_and_a_default() -> None:
    assert read("tracker.window_s=3", tracker="arc").tracker.config.window_s == 3.0
    without = {key: value for key, value in good_mapping().items() if key != "confidence"}
    scene = scene_from_mapping(
        without, overrides=["confidence.band=1", "confidence.count=0"], host=HOST
    )
    assert (scene.confidence.name, scene.confidence.config.band) == ("weighted", 1.0)


def test_an_override_of_a_constellation_is_for_all_its_members() -> None:
    scene = read("sensors[0].rows=5", sensors=[{"constellation": "FLEET"}])
    assert [sensor.model.config.rows for sensor in scene.sensors] == [5, 5]


def test_the_last_override_counts_and_one_may_mend_the_file(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(PAGE + "seed: 010\n")
    assert load_scene(path, overrides=["seed=1", "seed=2"], host=HOST).seed == 2


@pytest.mark.parametrize(
    ("override", "problem"),
    [
        ("seed", "override 'seed' has no '='; write path=value"),
        ("seed=", "override 'seed=' has no value; write null for none, or '' for empty text"),
        ("=3", "override '=3': '' is not a scene path; write it like sensors[0].id"),
        ("[0]=3", "override '[0]=3': '[0]' is not a scene path; write it like sensors[0].id"),
        ("a..b=3", "override 'a..b=3': 'a..b' is not a scene path; write it like sensors[0].id"),
        ("a[-1]=3", "override 'a[-1]=3': 'a[-1]' is not a scene path; write it like sensors[0].id"),
        ("sensors[2].id=A", "override 'sensors[2].id=A': sensors has 2 items, numbered from 0"),
        ("sensors.id=A", "override 'sensors.id=A': sensors is a list, which has no key id"),
        ("seed[*]=1", "override 'seed[*]=1': seed is a single value, which has no items for [*]"),
        ("a[**]=3", "override 'a[**]=3': 'a[**]' is not a scene path; write it like sensors[0].id"),
        ("seed[0]=1", "override 'seed[0]=1': seed is a single value, which has no item 0"),
        ("seed.x=1", "override 'seed.x=1': seed is a single value, which has no key x"),
        ("scene='a' # b", "override \"scene='a' # b\": text that begins with ' needs quotes"),
        ("scene=&a b", ("scene: anchors (&a) are not read; write the plain value (override 'scene=&a"
                       " b')")),
        ("scene=\"a\" \"", "override 'scene=\"a\" \"': not YAML: the quotes are not closed"),
        ("scene=[a]]", "override 'scene=[a]]': not YAML: something follows after the end"),
        ("scene=[a", "override 'scene=[a': text that begins with [ needs quotes"),
        ("seed=0o7", ("seed: 0o7 is not a decimal number; write one, or '0o7' in quotes for text"
                     " (override 'seed=0o7')")),
        ("seed=1e3", ("seed: 1e3 is not written as a whole number, and one is needed: write 1000"
                     " (override 'seed=1e3')")),
        ("seed='9'", ("seed: '9' is text; a whole number is needed: write 9 without quotes (override"
                     " \"seed='9'\")")),
        ("sed=3", "sed: unknown key; did you mean seed? (override 'sed=3')"),
        ("scene=\udc80", ("scene: '\\udc80' contains U+DC80, which is not text (override"
                         " 'scene=\\udc80')")),
    ],
)  # fmt: skip
def test_an_override_is_refused(override: str, problem: str) -> None:
    assert problems(override) == [problem]


def test_an_override_of_every_item_names_each_that_is_wrong() -> None:
    words = "95.0 is outside [-90, 90] deg (override 'targets[*].launch.lat_deg=95')"
    assert problems("targets[*].launch.lat_deg=95") == [
        f"targets[{row}].launch.lat_deg: {words}" for row in range(2)
    ]


def test_overrides_are_checked_with_the_scene() -> None:
    assert problems("sensors[9].id=A", "seed=-1", light_time=1) == [
        "override 'sensors[9].id=A': sensors has 2 items, numbered from 0",
        "seed: -1 is outside [0, 9223372036854775807] (override 'seed=-1')",
        "light_time: 1 is a number; true or false is needed",
    ]
