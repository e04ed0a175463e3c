"""`opir track` on events with heartbeats: silence of a sensor that watched, and of none."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import main
from opir_readers.detections.heartbeats import merged, with_detections
from track_lines import whole_records
from watched_scene import SCENE, TARGET

EPOCH = np.datetime64("2026-04-01T12:00:00", "us")

Track = Callable[..., tuple[str, str]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the events `beats.jsonl` of a run with an outage, and the sensors."""
    where = tmp_path_factory.mktemp("beats")
    outputs = f"outputs: [{{jsonl: {{path: {where / 'run.jsonl'}, heartbeat_s: 2}}}}]\n"
    (where / "run.yaml").write_text(SCENE + TARGET + outputs)
    (where / "sensors.yaml").write_text(SCENE)
    assert main(["run", str(where / "run.yaml"), "-q"]) == 0
    # Without the manifest beside it.
    (where / "beats.jsonl").write_bytes((where / "run.jsonl").read_bytes())
    return where


@pytest.fixture
def track(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Track:
    """Return a function that tracks lines: what is printed, and the complaints."""

    def printed(lines: list[str], code: int = 0) -> tuple[str, str]:
        (folder / "given.jsonl").write_text("".join(lines))
        capsys.readouterr()
        words = ["--sensors", str(folder / "sensors.yaml"), "--out", str(tmp_path / "t.jsonl")]
        assert main(["track", str(folder / "given.jsonl"), *words]) == code
        return capsys.readouterr()

    return printed


@pytest.fixture
def lines(folder: Path) -> list[str]:
    return (folder / "beats.jsonl").read_text().splitlines(keepends=True)


def is_beat(line: str) -> bool:
    return json.loads(line).get("record") == "heartbeat"


def beat(sensor: str, start_s: float, end_s: float) -> str:
    times = [str(EPOCH + np.timedelta64(round(1e6 * s), "us")) + "Z" for s in (start_s, end_s)]
    words = {"record": "heartbeat", "sensor_id": sensor}
    return json.dumps(words | dict(zip(("watched_from", "watched_to"), times, strict=True))) + "\n"


def burning(tmp_path: Path, time_s: float) -> float:
    rows = whole_records(tmp_path / "t.tracks.jsonl")
    (row,) = [row for row in rows if row["time_s"] == time_s]
    return float(row["probability_burning"])


def test_what_heartbeats_leave_out_was_not_watched(
    track: Track, lines: list[str], tmp_path: Path
) -> None:
    out, errors = track(lines)
    assert "WEST watched 0.0–40.0 and 52.0–60.0 s" in out
    assert "(by its heartbeats)" in out
    assert "heartbeats" not in errors
    # The prior of burns alone, of 12 s of a mean of 150.
    assert burning(tmp_path, 52.0) == pytest.approx(np.exp(-12.0 / 150.0), abs=0.03)


def test_silence_of_a_sensor_that_watched_is_darkness(
    track: Track, lines: list[str], tmp_path: Path
) -> None:
    """The last lines are gone, heartbeats are not: the burn is over."""
    track(
        [
            line
            for line in lines
            if is_beat(line) or json.loads(line)["timestamp"] < "2026-04-01T12:00:30"
        ]
    )
    assert burning(tmp_path, 38.0) < 0.01


def test_heartbeats_may_come_first_twice_and_out_of_order(
    track: Track, lines: list[str], tmp_path: Path
) -> None:
    expected, _ = track(lines)
    beats = [line for line in lines if is_beat(line)]
    events = [line for line in lines if not is_beat(line)]
    many = [*beats[::-1], *beats * 9, *events]
    assert track(many)[0] == expected


def test_a_detection_that_heartbeats_contradict_is_told_and_kept(
    track: Track, lines: list[str], tmp_path: Path
) -> None:
    fewer = [line for line in lines if not is_beat(line)]
    beats = [beat("WEST", 0.0, 40.0), beat("EAST", 0.0, 10.0), beat("EAST", 20.0, 60.0)]
    out, errors = track([*fewer, *beats])
    between = [
        json.loads(line)
        for line in fewer
        if "EAST" in line and "12:00:10" <= json.loads(line)["timestamp"][11:19] < "12:00:20"
    ]
    assert f"{len(between)} detections of EAST, the first at 10." in errors
    assert "lie outside of what its heartbeats say it watched: they are kept" in errors
    assert f"given.jsonl: {len(fewer)} detections" in out


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (beat("NORTH", 0.0, 10.0), "a heartbeat of 'NORTH', no sensor of --sensors"),
        (beat("WEST", 10.0, 10.0), "a heartbeat that ends before it begins"),
        ('{"record":"heartbeat","sensor_id":"WEST"}\n', "watched_from of a heartbeat is None"),
    ],
)
def test_a_heartbeat_that_cannot_be_is_refused_with_its_line(
    track: Track, lines: list[str], line: str, words: str
) -> None:
    _, errors = track([line, *lines], code=2)
    assert "line 1: " + words in errors


def test_spans_that_touch_are_joined() -> None:
    spans = [(float(number), number + 1.0) for number in range(10) if number != 6]
    assert merged(spans[::-1] + spans) == ((0.0, 6.0), (7.0, 10.0))


def test_detections_at_the_edges_of_spans_are_within() -> None:
    joined, outside = with_detections(((0.0, 2.0), (4.0, 6.0)), np.array([0.0, 2.0, 3.0, 4.0, 7.0]))
    assert outside.tolist() == [3.0, 7.0]
    assert [round(start_s, 3) for start_s, _ in joined] == [0.0, 3.0, 4.0, 7.0]
