"""Good scenes spoilt at random: read with their meaning kept to the last digit, or refused in
words; nothing else.
"""

import tempfile
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
import yaml
from fake_components import fake_host, good_mapping
from hypothesis import given, strategies as st
from mutated_scenes import (
    PYTHON_VALUES,
    RAW_VALUES,
    Block,
    Raw,
    has_doubled_key,
    meaning,
    pairs,
    set_value,
    spoilt,
    value_at,
    yaml_of,
)

from examples import examples
from opir_core import Scene
from opir_core.errors import OpirError
from opir_core.reading import load_scene, scene_from_mapping, scene_mapping, strict_yaml

HOST = fake_host()


def assert_same(written: Any, meant: Any, path: str = "") -> None:
    """Fail where a scene means something other than what was written; what was not written is left
    to defaults.
    """
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
        assert (
            written is None or list(meant.values())[:1] == [written] or list(meant) == [written]
        ), path
    else:
        assert type(written) is type(meant) or isinstance(written, str), path
        assert written == meant, path


def assert_same_block(written: dict[str, Any], meant: Any, path: str) -> None:
    assert isinstance(meant, dict), path
    if "constellation" in written and "members" not in written:
        for member in meant["members"]:
            assert_same(
                Block((key, written[key]) for key in written if key != "constellation"),
                member,
                path,
            )
        return
    for key, value in written.items():
        if key in meant:
            assert_same(value, meant[key], f"{path}.{key}")
        else:
            assert (value if not isinstance(value, Raw) else meaning(value.text)) is None, (
                f"{path}.{key} is lost"
            )


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


@pytest.mark.slow
@examples(300)
@given(tree=spoilt(RAW_VALUES))
def test_a_spoilt_file_is_refused_or_keeps_its_meaning(tree: Any) -> None:
    scene = scene_of_text(yaml_of(tree))
    if scene is not None:
        assert not has_doubled_key(tree)
        assert_same(tree, scene_mapping(scene))


def entry(tree: Any, path: str) -> tuple[list[Any], int]:
    """Return the container and the index of the value at a path of keys and numbers."""
    container = tree
    index = -1
    for step in path.split("."):
        container = container if index < 0 else value_at(container, index)
        index = (
            [key for key, _ in container].index(step) if isinstance(container, Block) else int(step)
        )
    return container, index


PLACES = """
    scene epoch duration_s seed light_time sensors targets detection confidence.band outputs.0 targets.0.id
    targets.0.launch targets.0.launch.time_s targets.0.profile targets.0.burn_time_s sensors.1.model sensors.1.rows
    sensors.1.is_spinning sensors.1.detection_probability.ICBM sensors.1.bands.0 sensors.1.edges_um.0 sensors.1.notes
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "place",
    [
        pytest.param(place, marks=[pytest.mark.slow] * (row % 2))
        for row, place in enumerate(PLACES.split())
    ],
)
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


@examples(300)
@given(tree=spoilt(PYTHON_VALUES, doubles=False))
def test_a_spoilt_mapping_is_refused_or_keeps_its_meaning(tree: Any) -> None:
    scene = scene_or_refusal(lambda: scene_from_mapping(plain(tree), host=HOST))
    if scene is not None:
        assert_same(pairs(plain(tree)), scene_mapping(scene))


@pytest.mark.slow
@examples(200)
@given(data=st.data())
def test_a_spoilt_text_is_refused_or_a_scene(data: st.DataObject) -> None:
    text = yaml.safe_dump(good_mapping(), sort_keys=False)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text)))
        until = at + data.draw(st.integers(0, 4))
        text = (
            text[:at]
            + data.draw(
                st.text(
                    alphabet="0179abeEoOx_.:-+#&*!|>'\"%@`?,{}[]~ \n\t\r\\\0\x85\ufeffé", max_size=4
                )
            )
            + text[until:]
        )
    scene_of_text(text)


@examples(100)
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


@pytest.mark.slow
@examples(200)
@given(
    path=st.sampled_from(
        [
            "seed",
            "duration_s",
            "targets[0].launch.lat_deg",
            "sensors[1].notes",
            "x y",
            "[0]",
            "sensors[9]",
        ]
    )
    | st.text(max_size=12),
    value=st.sampled_from([raw.text for raw in RAW_VALUES]) | st.text(max_size=12),
)
def test_any_override_is_refused_or_keeps_its_meaning(path: str, value: str) -> None:
    scene = scene_or_refusal(
        lambda: scene_from_mapping(good_mapping(), overrides=[f"{path}={value}"], host=HOST)
    )
    if scene is not None and path in ("seed", "duration_s"):
        assert_same(Raw(value.strip()), scene_mapping(scene)[path])
