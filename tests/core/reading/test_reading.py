"""What good scenes are read as: values, defaults, presets, configuration classes, real
components.
"""

import os
import subprocess
import sys
from pathlib import Path

import fake_components
import numpy as np
import pytest
from attrs import field, frozen
from fake_components import Ballistic, Launch, Place, Scanner, good_mapping
from scene_reading import HOST, PAGE, host_with_tracker, plugin_of, problems, read

from opir_core.errors import PluginError, SceneError
from opir_core.plugin import Host, number
from opir_core.reading import load_scene, scene_from_mapping, scene_mapping


@pytest.fixture
def page(tmp_path: Path) -> Path:
    path = tmp_path / "scene.yaml"
    path.write_text(PAGE)
    return path


def test_a_page_is_read(page: Path) -> None:
    scene = load_scene(page, host=HOST)
    assert (scene.name, scene.epoch_us, scene.duration_s, scene.seed) == (
        "range",
        1_775_044_800_000_000,
        1000.0,
        0,
    )
    assert scene.light_time is False
    assert [sensor.id for sensor in scene.sensors] == ["FLEET-1", "FLEET-2", "S1"]
    assert [sensor.constellation for sensor in scene.sensors] == ["FLEET", "FLEET", None]
    assert [sensor.model.path for sensor in scene.sensors] == [
        "sensors[0]",
        "sensors[0]",
        "sensors[1]",
    ]
    assert scene.sensors[1].model.config == Scanner(orbital_slot_deg=10.0, rows=3)
    launch = Launch(lat_deg=34.73, lon_deg=-120.57, time_s=10.0)
    aim = Place(lat_deg=0.5, lon_deg=167.7)
    assert scene.targets[0].model.config == Ballistic(type="ICBM", launch=launch, aim=aim)
    assert [choice.name for choice in scene.outputs] == ["null", "jsonl"]
    assert scene.sources == ()


def test_models_not_named_are_the_defaults(page: Path) -> None:
    scene = load_scene(page, host=HOST)
    names = (
        scene.detection,
        scene.classification,
        scene.confidence,
        scene.tracker,
        scene.targets[0].model,
    )
    assert [choice.name for choice in names] == [
        "constant",
        "paper",
        "weighted",
        "none",
        "ballistic",
    ]
    assert (scene.atmosphere.name, scene.background.name) == ("clear", "none")
    assert scene.targets[0].signature is None


def test_a_preset_is_under_what_is_written(page: Path) -> None:
    config = load_scene(page, host=HOST).sensors[2].model.config
    slow = {
        "scan_period_ms": 10_000.0,
        "bands": ("SWIR", "MWIR"),
        "detection_probability": {"ICBM": 0.5},
    }
    assert config == Scanner(orbital_slot_deg=5.0, rows=2, **slow)


def test_a_preset_is_under_what_a_constellation_brings() -> None:
    scene = read(sensors=[{"constellation": "FLEET", "preset": "slow"}])
    assert [sensor.model.config.orbital_slot_deg for sensor in scene.sensors] == [-75.0, 10.0]
    assert [sensor.model.config.scan_period_ms for sensor in scene.sensors] == [10_000.0, 10_000.0]


def test_whole_numbers_become_floats_where_floats_are_meant(page: Path) -> None:
    config = load_scene(page, host=HOST).targets[0].model.config
    assert type(config.launch.time_s) is float
    assert type(load_scene(page, host=HOST).sensors[0].model.config.rows) is int


@pytest.mark.parametrize("word", ["on", "off", "yes", "no", "true", "false", "Off", "YES"])
def test_switch_words_are_truth_values_where_these_are_meant(word: str) -> None:
    assert read(f"light_time={word}").light_time is (word.lower() in ("on", "yes", "true"))


@pytest.mark.parametrize(
    ("written", "epoch_us"),
    [
        ("1970-01-01T00:00:00Z", 0),
        ("1970-01-01T00:00:00.000001Z", 1),
        ("2000-02-29T23:59:59.25Z", 951_868_799_250_000),
        ("2099-12-31T23:59:59.999999Z", 4_102_444_799_999_999),
    ],
)
def test_epochs_are_exact(written: str, epoch_us: int) -> None:
    scene = read(epoch=written)
    assert scene.epoch_us == epoch_us
    assert scene_from_mapping(scene_mapping(scene), host=HOST) == scene


def test_a_scene_without_targets_and_outputs_is_a_scene() -> None:
    scene = read(targets=[], outputs=[])
    assert (scene.targets, scene.outputs) == ((), ())


def test_numpy_floats_are_floats_and_arrays_are_refused() -> None:
    assert type(read(duration_s=np.float64(0.1) * 9000).duration_s) is float
    assert problems(duration_s=np.array(900.0))[0].startswith(
        "duration_s: a value of type numpy.ndarray is not plain"
    )
    assert problems(seed=np.int64(3))[0].startswith(
        "seed: a value of type numpy.int64 is not plain data"
    )


def test_a_mapping_that_holds_itself_is_refused() -> None:
    mapping = good_mapping()
    mapping["sensors"][1]["notes"] = mapping
    with pytest.raises(SceneError, match="more than 20 deep"):
        scene_from_mapping(mapping, host=HOST)


def test_the_source_is_named() -> None:
    with pytest.raises(SceneError, match=r"^manifest of run 3: 1 problem\n  seed: "):
        scene_from_mapping({**good_mapping(), "seed": -1}, host=HOST, source="manifest of run 3")


@frozen(kw_only=True)
class Various:
    _private: int = number(help="private", default=1)
    derived: int = field(init=False, default=3)
    bare: float = 1.5
    rows: tuple[tuple[int, ...], ...] = ()
    table: dict[str, dict[str, float]] = field(factory=dict)
    places: tuple[Place, ...] = ()
    named: dict[str, Place] = field(factory=dict)
    maybe: tuple[float, ...] | None = None


def test_types_nest() -> None:
    block = {
        "_private": 4,
        "bare": 2,
        "rows": [[1, 2], []],
        "table": {"a": {"b": 1}},
        "places": [{"lat_deg": 1, "lon_deg": 2}],
        "named": {"here": {"lat_deg": 3, "lon_deg": 4}},
        "maybe": [1],
    }
    scene = read(host=host_with_tracker(Various), tracker={"model": "other", **block})
    assert scene.tracker.config == Various(
        private=4,
        bare=2.0,
        rows=((1, 2), ()),
        table={"a": {"b": 1.0}},
        places=(Place(lat_deg=1.0, lon_deg=2.0),),
        named={"here": Place(lat_deg=3.0, lon_deg=4.0)},
        maybe=(1.0,),
    )
    assert scene_from_mapping(scene_mapping(scene), host=host_with_tracker(Various)) == scene


def test_complaints_of_nested_types_have_their_path() -> None:
    block = {
        "rows": [[1, "2"], 3],
        "table": {"a": {"b": None}},
        "places": [{"lat_deg": 91}],
        "derived": 4,
    }
    with pytest.raises(SceneError) as caught:
        read(host=host_with_tracker(Various), tracker={"model": "other", **block})
    assert [str(problem) for problem in caught.value.problems] == [
        (
            "tracker.derived: unknown key; known here: model, _private, bare, rows, table, places,"
            " named, maybe"
        ),
        "tracker.rows[0][1]: '2' is text; a whole number is needed: write 2 without quotes",
        "tracker.rows[1]: 3 is a number; a list is needed",
        "tracker.table.a.b: the value is missing; a number is needed",
        "tracker.places[0].lat_deg: 91.0 is outside [-90, 90] deg",
        "tracker.places[0].lon_deg: is missing: longitude, deg, [-180, 180]",
    ]


def test_core_components_are_read() -> None:
    sensors = plugin_of()
    sensors.opir_sensor_models = fake_components.opir_sensor_models  # type: ignore[attr-defined]
    sensors.opir_constellations = fake_components.opir_constellations  # type: ignore[attr-defined]
    host = Host.of(sensors)
    mapping = {
        **good_mapping(),
        "confidence": {"model": "weighted", "band": 0.5, "count": 0.25, "geometry": 0.25},
    }
    scene = scene_from_mapping(
        {**mapping, "outputs": ["memory", {"jsonl": {}}], "tracker": "none"}, host=host
    )
    assert scene_from_mapping(scene_mapping(scene), host=host) == scene
    with pytest.raises(
        SceneError, match=r"confidence: the weights band, count and geometry sum to 1\.25, not to 1"
    ):
        scene_from_mapping(
            {**mapping, "outputs": [], "tracker": "none"},
            overrides=["confidence.count=0.5"],
            host=host,
        )


def test_the_installed_plugins_are_used_where_no_host_is_given(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OPIR_PLUGINS", "")
    with pytest.raises(PluginError, match="no sensor model is named 'STARER'"):
        scene_from_mapping(
            {**good_mapping(), "confidence": "weighted", "tracker": "none", "outputs": ["null"]}
        )


def test_reading_imports_no_numbers() -> None:
    code = "import sys, opir_core.reading; print(*sys.modules)"
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=paths
    ).stdout
    heavy = {
        "numpy",
        "scipy",
        "msgspec",
        "json",
        "hashlib",
        "difflib",
        "asyncio",
        "opir_core.builtin.plugin",
    }
    assert heavy.isdisjoint(loaded.split())


def test_a_target_names_its_signature() -> None:
    target = good_mapping()["targets"][0]
    plain, named, set_ = read(
        targets=[
            {**target, "id": "A"},
            {**target, "id": "B", "signature": "flame"},
            {**target, "id": "C", "signature": {"model": "flame", "peak_w_sr": 2.0}},
        ]
    ).targets
    assert plain.signature is None
    assert named.signature is not None
    assert (named.signature.name, named.signature.path) == ("flame", "targets[1].signature")
    assert set_.signature is not None
    assert set_.signature.config.peak_w_sr == 2.0


def test_a_signature_that_is_not_one_is_refused_with_its_path() -> None:
    target = good_mapping()["targets"][0]
    assert problems(targets=[{**target, "signature": {"model": "flame", "peak_w_sr": -1.0}}]) == [
        "targets[0].signature.peak_w_sr: -1.0 is outside [0, inf) W/sr"
    ]


def test_sources_are_read() -> None:
    scene = read(sources=[{"id": "steppe", "model": "fires", "peak_w_sr": 3.0}])
    (source,) = scene.sources
    assert (source.id, source.model.name, source.model.path) == ("steppe", "fires", "sources[0]")
    assert source.model.config.peak_w_sr == 3.0
    assert source.model in scene.choices
    assert scene_from_mapping(scene_mapping(scene), host=HOST) == scene


def test_sources_need_ids_of_their_own() -> None:
    target = good_mapping()["targets"][0]
    reported = problems(
        targets=[{**target, "id": "steppe-7"}, {**target, "id": "T1"}],
        sources=[
            {"id": "steppe", "model": "fires"},
            {"id": "T1", "model": "fires"},
            {"id": "a", "model": "fires"},
            {"id": "a", "model": "fires"},
            {"model": "fires"},
        ],
    )
    assert reported == [
        "sources[0].id: the target steppe-7 has an id of this source's emitters",
        "sources[1].id: the target T1 has an id of this source's emitters",
        "sources[3].id: a is the id of sources[2] already",
        "sources[4].id: is missing",
    ]
