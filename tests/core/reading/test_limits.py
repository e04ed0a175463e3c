"""Files that cannot be read, and scenes that are too large, are refused before they cost
anything.
"""

import os
from pathlib import Path

import pytest
from scene_reading import HOST, PAGE, problems

from opir_core.errors import SceneError
from opir_core.reading import load_scene, nodes, scene_from_mapping


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("missing.yaml", "there is no such file"),
        (".", "is a directory; a scene is a file"),
        ("a\0b", "cannot be read"),
    ],
)
def test_a_file_that_cannot_be_read(name: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=words) as caught:
        load_scene(os.path.join(tmp_path, name), host=HOST)  # noqa: PTH118 - Path would reject the zero byte itself
    assert len(caught.value.problems) == 1


def test_a_file_that_is_too_large(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_bytes(PAGE.encode() + b"#" * nodes.MAXIMUM_FILE_BYTES)
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
    monkeypatch.setattr("opir_core.reading.scene_builder.MAXIMUM_SENSORS", 1)
    assert problems() == [
        "sensors: there are more than 1 sensors",
        "targets: there are 2 targets; at most 1 are read",
    ]


def test_problems_beyond_a_number_are_counted() -> None:
    reported = problems(targets=[3] * (nodes.MAXIMUM_PROBLEMS + 5))
    assert len(reported) == nodes.MAXIMUM_PROBLEMS + 1
    assert reported[-1] == "and 5 more problems"
