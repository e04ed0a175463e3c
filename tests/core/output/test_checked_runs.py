"""What is read back is checked against its run: times, nesting, names that a terminal would
obey.
"""

import json
import shutil
from pathlib import Path

import pytest
from repository import EXAMPLES

from opir_core import load_run
from opir_core.cli.main import main
from opir_core.errors import SceneError


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder: Path = tmp_path_factory.mktemp("kept")
    words = ("--set", "duration_s=20", "--out", str(folder / "e.jsonl"), "--quiet")
    assert main(["run", str(EXAMPLES / "first_light.yaml"), *words]) == 0
    return folder


@pytest.fixture
def copied(kept: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(kept, tmp_path / "copied"))


def unlisted(folder: Path) -> Path:
    """Return the events of a copy of a run whose manifest lists no files, as that of a run through
    a spool.
    """
    manifest = next(folder.glob("*.manifest.json"))
    text = json.loads(manifest.read_text(encoding="utf-8"))
    del text["written_files"]
    manifest.write_text(json.dumps(text), encoding="utf-8")
    return next(file for file in folder.glob("*.jsonl") if file.name.count(".") == 1)


@pytest.mark.parametrize("year", ["1900", "2025", "2027", "9999", "0001"])
def test_a_detection_outside_of_its_scene_is_reported(copied: Path, year: str) -> None:
    events = unlisted(copied)
    first_line, other_lines = events.read_text(encoding="utf-8").split("\n", 1)
    key = '"timestamp":"'
    place = first_line.index(key) + len(key)
    events.write_text(
        f"{first_line[:place]}{year}{first_line[place + 4 :]}\n{other_lines}", encoding="utf-8"
    )
    words = "before the scene" if year < "2026" else "after the end of the scene"
    with pytest.raises(SceneError, match=rf"timestamp: detection \S+ at {year}\S+ is {words}"):
        load_run(events)


@pytest.mark.parametrize("ending", [".manifest.json", ".jsonl", ".truth.jsonl"])
def test_a_file_that_is_nested_without_end_is_reported(copied: Path, ending: str) -> None:
    events = unlisted(copied)
    (copied / f"{events.stem}{ending}").write_text("[" * 200_000 + "]" * 200_000, encoding="utf-8")
    with pytest.raises(SceneError, match=r"is not an? |not what opir writes"):
        load_run(events)


def test_what_a_terminal_would_obey_is_escaped(copied: Path) -> None:
    events = unlisted(copied)
    text = events.read_text(encoding="utf-8")
    name = json.loads(text.splitlines()[0])["sensor_id"]
    events.write_text(text.replace(f'"{name}"', r'"\u001b[31mX\u202e\u009b"'), encoding="utf-8")
    with pytest.raises(SceneError) as raised:
        load_run(events)
    assert r"no sensor \x1b[31mX\u202e\x9b: the files are of different runs" in str(raised.value)
