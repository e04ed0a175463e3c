"""Files hold what somebody reads: bytes an event, a line of tracks and a region, counted. Budgets
only fall.
"""

import json
from pathlib import Path

import pytest
from repository import EXAMPLES

from opir_core.cli.main import main

#: README's scene while its launches burn.
WORDS = ("--set", "duration_s=90", "--tracker", "imm", "--quiet")
#: The most bytes an event, a line of a track without regions, and the text of its regions.
EVENT_BYTES = 685
TRACK_BYTES = 1_200
REGIONS_BYTES = 9_500


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bytes")
    scene = str(EXAMPLES / "pacific_test_range.yaml")
    assert main(["run", scene, *WORDS, "--out", str(path / "e.jsonl")]) == 0
    return path


def test_an_event_stays_within_its_bytes(folder: Path) -> None:
    lines = (folder / "e.jsonl").read_bytes().splitlines(keepends=True)
    tracked = [line for line in lines if b'"impact_point":{' in line]
    assert len(tracked) > 1_000
    assert sum(map(len, tracked)) / len(tracked) <= EVENT_BYTES


def test_a_track_stays_within_its_bytes(folder: Path) -> None:
    lines = (folder / "e.tracks.jsonl").read_text().splitlines(keepends=True)
    records = [json.loads(line) for line in lines]
    regions = [
        len(json.dumps(row["impact_regions"])) for row in records if row.get("impact_regions")
    ]
    assert len(records) > 50
    assert len(regions) > 10
    assert sum(regions) / len(regions) <= REGIONS_BYTES
    assert (sum(map(len, lines)) - sum(regions)) / len(lines) <= TRACK_BYTES
