"""Configurations of any fleet go out and back: as they are, patched, and with the times of other
programs.
"""

import json
import threading
from pathlib import Path
from typing import Any

import pytest
from attrs import fields
from http_service import RunningService, serving
from opir_http.reading import merged
from opir_http.routes import document

from opir_core.reading.scene_schema import SceneFile

FLEET = """\
scene: fleet
epoch: "2026-04-01T12:00:00Z"
duration_s: 600
seed: 1
sensors:
  - constellation: LEO-WIDE
  - constellation: SBIRS-GEO
  - constellation: NEXTGEN-GEO
  - constellation: DSP
targets: []
detection: constant
"""


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder: Path = tmp_path_factory.mktemp("fleet")
    with serving(folder, scene=FLEET) as running:
        yield running


def test_the_document_names_every_setting_of_a_scene() -> None:
    named = document()["components"]["schemas"]["Config"]["properties"].keys()
    # Launches have requests of their own, and a preset is put in its settings' place.
    others = {"targets", "sources", "preset"}
    settings = {attribute.name for attribute in fields(SceneFile)} - others
    assert settings <= named
    assert named - settings == {"http"}


def tagged(running: RunningService) -> tuple[Any, dict[str, str]]:
    answer = running.ask("GET", "/config")
    return answer.json, {"If-Match": answer.headers["etag"]}


def test_the_configuration_of_a_large_fleet_is_taken_back(fleet: RunningService) -> None:
    config, tag = tagged(fleet)
    body = json.dumps(config, indent=2).encode()
    assert len(json.dumps(config)) > 64 * 1024
    answer = fleet.ask("PUT", "/config", body, {**tag, "Content-Type": "application/json"})
    assert answer.status == 200, answer.body
    assert fleet.ask("GET", "/config").json == config


def test_a_body_beyond_the_configuration_is_refused(fleet: RunningService) -> None:
    config, tag = tagged(fleet)
    padded = json.dumps({**config, "pad": "x" * 4 * len(json.dumps(config))}).encode()
    answer = fleet.ask("PUT", "/config", padded, {**tag, "Content-Type": "application/json"})
    assert answer.status == 413
    launch = json.dumps({"type": "x" * 70_000}).encode()
    answer = fleet.ask("POST", "/trigger", launch, {"Content-Type": "application/json"})
    assert answer.status == 413


@pytest.mark.parametrize("zone", ["+00:00", "-00:00", ".000000+00:00"])
def test_utc_is_taken_however_it_is_written(fleet: RunningService, zone: str) -> None:
    config, tag = tagged(fleet)
    answer = fleet.ask("PUT", "/config", {**config, "epoch": config["epoch"][:-1] + zone}, tag)
    assert answer.status == 200, answer.body
    assert fleet.ask("GET", "/config").json["epoch"] == config["epoch"]


def test_a_patch_changes_what_it_names(fleet: RunningService) -> None:
    config, tag = tagged(fleet)
    patch = {"confidence": {"model": "weighted", "band": 0.2, "count": 0.2, "geometry": 0.6}}
    answer = fleet.ask("PATCH", "/config", patch, tag)
    assert answer.status == 200, answer.body
    patched = {**config, **patch}
    assert fleet.ask("GET", "/config").json == patched
    assert answer.headers["etag"] == fleet.ask("GET", "/config").headers["etag"]
    assert fleet.ask("PATCH", "/config", patch, tag).status == 412
    assert fleet.ask("PATCH", "/config", patch).status == 428
    media = {"Content-Type": "application/merge-patch+json", "If-Match": "*"}
    body = json.dumps({"http": {"maximum_viewers": 77}}).encode()
    assert fleet.ask("PATCH", "/config", body, media).status == 200
    assert fleet.ask("GET", "/config").json["http"]["maximum_viewers"] == 77
    refused = fleet.ask("PATCH", "/config", {"confidence": {"band": 7.0}}, {"If-Match": "*"})
    assert refused.status == 422
    assert "confidence" in refused.json["errors"][0]["path"]


def test_writers_at_once_lose_no_update(fleet: RunningService) -> None:
    """Each raises a number by one, with the tag of what it read, until it is taken."""
    writers = 8
    config, _ = tagged(fleet)
    first = config["http"]["maximum_targets"]
    fleet.ask("PATCH", "/config", {"http": {"writes_per_s": 10_000.0}}, {"If-Match": "*"})

    def raised() -> None:
        while True:
            present, tag = tagged(fleet)
            patch = {"http": {"maximum_targets": present["http"]["maximum_targets"] + 1}}
            if fleet.ask("PATCH", "/config", patch, tag).status == 200:
                return

    threads = [threading.Thread(target=raised) for _ in range(writers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    assert fleet.ask("GET", "/config").json["http"]["maximum_targets"] == first + writers


@pytest.mark.parametrize(
    ("present", "patch", "result"),
    [  # RFC 7396, appendix A, those whose patch is an object
        ({"a": "b"}, {"a": "c"}, {"a": "c"}),
        ({"a": "b"}, {"b": "c"}, {"a": "b", "b": "c"}),
        ({"a": "b"}, {"a": None}, {}),
        ({"a": "b", "b": "c"}, {"a": None}, {"b": "c"}),
        ({"a": ["b"]}, {"a": "c"}, {"a": "c"}),
        ({"a": "c"}, {"a": ["b"]}, {"a": ["b"]}),
        ({"a": {"b": "c"}}, {"a": {"b": "d", "c": None}}, {"a": {"b": "d"}}),
        ({"a": [{"b": "c"}]}, {"a": [1]}, {"a": [1]}),
        ({"e": None}, {"a": 1}, {"e": None, "a": 1}),
        ({}, {"a": {"bb": {"ccc": None}}}, {"a": {"bb": {}}}),
    ],
)
def test_a_merge_patch_follows_its_rules(
    present: dict[str, Any], patch: dict[str, Any], result: dict[str, Any]
) -> None:
    assert merged(present, patch) == result
