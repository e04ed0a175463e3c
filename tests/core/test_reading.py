"""What good scenes are read as, what overrides do, and whose fault it is where a plugin is at fault."""

import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import fake_components
import numpy as np
import pytest
from attrs import evolve, field, frozen
from fake_components import Ballistic, Launch, Place, Scanner, fake_host, good_mapping

from opir_core.errors import PluginError, SceneError
from opir_core.fields import number
from opir_core.plugin import Constellation, TrackerModel, hookimpl
from opir_core.plugin.host import Host
from opir_core.reading import limits, load_scene, scene_from_mapping, scene_mapping
from opir_core.scene import Scene

HOST = fake_host()

PAGE = """
scene: range                         # a comment
epoch: 2026-04-01T12:00:00Z          # needs no quotes
duration_s: 1e3
sensors:
  - constellation: FLEET
    rows: 3
  - {model: SCANNER, id: S1, orbital_slot_deg: 5, preset: slow, rows: 2}
targets:
  - id: T1
    type: ICBM
    launch: {lat_deg: 34.73, lon_deg: -120.57, time_s: 10}
    aim: {lat_deg: .5, lon_deg: +167.7}
light_time: off
outputs:
  - "null"
  - jsonl:
"""


@pytest.fixture
def page(tmp_path: Path) -> Path:
    path = tmp_path / "scene.yaml"
    path.write_text(PAGE)
    return path


def read(*overrides: str, host: Host = HOST, **changes: Any) -> Scene:
    return scene_from_mapping({**good_mapping(), **changes}, overrides=overrides, host=host)


def problems(*overrides: str, **changes: Any) -> list[str]:
    with pytest.raises(SceneError) as caught:
        read(*overrides, **changes)
    return [str(problem) for problem in caught.value.problems]


def test_a_page_is_read(page: Path) -> None:
    scene = load_scene(page, host=HOST)
    assert (scene.name, scene.epoch_us, scene.duration_s, scene.seed) == ("range", 1_775_044_800_000_000, 1000.0, 0)
    assert scene.light_time is False
    assert [sensor.id for sensor in scene.sensors] == ["FLEET-1", "FLEET-2", "S1"]
    assert [sensor.constellation for sensor in scene.sensors] == ["FLEET", "FLEET", None]
    assert [sensor.model.path for sensor in scene.sensors] == ["sensors[0]", "sensors[0]", "sensors[1]"]
    assert scene.sensors[1].model.config == Scanner(orbital_slot_deg=10.0, rows=3)
    launch = Launch(lat_deg=34.73, lon_deg=-120.57, time_s=10.0)
    aim = Place(lat_deg=0.5, lon_deg=167.7)
    assert scene.targets[0].model.config == Ballistic(type="ICBM", launch=launch, aim=aim)
    assert [choice.name for choice in scene.outputs] == ["null", "jsonl"]
    assert scene.sources == ()


def test_models_not_named_are_the_defaults(page: Path) -> None:
    scene = load_scene(page, host=HOST)
    chosen = (scene.detection, scene.classification, scene.confidence, scene.tracker, scene.targets[0].model)
    assert [choice.name for choice in chosen] == ["constant", "paper", "weighted", "none", "ballistic"]
    assert (scene.atmosphere.name, scene.background.name) == ("clear", "none")
    assert scene.targets[0].signature is None


def test_a_preset_is_under_what_is_written(page: Path) -> None:
    config = load_scene(page, host=HOST).sensors[2].model.config
    slow = {"scan_period_ms": 10_000.0, "bands": ("SWIR", "MWIR"), "detection_probability": {"ICBM": 0.5}}
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
    assert problems(duration_s=np.array(900.0))[0].startswith("duration_s: a value of type numpy.ndarray is not plain")
    assert problems(seed=np.int64(3))[0].startswith("seed: a value of type numpy.int64 is not plain data")


def test_a_mapping_that_holds_itself_is_refused() -> None:
    mapping = good_mapping()
    mapping["sensors"][1]["notes"] = mapping
    with pytest.raises(SceneError, match="more than 20 deep"):
        scene_from_mapping(mapping, host=HOST)


def test_the_source_is_named() -> None:
    with pytest.raises(SceneError, match=r"^manifest of run 3: 1 problem\n  seed: "):
        scene_from_mapping({**good_mapping(), "seed": -1}, host=HOST, source="manifest of run 3")


# Files that are none


@pytest.mark.parametrize(
    ("name", "words"),
    [("missing.yaml", "there is no such file"), (".", "is a directory; a scene is a file"), ("a\0b", "cannot be read")],
)
def test_a_file_that_cannot_be_read(name: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=words) as caught:
        load_scene(os.path.join(tmp_path, name), host=HOST)  # noqa: PTH118 - Path would reject the zero byte itself
    assert len(caught.value.problems) == 1


def test_a_file_that_is_too_large(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_bytes(PAGE.encode() + b"#" * limits.MAXIMUM_FILE_BYTES)
    with pytest.raises(SceneError, match="is larger than 16777216 bytes"):
        load_scene(path, host=HOST)


def test_a_file_of_too_many_values(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("opir_core.reading.strict_yaml.MAXIMUM_VALUES", 1000)
    path = tmp_path / "scene.yaml"
    path.write_text("scene: [" + "1, " * 2000 + "]")
    with pytest.raises(SceneError, match="there are more than 1000 values"):
        load_scene(path, host=HOST)


def test_a_mapping_of_too_many_values(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("opir_core.reading.plain_data.MAXIMUM_VALUES", 1000)
    with pytest.raises(SceneError, match="there are more than 1000 values"):
        scene_from_mapping({"scene": [1] * 2000}, host=HOST)


def test_too_many_targets_and_sensors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("opir_core.reading.targets.MAXIMUM_TARGETS", 1)
    monkeypatch.setattr("opir_core.reading.sensors.MAXIMUM_SENSORS", 1)
    assert problems() == ["sensors: there are more than 1 sensors", "targets: there are 2 targets; at most 1 are read"]


def test_problems_beyond_a_number_are_counted() -> None:
    told = problems(targets=[3] * (limits.MAXIMUM_PROBLEMS + 5))
    assert len(told) == limits.MAXIMUM_PROBLEMS + 1
    assert told[-1] == "and 5 more problems"


# Overrides


@pytest.mark.parametrize(
    ("override", "path", "value"),
    [
        ("seed=11", "seed", 11),
        ("scene='a # b'", "name", "a # b"),
        ("scene=a # b: c", "name", "a # b: c"),
        ("sensors[1].scan_period_ms=50", "sensors.1.model.config.scan_period_ms", 50.0),
        (" sensors[1].rows = 5 ", "sensors.1.model.config.rows", 5),
        ("sensors[1].detection_probability.IRBM=0.5", "sensors.1.model.config.detection_probability.IRBM", 0.5),
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
    found: Any = read(override)
    for step in path.split("."):
        is_container = isinstance(found, tuple | dict)
        found = found[int(step) if isinstance(found, tuple) else step] if is_container else getattr(found, step)
    assert found == value
    assert type(found) is type(value)


def test_an_override_sets_nothing_else() -> None:
    scene = read("seed=11")
    assert evolve(scene, seed=7) == read()


def test_an_override_opens_a_name_and_a_default() -> None:
    assert read("tracker.window_s=3", tracker="arc").tracker.config.window_s == 3.0
    without = {key: value for key, value in good_mapping().items() if key != "confidence"}
    scene = scene_from_mapping(without, overrides=["confidence.band=1", "confidence.count=0"], host=HOST)
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
        ("seed[0]=1", "override 'seed[0]=1': seed is a single value, which has no item 0"),
        ("seed.x=1", "override 'seed.x=1': seed is a single value, which has no key x"),
        ("scene='a' # b", "override \"scene='a' # b\": text that begins with ' needs quotes"),
        ("scene=&a b", "scene: anchors (&a) are not read; write the plain value (override 'scene=&a b')"),
        ("scene=\"a\" \"", "override 'scene=\"a\" \"': not YAML: the quotes are not closed"),
        ("scene=[a]]", "override 'scene=[a]]': not YAML: something follows after the end"),
        ("scene=[a", "override 'scene=[a': text that begins with [ needs quotes"),
        ("seed=0o7", "seed: 0o7 is not a decimal number; write one, or '0o7' in quotes for text (override 'seed=0o7')"),
        ("seed=1e3", "seed: 1e3 is not written as a whole number, and one is needed: write 1000 (override 'seed=1e3')"),
        ("seed='9'", "seed: '9' is text; a whole number is needed: write 9 without quotes (override \"seed='9'\")"),
        ("sed=3", "sed: unknown key; did you mean seed? (override 'sed=3')"),
        ("scene=\udc80", "scene: '\\udc80' contains U+DC80, which is not text (override 'scene=\\udc80')"),
    ],
)  # fmt: skip
def test_an_override_is_refused(override: str, problem: str) -> None:
    assert problems(override) == [problem]


def test_overrides_are_checked_with_the_scene() -> None:
    assert problems("sensors[9].id=A", "seed=-1", light_time=1) == [
        "override 'sensors[9].id=A': sensors has 2 items, numbered from 0",
        "seed: -1 is outside [0, 9223372036854775807] (override 'seed=-1')",
        "light_time: 1 is a number; true or false is needed",
    ]


# Plugins at fault


def plugin_of(**hooks: Any) -> ModuleType:
    module = ModuleType("other")
    for name, function in hooks.items():
        setattr(module, name, hookimpl(function))
    return module


def host_with_tracker(config: type) -> Host:
    tracker = TrackerModel(name="other", summary="another", config=config, build=print)
    return fake_host(plugin_of(opir_trackers=lambda: [tracker]))


def test_all_missing_components_are_told_at_once() -> None:
    with pytest.raises(PluginError) as caught:
        read(sensors=[{"constellation": "FLET"}, {"model": "SCANER", "id": "A"}], tracker="arcs", detection="snr")
    lines = [line for line in str(caught.value).splitlines() if not line.startswith(" ")]
    assert lines == [
        "sensors[0]: no constellation is named 'FLET'",
        "sensors[1]: no sensor model is named 'SCANER'",
        "detection: no detection model is named 'snr'",
        "tracker: no tracker is named 'arcs'",
    ]
    assert caught.value.exit_code == 3


def test_one_missing_component_is_told_once() -> None:
    targets = [{**target, "model": "glider"} for target in good_mapping()["targets"]]
    with pytest.raises(PluginError) as caught:
        read(targets=targets)
    assert str(caught.value).count("glider") == 1


def test_problems_of_the_scene_come_before_missing_components() -> None:
    assert problems(tracker="arcs", seed=-1) == ["seed: -1 is outside [0, 9223372036854775807]"]


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        ({"constellation": "LOST"}, "sensors[0]: no sensor model is named 'NOWHERE'"),
        ({"constellation": "ODD"}, "sensors[0]: constellation 'ODD' of plugin fake_components "),
        ({"constellation": "BENT"}, "does not fit SCANNER: orbital_slot_deg: 400.0 is outside [-180, 180] deg"),
        ({"model": "SCANNER", "id": "A", "orbital_slot_deg": 1, "preset": "broken"}, "fit SCANNER: rows: 0.5 is not"),
    ],
)
def test_what_a_plugin_supplies_is_not_the_fault_of_the_scene(sensor: dict[str, Any], words: str) -> None:
    with pytest.raises(PluginError) as caught:
        read(sensors=[sensor])
    assert words in str(caught.value)


def test_a_scene_may_mend_what_a_constellation_supplies() -> None:
    scene = read(sensors=[{"constellation": "BENT", "orbital_slot_deg": 40}])
    assert [sensor.model.config.orbital_slot_deg for sensor in scene.sensors] == [40.0, 40.0]


def test_a_supplied_array_is_the_fault_of_the_plugin() -> None:
    fleet = Constellation(
        name="ARRAY", summary="an array", model="SCANNER", satellites=[{"id": "A", "orbital_slot_deg": np.zeros(1)}]
    )
    host = fake_host(plugin_of(opir_constellations=lambda: [fleet]))
    with pytest.raises(PluginError, match=r"constellation 'ARRAY' .* orbital_slot_deg: a value of type numpy.ndarray"):
        read(host=host, sensors=[{"constellation": "ARRAY"}])


@frozen
class Unheard:
    when: set[int] = field(factory=set)


@frozen
class Unknown:
    what: "Nowhere" = field(default=None)  # type: ignore[name-defined]  # noqa: F821


@frozen
class Crashing:
    def __attrs_post_init__(self) -> None:
        raise KeyError("window")


@frozen
class Reserved:
    model: str = "x"


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (Unheard, "Unheard.when: scenes cannot hold a value of type set[int]"),
        (Unknown, "the field types of Unknown are not known: name 'Nowhere' is not defined"),
        (Crashing, "its configuration fails: KeyError: 'window'"),
        (Reserved, "its configuration has the field model, a key that scenes keep"),
    ],
)
def test_a_configuration_class_that_cannot_be_read(config: type, words: str) -> None:
    with pytest.raises(PluginError) as caught:
        read(host=host_with_tracker(config), tracker="other")
    assert str(caught.value) == f"tracker: tracker 'other' of plugin other (registered by this program): {words}"


def test_an_encoder_that_is_missing_is_told() -> None:
    with pytest.raises(PluginError, match=r"outputs\[0\]\.encoder: no event encoder is named 'round'"):
        read("outputs[0].jsonl.encoder=round")


def test_an_id_of_a_constellation_may_not_be_another_sensor_too() -> None:
    sensors = [{"model": "STARER", "id": "FLEET-2", "orbital_slot_deg": 1}, {"constellation": "FLEET"}]
    assert problems(sensors=sensors) == ["sensors[1]: FLEET-2 is the id of sensors[0] already"]


# Configuration classes


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
    block = {"rows": [[1, "2"], 3], "table": {"a": {"b": None}}, "places": [{"lat_deg": 91}], "derived": 4}
    with pytest.raises(SceneError) as caught:
        read(host=host_with_tracker(Various), tracker={"model": "other", **block})
    assert [str(problem) for problem in caught.value.problems] == [
        "tracker.derived: unknown key; known here: model, _private, bare, rows, table, places, named, maybe",
        "tracker.rows[0][1]: '2' is text; a whole number is needed: write 2 without quotes",
        "tracker.rows[1]: 3 is a number; a list is needed",
        "tracker.table.a.b: nothing is given; a number is needed",
        "tracker.places[0].lat_deg: 91.0 is outside [-90, 90] deg",
        "tracker.places[0].lon_deg: is missing: longitude, deg, [-180, 180]",
    ]


# Real components, and what reading costs


def test_core_components_are_read() -> None:
    sensors = plugin_of()
    sensors.opir_sensor_models = fake_components.opir_sensor_models  # type: ignore[attr-defined]
    sensors.opir_constellations = fake_components.opir_constellations  # type: ignore[attr-defined]
    host = Host.of(sensors)
    mapping = {**good_mapping(), "confidence": {"model": "weighted", "band": 0.5, "count": 0.25, "geometry": 0.25}}
    scene = scene_from_mapping({**mapping, "outputs": ["memory", {"jsonl": {}}], "tracker": "none"}, host=host)
    assert scene_from_mapping(scene_mapping(scene), host=host) == scene
    with pytest.raises(SceneError, match=r"confidence: the weights band, count and geometry sum to 1\.25, not to 1"):
        scene_from_mapping({**mapping, "outputs": [], "tracker": "none"}, overrides=["confidence.count=0.5"], host=host)


def test_the_installed_plugins_are_used_where_no_host_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPIR_PLUGINS", "")
    with pytest.raises(PluginError, match="no sensor model is named 'STARER'"):
        scene_from_mapping({**good_mapping(), "confidence": "weighted", "tracker": "none", "outputs": ["null"]})


def test_reading_imports_no_numbers() -> None:
    code = "import sys, opir_core.reading; print(*sys.modules)"
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=paths).stdout
    heavy = {"numpy", "scipy", "msgspec", "json", "hashlib", "difflib", "asyncio", "opir_core.builtin.plugin"}
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
    told = problems(
        targets=[{**target, "id": "steppe-7"}, {**target, "id": "T1"}],
        sources=[
            {"id": "steppe", "model": "fires"},
            {"id": "T1", "model": "fires"},
            {"id": "a", "model": "fires"},
            {"id": "a", "model": "fires"},
            {"model": "fires"},
        ],
    )
    assert told == [
        "sources[0].id: the target steppe-7 has an id of this source's emitters",
        "sources[1].id: the target T1 has an id of this source's emitters",
        "sources[3].id: a is the id of sources[2] already",
        "sources[4].id: is missing",
    ]
