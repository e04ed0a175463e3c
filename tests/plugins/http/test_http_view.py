"""`opir view`: a saved run is served as it was, part by part, without a scene running."""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from http_service import SCENE, RunningService
from json_lines import json_lines
from opir_http.replay import Replay
from opir_http.viewing import view_document
from page_browser import viewing

from opir_core import load_run
from opir_core.cli.main import main

START = "2026-04-01T12:00:00Z"
END = "2026-04-01T12:04:00Z"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("saved")
    (place / "scene.yaml").write_text(SCENE, encoding="utf-8")
    words = [
        "--tracker",
        "imm",
        "--set",
        "duration_s=240",
        "--out",
        str(place / "events.jsonl"),
        "--quiet",
    ]
    assert main(["run", str(place / "scene.yaml"), *words]) == 0
    return place


@pytest.fixture(scope="module")
def stand(folder: Path) -> Iterator[RunningService]:
    with viewing(Replay(load_run(folder))) as port:
        yield RunningService(port, None, None)  # type: ignore[arg-type]


def part(stand: RunningService, since: str, until: str, step_s: float = 1.0) -> Any:
    answer = stand.ask("GET", f"/replay?since={since}&until={until}&step_s={step_s}")
    assert answer.status == 200, answer.body
    return answer.json


@pytest.mark.slow
def test_parts_have_every_event_of_the_file_once(stand: RunningService, folder: Path) -> None:
    saved = json_lines(folder / "events.jsonl")
    seconds = [f"2026-04-01T12:{second // 60:02}:{second % 60:02}Z" for second in range(0, 241, 20)]
    events = [
        event
        for since, until in pairwise(seconds)
        for event in part(stand, since, until)["detections"]
    ]
    names = ("detection_id", "timestamp", "sensor_id", "target_type")
    assert [[event[name] for name in names] for event in events] == [
        [event[name] for name in names]
        for event in sorted(saved, key=lambda event: event["timestamp"])
    ]
    assert len(saved) > 100


@pytest.mark.slow
def test_counts_and_estimates_are_those_of_the_files(stand: RunningService, folder: Path) -> None:
    answer = part(stand, START, END, 600.0)
    counted = {name: sum(counts) for name, counts in answer["activity"]["sensors"].items()}
    events = json_lines(folder / "events.jsonl")
    assert counted == {
        name: sum(event["sensor_id"] == name for event in events) for name in counted
    }
    assert sum(counted.values()) == len(events)
    estimates = [line for line in json_lines(folder / "events.tracks.jsonl") if "track_id" in line]
    last_s = {
        line["track_id"]: line["time_s"]
        for line in sorted(estimates, key=lambda line: line["time_s"])
    }
    epoch = datetime(2026, 4, 1, 12, tzinfo=UTC)
    texts = {
        number: f"{epoch + timedelta(seconds=time_s):%Y-%m-%dT%H:%M:%S.%fZ}"
        for number, time_s in last_s.items()
    }
    assert {track["track_id"]: track["timestamp"] for track in answer["tracks"]} == texts
    assert texts


@pytest.mark.slow
def test_answers_conform_to_the_document(stand: RunningService) -> None:
    components = view_document()["components"]
    for value, name in (
        (stand.ask("GET", "/status").json, "Status"),
        (part(stand, START, END, 100.0), "Replay"),
    ):
        jsonschema.validate(
            value, {"$ref": f"#/components/schemas/{name}", "components": components}
        )
    assert stand.ask("GET", "/status").json["replay"] == {
        "since": "2026-04-01T12:00:00.000000Z",
        "until": "2026-04-01T12:04:00.000000Z",
    }
    assert stand.ask("GET", "/openapi.json").json == view_document()


@pytest.mark.slow
@pytest.mark.parametrize(
    "query",
    [
        "",
        f"since={START}",
        f"since={END}&until={START}",
        f"since={START}&until=2027-04-01T12:00:00Z",
        f"since={START}&until={END}&step_s=0",
        f"since={START}&until={END}&speed=2",
    ],
)
def test_requests_that_make_no_sense_are_rejected(stand: RunningService, query: str) -> None:
    assert stand.ask("GET", f"/replay?{query}").status == 400


@pytest.mark.slow
def test_a_saved_run_cannot_be_changed(stand: RunningService) -> None:
    assert stand.ask("POST", "/trigger", {}).status == 404
    assert stand.ask("PUT", "/config", {}).status == 404


def test_a_folder_without_a_run_is_one_message(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(tmp_path), "--port", "0"]) == 2
    written = capsys.readouterr().err
    assert "no folder of one run" in written
    assert "Traceback" not in written
