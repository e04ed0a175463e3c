"""The canonical form and its hash: what is written down repeats the scene, and says the same of the
same scene.
"""

import json
import random
import re
import tempfile
from pathlib import Path
from typing import Any

import pytest
import yaml
from attrs import evolve
from fake_components import fake_host, good_mapping
from hypothesis import given, strategies as st

from examples import examples
from opir_core import Scene
from opir_core.reading import load_scene, scene_from_mapping, scene_hash, scene_mapping

HOST = fake_host()

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
PARTS = st.floats(0, 1)
SLOTS = st.floats(-180, 180)
TEXTS = st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), max_size=12)
IDS = st.text("ABCabc019._:-", min_size=1, max_size=8)
DATA = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**20), 10**20) | NUMBERS | TEXTS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3),
    max_leaves=6,
)
PLACES = st.fixed_dictionaries(
    {"lat_deg": st.floats(-90, 90), "lon_deg": SLOTS}, optional={"height_m": NUMBERS}
)
FORCES: list[Any] = [
    "kepler",
    ["drag", "j2"],
    ["j4", {"drag": None}, "j3"],
    [{"drag": {"exponential": {"density_kg_m3": 1.2, "scale_height_m": 7200}}}],
]
SCANNERS = st.fixed_dictionaries(
    {"orbital_slot_deg": SLOTS | st.integers(-180, 180)},
    optional={
        "scan_period_ms": st.floats(1e-6, allow_infinity=False),
        "rows": st.integers(1, 64),
        "is_spinning": st.booleans(),
        "detection_probability": st.dictionaries(TEXTS, PARTS, max_size=3),
        "bands": st.lists(TEXTS, max_size=3),
        "edges_um": st.none()
        | st.lists(st.floats(0, allow_infinity=False), min_size=2, max_size=2),
        "notes": DATA,
    },
)


SENSOR_IDS = IDS.filter(lambda text: not text.startswith("FLEET"))
SENSORS = st.lists(
    st.builds(
        lambda model, item_id, settings: {"model": model, "id": item_id, **settings},
        st.sampled_from(["SCANNER", "STARER"]),
        SENSOR_IDS,
        SCANNERS,
    ),
    min_size=1,
    max_size=4,
    unique_by=lambda sensor: sensor["id"],
)
TARGETS = st.lists(
    st.fixed_dictionaries(
        {
            "id": IDS,
            "type": st.just("IRBM"),
            "launch": PLACES,
            "aim": PLACES,
            "burn_time_s": st.none() | st.just(9),
        }
    ),
    max_size=3,
    unique_by=lambda target: target["id"],
)
EPOCHS = st.sampled_from(
    ["1970-01-01T00:00:00Z", "2026-04-01T12:00:00.5Z", "2099-12-31T23:59:59.999999Z"]
)
OUTPUTS = st.lists(
    st.sampled_from(["null", {"null": {}}, {"jsonl": {"path": "-"}}, "jsonl"]),
    max_size=3,
    unique_by=repr,
)


@st.composite
def mappings(draw: st.DrawFn) -> dict[str, Any]:
    """Return any good scene."""
    fleet: dict[str, Any] = {"constellation": "FLEET", **draw(SCANNERS)}
    fleet |= draw(st.sampled_from([{}, {"preset": "slow"}]))
    band = draw(st.sampled_from([0.0, 0.25, 0.5, 1.0]))
    return {
        "scene": draw(TEXTS.filter(str.strip)),
        "epoch": draw(EPOCHS),
        "duration_s": draw(st.floats(1e-3, 1e6) | st.integers(1, 10**6)),
        "seed": draw(st.integers(0, 2**63 - 1)),
        "light_time": draw(st.booleans()),
        "forces": draw(st.sampled_from(FORCES)),
        "sensors": draw(st.permutations([*draw(SENSORS), *draw(st.sampled_from([[], [fleet]]))])),
        "targets": draw(TARGETS),
        "confidence": draw(
            st.sampled_from(["weighted", {"model": "weighted", "band": band, "count": 1 - band}])
        ),
        "tracker": draw(st.sampled_from(["none", "arc", {"model": "arc", "window_s": 3}])),
        "outputs": draw(OUTPUTS),
    }


def from_text(text: str) -> Scene:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        path.write_text(text, encoding="utf-8")
        return load_scene(path, host=HOST)


def shuffled(data: Any, rng: random.Random) -> Any:
    """Return data with the keys of every mapping in another order."""
    if isinstance(data, dict):
        keys = rng.sample(list(data), len(data))
        return {key: shuffled(data[key], rng) for key in keys}
    return [shuffled(item, rng) for item in data] if isinstance(data, list) else data


@pytest.mark.slow
@examples(150)
@given(mapping=mappings())
def test_the_canonical_form_is_the_scene(mapping: dict[str, Any]) -> None:
    scene = scene_from_mapping(mapping, host=HOST)
    written = scene_mapping(scene)
    assert scene_from_mapping(written, host=HOST) == scene
    assert scene_mapping(scene_from_mapping(written, host=HOST)) == written


@pytest.mark.slow
@examples(100)
@given(mapping=mappings(), rng=st.randoms(use_true_random=False))
def test_the_hash_says_the_same_of_the_same_scene(
    mapping: dict[str, Any], rng: random.Random
) -> None:
    """JSON is YAML, so one text is JSON with its keys shuffled and the other the canonical form
    through JSON.
    """
    scene = scene_from_mapping(mapping, host=HOST)
    # JSON's escaped pairs of surrogates are not YAML's, so nothing is escaped.
    text = json.dumps(shuffled(mapping, rng), ensure_ascii=False, indent=rng.choice([None, 1]))
    spelt = from_text(f"# a comment\n{text}\n")
    replayed = scene_from_mapping(json.loads(json.dumps(scene_mapping(scene))), host=HOST)
    assert scene_hash(scene) == scene_hash(spelt) == scene_hash(replayed)


def test_spelling_does_not_change_the_hash() -> None:
    page = yaml.safe_dump(good_mapping())
    respelled = page
    spellings = {
        "900.0": "9e2",
        "200.0": "+200",
        "'2026-04-01T12:00:00Z'": "2026-04-01T12:00:00.000Z",
        "light_time: true": "light_time: on",
        "scene: test range": 'scene: "test\\x20range"',
    }
    for spelling, another in spellings.items():
        assert spelling in respelled
        respelled = respelled.replace(spelling, another)
    assert scene_hash(from_text(respelled)) == scene_hash(from_text(page))


def test_a_preset_a_fleet_and_a_default_count_as_written_out() -> None:
    mapping = {
        **good_mapping(),
        "sensors": [{"constellation": "FLEET", "preset": "slow"}],
        "tracker": "arc",
    }
    scene = scene_from_mapping(mapping, host=HOST)
    written = scene_mapping(scene)
    assert [list(sensor) for sensor in written["sensors"]] == [["constellation", "members"]]
    assert written["sensors"][0]["members"][0]["scan_period_ms"] == 10_000.0
    assert written["tracker"] == {"model": "arc", "window_s": 10.0}
    assert scene_hash(scene_from_mapping(written, host=HOST)) == scene_hash(scene)


def test_every_value_counts() -> None:
    scene = scene_from_mapping(good_mapping(), host=HOST)
    variants = [
        evolve(scene, name="another"),
        evolve(scene, epoch_us=scene.epoch_us + 1),
        evolve(scene, duration_s=900.0000000000001),
        evolve(scene, seed=8),
        evolve(scene, light_time=False),
        evolve(scene, sensors=scene.sensors[::-1]),
        evolve(scene, sensors=scene.sensors[:1]),
        evolve(scene, targets=scene.targets[:1]),
        evolve(scene, outputs=scene.outputs[:1]),
        evolve(scene, tracker=evolve(scene.tracker, name="none")),
        evolve(scene, sensors=(evolve(scene.sensors[0], constellation=None), scene.sensors[1])),
    ]
    hashes = {scene_hash(variant) for variant in (scene, *variants)}
    assert len(hashes) == len(variants) + 1
    assert all(re.fullmatch("[0-9a-f]{64}", hashe) for hashe in hashes)


@pytest.mark.parametrize("zero", ["0", "-0", "0.0", "-0.0", "0e5"])
def test_zero_is_zero(zero: str) -> None:
    scenes = [
        scene_from_mapping(
            good_mapping(), overrides=[f"targets[0].launch.lat_deg={text}"], host=HOST
        )
        for text in (zero, "0")
    ]
    assert scene_hash(scenes[0]) == scene_hash(scenes[1])


def test_the_hash_stays() -> None:
    """A hash in an old manifest names the same scene for ever; this changes only with the scene
    format.
    """
    scene = scene_from_mapping(good_mapping(), host=HOST)
    assert scene_hash(scene) == "3fd9240b3e63e824cee5f964e63d275e9689df4113fb6a642994de920c5c2be2"
