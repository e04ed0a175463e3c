"""An operator points sensors over HTTP."""

import math
import time
from datetime import datetime, timedelta

import pytest
from http_service import conforms, serving
from operated_scene import OPERATED_SCENE

TASK = "/sensors/SPOT/task"
PLACE = {"place_deg": [34.73, -120.57]}


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    pytest.importorskip("opir_trackers")
    with serving(
        tmp_path_factory.mktemp("operated"), "--speed", "4", scene=OPERATED_SCENE
    ) as running:
        yield running


def spot_detections(service):
    return service.ask("GET", "/detections?sensor_id=SPOT&limit=1").json["detections"]


def until(is_met, what):
    give_up_s = time.monotonic() + 60.0
    while not is_met():
        assert time.monotonic() < give_up_s, what
        time.sleep(0.1)


def test_a_sensor_looks_where_the_operator_points_it(service):
    assert not spot_detections(service)
    answer = service.ask("PUT", TASK, PLACE)
    assert answer.status == 200
    conforms(answer.json, "Tasked")
    assert answer.json["sensor_id"] == "SPOT"
    assert answer.json["track_id"] is None
    assert answer.json["time_s"] < answer.json["start_s"] < answer.json["from_s"]
    until(lambda: spot_detections(service), "SPOT detects nothing")
    (detection,) = spot_detections(service)
    epoch = "2026-04-01T12:00:"
    assert detection["timestamp"] > f"{epoch}{answer.json['from_s'] - 1.0:09.6f}Z"


def test_a_sensor_follows_a_track_and_is_left_to_the_director_again(service):
    until(lambda: service.ask("GET", "/tracks").json["tracks"], "there is no track")
    # The director's decision after it has the track.
    until(
        lambda: service.ask("PUT", TASK, {"track_id": 0}).status == 200, "the track is never taken"
    )
    answer = service.ask("PUT", TASK, {"track_id": 0})
    assert answer.json["track_id"] == 0
    ended = service.ask("DELETE", TASK)
    assert ended.status == 200
    conforms(ended.json, "Tasked")
    assert ended.json["from_s"] is None


def test_an_operator_changes_the_mode_of_a_sensor(service):
    answer = service.ask("PUT", TASK, {"mode": "stare"})
    assert answer.status == 200
    conforms(answer.json, "Tasked")
    assert answer.json["from_s"] == pytest.approx(answer.json["start_s"] + 4.0)


def pointing_of(service):
    status = service.ask("GET", "/status").json
    conforms(status, "Status")
    pointing = {sensor["sensor_id"]: sensor["pointing"] for sensor in status["sensors"]}
    assert pointing["WEST"] is pointing["EAST"] is None
    return pointing["SPOT"]


def test_the_status_says_where_a_field_looks_and_who_points_it(service):
    answer = service.ask("PUT", TASK, {"place_deg": [0.0, -100.0], "mode": "stare"}).json
    at = datetime.fromisoformat("2026-04-01T12:00:00Z") + timedelta(seconds=answer["from_s"])

    def is_taken():
        looks_from = datetime.fromisoformat(pointing_of(service)["looks_from"])
        return abs((looks_from - at).total_seconds()) < 1e-5

    until(is_taken, "the command is never taken")
    pointing = pointing_of(service)
    assert pointing["mode"] == "stare"
    assert pointing["half_angle_deg"] == 1.0
    assert pointing["modes"] == ["stare"]
    longitude = math.radians(-100.0)
    place_m = [6378137.0 * math.cos(longitude), 6378137.0 * math.sin(longitude), 0.0]
    assert pointing["position_ecef_m"] == pytest.approx(place_m, abs=0.1)
    assert pointing["is_tasked"]
    assert pointing["reason"] == "operator"
    assert pointing["track_id"] is None
    refused = service.ask("PUT", TASK, {"place_deg": [0.0, 80.0]})
    assert refused.status == 409
    assert pointing_of(service)["refusal"] == refused.json["detail"]
    assert pointing_of(service)["position_ecef_m"] == pytest.approx(place_m, abs=0.1)
    service.ask("DELETE", TASK)
    pointing = pointing_of(service)
    assert not pointing["is_tasked"]
    assert not pointing["refusal"]


@pytest.mark.parametrize(
    ("path", "body", "status", "words"),
    [
        ("/sensors/NONE/task", PLACE, 404, "no sensor 'NONE'"),
        ("/sensors/WEST/task", PLACE, 409, "no sensor with a narrow field"),
        (TASK, {"place_deg": [10.0, 80.0]}, 409, "out of its field of regard"),
        (TASK, {"track_id": 999}, 409, "no estimate"),
        (TASK, {"place_deg": [100.0, 80.0]}, 422, "place_deg"),
        (TASK, {"place_deg": [10.0]}, 422, "place_deg"),
        (TASK, {}, 422, "one of both"),
        (TASK, {**PLACE, "track_id": 0}, 422, "one of both"),
        (TASK, {**PLACE, "mode": "star"}, 409, "SPOT has no mode 'star'; the nearest: stare"),
        (TASK, {"mode": 3}, 422, "mode"),
    ],
)
def test_what_a_sensor_cannot_do_is_refused(service, path, body, status, words):
    answer = service.ask("PUT", path, body)
    assert answer.status == status
    conforms(answer.json, "Problem")
    assert words in answer.json["detail"]


def test_the_configuration_has_the_director_and_cannot_change_it(service):
    config = service.ask("GET", "/config")
    conforms(config.json, "Config")
    assert config.json["director"] == {"model": "operator"}
    changed = {**config.json, "director": {"model": "cue"}}
    answer = service.ask("PUT", "/config", changed, {"If-Match": config.headers["etag"]})
    assert answer.status == 409
    assert [error["path"] for error in answer.json["errors"]] == ["director"]


def test_a_body_is_json(service):
    answer = service.ask("PUT", TASK, b"place", headers={"Content-Type": "text/plain"})
    assert answer.status == 415


def test_a_scene_without_a_director_takes_no_task(tmp_path):
    with serving(tmp_path, scene=OPERATED_SCENE.replace("director: operator", "")) as running:
        answer = running.ask("PUT", TASK, PLACE)
    assert answer.status == 409
    assert "director: operator" in answer.json["detail"]
