"""`opir track` and when sensors looked: what nobody looked at is no darkness."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import main
from track_lines import whole_records

SCENE = """\
scene: outage
epoch: 2026-04-01T12:00:00Z
duration_s: 100
seed: 53
sensors:
  - {model: SBIRS-GEO, id: WEST, orbital_slot_deg: -135, scan_period_ms: 500}
  - {model: SBIRS-GEO, id: EAST, orbital_slot_deg: -75, scan_period_ms: 500}
targets:
  - {id: T1, type: ICBM, launch: {lat_deg: 34, lon_deg: -120}, aim: {lat_deg: 9, lon_deg: 167}}
tracker: imm
outputs: [{jsonl: {path: OUT}}]
"""
OUTAGE = (60.0, 75.0)
EPOCH = np.datetime64("2026-04-01T12:00:00", "us")

Track = Callable[..., str]
Records = list[dict[str, Any]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the scene, its run `run.jsonl`, and `cut.jsonl`, the same events without
    those of the outage.
    """
    where = tmp_path_factory.mktemp("outage")
    (where / "scene.yaml").write_text(SCENE.replace("OUT", str(where / "run.jsonl")))
    assert main(["run", str(where / "scene.yaml"), "-q"]) == 0
    lines = (where / "run.jsonl").read_text().splitlines(True)
    kept = [line for line in lines if not OUTAGE[0] < seconds(json.loads(line)) < OUTAGE[1]]
    (where / "cut.jsonl").write_text("".join(kept))
    return where


def seconds(event: dict[str, Any]) -> float:
    moment = np.datetime64(event["timestamp"].removesuffix("Z"), "us")
    return float((moment - EPOCH) / np.timedelta64(1, "s"))


@pytest.fixture
def track(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Track:
    """Return a function that tracks a file of the folder: what is printed, with an exit code the
    errors.
    """

    def printed(name: str, *words: str, code: int = 0) -> str:
        capsys.readouterr()
        out = ["--out", str(tmp_path / "tracked.jsonl")]
        scene = str(folder / "scene.yaml")
        assert main(["track", str(folder / name), "--sensors", scene, *out, *words]) == code
        answer = capsys.readouterr()
        return answer.err if code else answer.out

    return printed


def records(events: Path) -> Records:
    return whole_records(events.with_suffix(".tracks.jsonl"))


def burning(tracks: Records, time_s: float) -> float:
    (row,) = [row for row in tracks if row["time_s"] == time_s]
    return float(row["probability_burning"])


def table(folder: Path, *lines: str) -> list[str]:
    (folder / "watched.csv").write_text("\n".join(["sensor_id,start_s,end_s", *lines, ""]))
    return ["--watched", str(folder / "watched.csv")]


def test_events_of_a_run_are_watched_as_its_manifest_says(
    folder: Path, track: Track, tmp_path: Path
) -> None:
    assert (
        "WEST watched 0.0–100.0 s; after that nothing is known (by the manifest beside the events)"
        in track("run.jsonl")
    )
    tracks = records(tmp_path / "tracked.jsonl")
    expected = records(folder / "run.jsonl")
    assert [row["time_s"] for row in tracks] == [row["time_s"] for row in expected]
    manifest = json.loads((tmp_path / "tracked.manifest.json").read_text())
    assert manifest["watched_s"] == {"WEST": [[0.0, 100.0]], "EAST": [[0.0, 100.0]]}


def test_a_gap_of_all_sensors_is_no_end_of_a_burn(track: Track, tmp_path: Path) -> None:
    out = track("cut.jsonl")
    assert "before, between and after that nothing is known (by first and last lines, and" in out
    tracks = records(tmp_path / "tracked.jsonl")
    # The prior of burns alone: 15 s of a mean of 150.
    assert abs(burning(tracks, 75.0) - np.exp(-15.0 / 150.0)) < 0.02
    track("cut.jsonl", "--watched", "throughout")
    assert burning(records(tmp_path / "tracked.jsonl"), 75.0) < 0.01


def test_spans_may_be_seconds_or_dates(folder: Path, track: Track, tmp_path: Path) -> None:
    outage = ("0,60", "75,100")
    spans = [f"{name},{span}" for name in ("WEST", "EAST") for span in outage]
    assert "WEST watched 0.0–60.0 and 75.0–100.0 s" in track("cut.jsonl", *table(folder, *spans))
    by_seconds = records(tmp_path / "tracked.jsonl")
    dates = (
        "2026-04-01T12:00:00Z,2026-04-01T12:01:00Z",
        "2026-04-01T12:01:15Z,2026-04-01T12:01:40Z",
    )
    spans = [f"{name},{span}" for name in ("WEST", "EAST") for span in dates]
    track("cut.jsonl", *table(folder, *spans))
    assert records(tmp_path / "tracked.jsonl") == by_seconds


def test_sensors_that_a_table_leaves_out_watched_as_their_lines_say(
    folder: Path, track: Track
) -> None:
    out = track("cut.jsonl", *table(folder, "WEST,0,100"))
    assert (
        f"WEST watched 0.0–100.0 s; after that nothing is known (by {folder / 'watched.csv'})"
        in out
    )
    (east,) = [line for line in out.splitlines() if line.startswith("EAST watched")]
    assert "before, between and after that" in east
    assert east.endswith("(by first and last lines, and gaps)")


def test_one_of_two_sensors_that_stops_says_nothing(
    folder: Path, track: Track, tmp_path: Path
) -> None:
    """Of two sensors one stops in the burn: the other one's detections go on, and so does the
    burn.
    """
    lines = (folder / "run.jsonl").read_text().splitlines(True)
    kept = [
        line
        for line in lines
        if json.loads(line)["sensor_id"] == "WEST" or seconds(json.loads(line)) < 50.0
    ]
    (folder / "one.jsonl").write_text("".join(kept))
    assert "EAST watched 0.1–49." in track("one.jsonl").replace(
        "EAST watched 0.2", "EAST watched 0.1"
    )
    tracks = records(tmp_path / "tracked.jsonl")
    assert burning(tracks, 60.0) > 0.99


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (["WEST,0,50", "EST,0,50"], "line 3: 'EST' is no sensor of --sensors; did you mean"),
        (
            ["WEST,0,50", "WEST,40,60"],
            "line 3: its start, 40, is before the end of the span of WEST",
        ),
        (
            ["WEST,60,80", "WEST,0,50"],
            "line 3: its start, 0, is before the end of the span of WEST",
        ),
        (["WEST,50,50"], "line 2: its end, 50, is not after its start, 50"),
        (["WEST,now,50"], "line 2: start is 'now', not a finite number"),
        ([], "has no span below the names of its columns"),
    ],
)
def test_tables_that_are_wrong_are_refused_with_their_line(
    folder: Path, track: Track, lines: list[str], words: str
) -> None:
    assert words in track("cut.jsonl", *table(folder, *lines), code=2)


def test_a_table_without_times_is_refused(folder: Path, track: Track) -> None:
    (folder / "bare.csv").write_text("sensor_id,start_s\nWEST,0\n")
    words = track("cut.jsonl", "--watched", str(folder / "bare.csv"), code=2)
    assert "line 1: lacks end_s; a line has sensor_id, start_s and end_s" in words


def test_detections_outside_of_spans_are_told_and_kept(
    folder: Path, track: Track, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = str(folder / "scene.yaml")
    out = ["--out", str(tmp_path / "tracked.jsonl")]
    words = table(folder, "WEST,0,20", "EAST,0,30")
    assert main(["track", str(folder / "run.jsonl"), "--sensors", scene, *out, *words]) == 0
    printed = capsys.readouterr()
    count = sum(
        seconds(json.loads(line)) > 20.0 and json.loads(line)["sensor_id"] == "WEST"
        for line in (folder / "run.jsonl").read_text().splitlines()
    )
    assert f"{count} detections of WEST are outside of the spans that it watched" in printed.err
    lines = (folder / "run.jsonl").read_text().splitlines()
    last_s = max(seconds(json.loads(line)) for line in lines)
    assert f"as of {last_s:.1f} s" in printed.out
    assert burning(records(tmp_path / "tracked.jsonl"), 60.0) > 0.99
