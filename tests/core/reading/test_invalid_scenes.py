"""A folder of malformed scenes, each beside the message that it must give, to the letter."""

import pytest
import yaml
from fake_components import fake_host
from repository import DATA

from opir_core.errors import SceneError
from opir_core.reading import load_scene, strict_yaml

FOLDER = DATA / "bad_scenes"
SCENES = sorted(path.name for path in FOLDER.glob("*.yaml"))
HOST = fake_host()


def message_of(name: str, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(FOLDER)
    with pytest.raises(SceneError) as caught:
        load_scene(name, host=HOST)
    assert caught.value.exit_code == 2
    return str(caught.value)


def expected(name: str) -> str:
    return (FOLDER / name).with_suffix(".txt").read_text(encoding="utf-8").removesuffix("\n")


def test_there_are_many_and_each_has_its_message() -> None:
    assert len(SCENES) >= 60
    assert sorted(path.name for path in FOLDER.glob("*.txt")) == [
        name.replace(".yaml", ".txt") for name in SCENES
    ]


@pytest.mark.parametrize("name", SCENES)
def test_message(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert message_of(name, monkeypatch) == expected(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_message_without_libyaml(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """PyYAML's own parser gives the same messages; only where YAML itself is broken may it point
    elsewhere.
    """
    monkeypatch.setattr(strict_yaml, "PARSER", yaml.SafeLoader)
    message = message_of(name, monkeypatch)
    if "not YAML" in expected(name):
        assert "not YAML: " in message
    else:
        assert message == expected(name)
