"""Good scenes spoilt at random: read with their meaning kept to the last digit, or refused in words; nothing else."""

import copy
import json
import tempfile
from collections.abc import Callable
from datetime import UTC, date, datetime
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from attrs import frozen
from fake_components import fake_host, good_mapping
from hypothesis import given, settings
from hypothesis import strategies as st

from opir_core.errors import OpirError
from opir_core.reading import load_scene, scene_from_mapping, scene_mapping, strict_yaml
from opir_core.scene import Scene

HOST = fake_host()


@frozen
class Raw:
    """A scalar as it stands in the file."""

    text: str


class Block(list[tuple[str, Any]]):
    """A block as the pairs of its keys and values, so that keys can be doubled."""


WITHOUT_BLANKS = r"""
    010 007.5 -01 00 0o10 0x1F 0b101 1_000 1_0.5 12:30:00 1:30 190:20:30.15 1e3 1E3 1e2 1.5e-3 1e999 1e-999 1e-320 .nan
    -.inf .INF nan inf yes NO On off y true False TRUE ~ null Null '50' "50" "1e3" 1. .5 -.5 +3 -0 -0.0 0.1 0 1 -1 2 64
    65 64.0 900 9007199254740992 9007199254740993 123456789012345678901234567890 1234567890123456789012345678901 1;5
    10km 0.1000000000000000055511151231257827 2026-04-01 2026-04-01T12:00:00Z text '' "" [] {} [1] {a:1} *a &a ! = <<
    ICBM constant none "\ud800" "\0" @x `x %x |- > - -- ? : # '#' } ]
"""
WITH_BLANKS = """
    &a 3, !!int 3, !!str 3, [1 010], {a: 1}, 900 s, 1 # one, - 1, ? 1, 'a b', a 'b
"""
RAW_VALUES = [
    Raw(text) for text in (*WITHOUT_BLANKS.split(), *map(str.strip, WITH_BLANKS.split(",")), "\u0663", "\u00b2")
]

PYTHON_VALUES: list[Any] = [
    None, True, 0, 1, -1, 7, 10**19, 2**53 + 1, 10**29, 10**400, 0.5, -0.0, 1e300, float("nan"), float("inf"), "", "50",
    "NO", "off", "1e3", "nan", "\x00", "\ud800", "x" * 300, b"50", (), (1, 2), [], {}, {1: 2}, {None: 1}, {"\x00": 1},
    {"": 1}, {1, 2}, np.float64(0.5), np.float64("nan"), np.float32(0.1), np.int64(3), np.bool_(True), np.str_("text"),
    np.zeros(3), np.array(["a"]), Decimal("0.1"), Fraction(1, 3), 1j, object(), date(2026, 4, 1),
    datetime(2026, 4, 1, tzinfo=UTC), print, Ellipsis, {"model": "constant"}, [[[[]]]],
]  # fmt: skip


def pairs(data: Any) -> Any:
    """Return data with its mappings as blocks."""
    if isinstance(data, dict):
        return Block((key, pairs(value)) for key, value in data.items())
    return [pairs(item) for item in data] if isinstance(data, list) else data


def yaml_of(tree: Any) -> str:
    """Return a tree as YAML in one line; text is quoted, raw scalars are not."""
    if isinstance(tree, Raw):
        return tree.text
    if isinstance(tree, Block):
        return "{" + ", ".join(f"{json.dumps(key)}: {yaml_of(value)}" for key, value in tree) + "}"
    if isinstance(tree, list):
        return "[" + ", ".join(map(yaml_of, tree)) + "]"
    return json.dumps(tree)


def containers(tree: Any) -> list[list[Any]]:
    """Return every list and block in a tree, the outermost first."""
    if not isinstance(tree, list):
        return []
    children = [value for _, value in tree] if isinstance(tree, Block) else tree
    return [tree, *(found for child in children for found in containers(child))]


def set_value(container: list[Any], index: int, value: Any) -> None:
    container[index] = (container[index][0], value) if isinstance(container, Block) else value


def value_at(container: list[Any], index: int) -> Any:
    return container[index][1] if isinstance(container, Block) else container[index]


@st.composite
def spoilt(draw: st.DrawFn, values: list[Any], doubles: bool = True) -> Any:
    """Return the good scene with one to three things done to it."""
    tree = pairs(good_mapping())
    for _ in range(draw(st.integers(1, 3))):
        full = [container for container in containers(tree) if container]
        container = draw(st.sampled_from(full))
        index = draw(st.integers(0, len(container) - 1))
        draw(st.sampled_from(DEEDS if doubles else DEEDS[:-1]))(draw, tree, container, index, values)
    return tree


def drop(_draw: st.DrawFn, _tree: Any, container: list[Any], index: int, _values: list[Any]) -> None:
    del container[index]


def replace(draw: st.DrawFn, _tree: Any, container: list[Any], index: int, values: list[Any]) -> None:
    set_value(container, index, draw(st.sampled_from(values)))


def rename(draw: st.DrawFn, _tree: Any, container: list[Any], index: int, _values: list[Any]) -> None:
    if isinstance(container, Block):
        key, value = container[index]
        renamed = draw(
            st.sampled_from([f"{key}x", key[:-1], key.upper(), "", "preset", "members", "model", "a b", "\x7f"])
        )
        if renamed not in (other for other, _ in container):
            container[index] = renamed, value


def swap(draw: st.DrawFn, tree: Any, container: list[Any], index: int, _values: list[Any]) -> None:
    """Put a value of elsewhere here."""
    other = draw(st.sampled_from([found for found in containers(tree) if found]))
    value = value_at(other, draw(st.integers(0, len(other) - 1)))
    set_value(container, index, copy.deepcopy(value))


def wrap(_draw: st.DrawFn, _tree: Any, container: list[Any], index: int, _values: list[Any]) -> None:
    set_value(container, index, [value_at(container, index)])


def requote(_draw: st.DrawFn, _tree: Any, container: list[Any], index: int, _values: list[Any]) -> None:
    """Put a number in quotes."""
    value = value_at(container, index)
    if isinstance(value, int | float):
        set_value(container, index, str(value))


def double(_draw: st.DrawFn, _tree: Any, container: list[Any], index: int, _values: list[Any]) -> None:
    container.insert(index, copy.deepcopy(container[index]))


DEEDS: list[Callable[..., None]] = [drop, replace, replace, rename, swap, wrap, requote, double]


def has_doubled_key(tree: Any) -> bool:
    return any(
        len({key for key, _ in container}) < len(container)
        for container in containers(tree)
        if isinstance(container, Block)
    )


def meaning(raw: str) -> Any:
    """Return what an unquoted scalar means, found without opir: a fraction, text, a truth value or None."""
    words = {"true": True, "false": False, "yes": True, "no": False, "on": True, "off": False, "null": None, "~": None}
    if raw.lower() in words:
        return words[raw.lower()]
    if raw[0] in "'\"":
        return raw[1:-1]
    if raw[0] in "[{":
        return pairs(yaml.safe_load(raw))
    try:
        return Fraction(Decimal(raw)) if raw.isascii() else raw
    except (ArithmeticError, ValueError):
        return raw


def assert_same(written: Any, meant: Any, path: str = "") -> None:
    """Fail where a scene means something other than what was written; what was not written is left to defaults."""
    if isinstance(written, Raw):
        written = meaning(written.text)
    if isinstance(written, Block):
        assert_same_block(dict(written), meant, path)
    elif isinstance(written, list | tuple):
        assert len(written) == len(meant), path
        for index, (item, read) in enumerate(zip(written, meant, strict=True)):
            assert_same(item, read, f"{path}[{index}]")
    elif isinstance(written, Fraction | int | float) and not isinstance(written, bool):
        assert type(meant) in (int, float), path
        assert meant == (int(written) if isinstance(meant, int) else float(written)), path
        assert not isinstance(meant, int) or Fraction(written).denominator == 1, path
    elif isinstance(meant, dict):  # a component's name or a sink's without settings
        assert written is None or list(meant.values())[:1] == [written] or list(meant) == [written], path
    else:
        assert type(written) is type(meant) or isinstance(written, str), path
        assert written == meant, path


def assert_same_block(written: dict[str, Any], meant: Any, path: str) -> None:
    assert isinstance(meant, dict), path
    if "constellation" in written and "members" not in written:
        for member in meant["members"]:
            assert_same(Block((key, written[key]) for key in written if key != "constellation"), member, path)
        return
    for key, value in written.items():
        if key in meant:
            assert_same(value, meant[key], f"{path}.{key}")
        else:
            assert (value if not isinstance(value, Raw) else meaning(value.text)) is None, f"{path}.{key} is lost"


def scene_or_refusal(read: Callable[[], Scene]) -> Scene | None:
    try:
        return read()
    except OpirError as error:
        str(error).encode("utf-8")
        return None


def scene_of_text(text: str) -> Scene | None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        path.write_text(text, encoding="utf-8", errors="surrogatepass")
        return scene_or_refusal(lambda: load_scene(path, host=HOST))


def test_the_good_scene_is_good() -> None:
    tree = pairs(good_mapping())
    scene = scene_of_text(yaml_of(tree))
    assert scene is not None
    assert_same(tree, scene_mapping(scene))


@settings(max_examples=300, deadline=None)
@given(tree=spoilt(RAW_VALUES))
def test_a_spoilt_file_is_refused_or_keeps_its_meaning(tree: Any) -> None:
    scene = scene_of_text(yaml_of(tree))
    if scene is not None:
        assert not has_doubled_key(tree)
        assert_same(tree, scene_mapping(scene))


def entry(tree: Any, path: str) -> tuple[list[Any], int]:
    """Return the container and the index of the value at a path of keys and numbers."""
    container, index = tree, -1
    for step in path.split("."):
        container = container if index < 0 else value_at(container, index)
        index = [key for key, _ in container].index(step) if isinstance(container, Block) else int(step)
    return container, index


PLACES = """
    scene epoch duration_s seed light_time sensors targets detection confidence.band outputs.0 targets.0.id
    targets.0.launch targets.0.launch.time_s targets.0.profile targets.0.burn_time_s sensors.1.model sensors.1.rows
    sensors.1.is_spinning sensors.1.detection_probability.ICBM sensors.1.bands.0 sensors.1.edges_um.0 sensors.1.notes
"""


@pytest.mark.parametrize("place", PLACES.split())
def test_odd_scalars_are_refused_or_keep_their_meaning(place: str) -> None:
    for raw in RAW_VALUES:
        tree = pairs(good_mapping())
        set_value(*entry(tree, place), raw)
        scene = scene_of_text(yaml_of(tree))
        if scene is not None:
            assert_same(tree, scene_mapping(scene))


def plain(tree: Any) -> Any:
    if isinstance(tree, Block):
        return {key: plain(value) for key, value in tree}
    return [plain(item) for item in tree] if isinstance(tree, list) else tree


@settings(max_examples=300, deadline=None)
@given(tree=spoilt(PYTHON_VALUES, doubles=False))
def test_a_spoilt_mapping_is_refused_or_keeps_its_meaning(tree: Any) -> None:
    scene = scene_or_refusal(lambda: scene_from_mapping(plain(tree), host=HOST))
    if scene is not None:
        assert_same(pairs(plain(tree)), scene_mapping(scene))


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_a_spoilt_text_is_refused_or_a_scene(data: st.DataObject) -> None:
    text = yaml.safe_dump(good_mapping(), sort_keys=False)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text)))
        until = at + data.draw(st.integers(0, 4))
        text = (
            text[:at]
            + data.draw(st.text(alphabet="0179abeEoOx_.:-+#&*!|>'\"%@`?,{}[]~ \n\t\r\\\0\x85\ufeffé", max_size=4))
            + text[until:]
        )
    scene_of_text(text)


@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_both_parsers_read_the_same(data: st.DataObject) -> None:
    """Files that libyaml and PyYAML's own parser both read mean the same."""
    tree = data.draw(spoilt(RAW_VALUES))
    text = yaml_of(tree)
    fast = scene_of_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(strict_yaml, "PARSER", yaml.SafeLoader)
        slow = scene_of_text(text)
    assert fast is None or slow is None or fast == slow


@settings(max_examples=200, deadline=None)
@given(
    path=st.sampled_from(
        ["seed", "duration_s", "targets[0].launch.lat_deg", "sensors[1].notes", "x y", "[0]", "sensors[9]"]
    )
    | st.text(max_size=12),
    value=st.sampled_from([raw.text for raw in RAW_VALUES]) | st.text(max_size=12),
)
def test_any_override_is_refused_or_keeps_its_meaning(path: str, value: str) -> None:
    scene = scene_or_refusal(lambda: scene_from_mapping(good_mapping(), overrides=[f"{path}={value}"], host=HOST))
    if scene is not None and path in ("seed", "duration_s"):
        assert_same(Raw(value.strip()), scene_mapping(scene)[path])
