"""Tracks as clients see them: where a target went up and where it comes down, with ellipses."""

import http.client
import json
import math
import time

import http_service
import jsonschema
import msgspec
import numpy as np
import pytest
from http_service import serving
from opir_http.routes import document
from opir_http.tracks import TRAIL, TrackDocuments
from opir_testing.doubles import stub_estimates, stub_hypotheses, stub_regions

from opir_core.scene import core_hypotheses

HYPOTHESES = tuple(core_hypothese.name for core_hypothese in core_hypotheses())
LAUNCH = (34.73, -120.57)
AIM = (32.0, -124.0)


@pytest.mark.slow
def test_launch_points_and_impact_ellipses_are_in_tracks_and_in_the_stream(tmp_path):
    scene = http_service.SCENE.replace("duration_s: 600", "duration_s: 140").replace(
        "type: ICBM", "type: SRBM"
    )
    scene = scene.replace("{lat_deg: 9.0, lon_deg: 167.7}", "{lat_deg: 32.0, lon_deg: -124.0}")
    scene += "tracker: imm\n"
    with serving(tmp_path, "--speed", "max", scene=scene) as running:
        streamed = streamed_track(running.port)
        reported = running.ask("GET", "/tracks").json
    validate(reported)
    for track in (reported["tracks"][0], streamed):
        launch = track["launch_point"]
        impact = track["impact_point"]
        assert away_km(launch, LAUNCH) < 20.0
        assert 1000.0 * away_km(impact, AIM) < 2.0 * impact["ellipse"]["semi_major_m"]
        for point in (launch, impact):
            ellipse = point["ellipse"]
            assert 0.0 < ellipse["semi_minor_m"] <= ellipse["semi_major_m"] < 5e6
            assert 0.0 < ellipse["containment"] < 1.0
        assert max(track["type_probability"], key=track["type_probability"].get) == "SRBM"
        assert track["burnout"] is None
        assert track["probability_burning"] < 0.1
        areas = [region["area_km2"] for region in track["impact_regions"]]
        assert 0.0 < areas[0] < areas[1] < areas[2]
        assert track["state"]["timestamp"] == track["timestamp"]
        assert np.linalg.norm(track["state"]["position_ecef_m"]) == pytest.approx(6.4e6, rel=0.05)
        assert positive(track["state"]["covariance_ecef"])


def test_radii_that_a_tracker_tells_are_those_of_a_track_s_impact_ellipses():
    reported = stub_estimates(
        1,
        tick_s=60.0,
        state=np.array([6.5e6, 0.0, 0.0, 0.0, 0.0, 0.0]),
        launch=np.array([0.1, 0.2, 3.0]),
        launch_covariance=np.diag([4e6, 1e6, 1.0]),
        impact=np.array([0.4, 0.2, 900.0]),
        impact_covariance=np.diag([4e6, 1e6, 1.0]),
        impact_sigmas=np.array([0.75, 1.5, 2.75]),
        impact_regions=[stub_regions(22.9, 11.5)],
        probability_burning=0.25,
        burnout=np.array([6.5e6, 0.0, 0.0, 0.0, 0.0, 0.0, 45.0]),
        burnout_covariance=np.eye(7),
        state_sigmas=np.array([1.5, 3.0, 4.25]),
    )
    (track,) = json.loads(msgspec.json.encode(TrackDocuments(0).take(reported)))["tracks"]
    axes = [
        track["impact_point"][name]["semi_major_m"]
        for name in ("ellipse_50", "ellipse_90", "ellipse")
    ]
    assert axes == [1500.0, 3000.0, 5500.0]
    assert track["launch_point"]["ellipse_50"]["semi_major_m"] == 2354.82
    assert track["state"]["ellipsoid_sigmas"] == [1.5, 3.0, 4.25]
    assert track["burnout"]["timestamp"] == "1970-01-01T00:00:45.000000Z"
    assert len(track["burnout"]["covariance_ecef"]) == 28
    assert (track["probability_burning"], track["probability_relights"]) == (0.25, None)
    assert [region["containment"] for region in track["impact_regions"]] == [0.5, 0.9, 0.95]
    assert {region["geometry"]["type"] for region in track["impact_regions"]} == {"Polygon"}
    validate({"tracks": [track]})


def test_a_track_says_what_it_may_be_whether_it_comes_down_and_how_it_ended():
    over = stub_regions(
        9.0, 167.7, 60.0, condition="burn over", probability=0.75, effective_samples=500.0
    )
    relights = stub_regions(9.0, 167.7, 400.0, condition="relights", probability=0.125)
    reported = stub_estimates(
        2,
        track=[0, 1],
        hypothesis_probability=[
            stub_hypotheses(ICBM=0.9, SLV=0.05),
            np.full(len(HYPOTHESES), np.nan),
        ],
        impact_regions=[(*over, *relights), over],
        end=[0, 3],
    )
    track, second = json.loads(
        msgspec.json.encode(TrackDocuments(0, hypotheses=HYPOTHESES).take(reported))
    )["tracks"]
    validate({"tracks": [track, second]})
    assert list(track["hypotheses"]) == list(HYPOTHESES)
    assert (track["hypotheses"]["ICBM"], track["hypotheses"]["none of these"]) == (0.9, 0.05)
    sums = [track[f"probability_{name}"] for name in ("launch", "missile", "orbit", "comes_down")]
    assert (sums, track["end"]) == ([0.95, 0.9, 0.05, 0.875], None)
    figures = [
        [impact_region[name] for name in ("condition", "probability", "effective_samples")]
        for impact_region in track["impact_regions"]
    ]
    assert figures == [["burn over", 0.75, 500.0]] * 3 + [["relights", 0.125, None]] * 3
    assert (
        second["hypotheses"],
        second["probability_launch"],
        second["probability_comes_down"],
    ) == (None, None, None)
    assert second["end"] == "lost"


def test_an_impact_of_the_paper_s_law_has_a_sigma_and_regions_across_the_180th_meridian_have_parts():
    reported = stub_estimates(
        1,
        impact=np.radians([9.0, 179.9, 0.0]),
        impact_covariance=np.diag([4e6, 4e6, 1.0]),
        impact_regions=[stub_regions(9.0, 179.9)],
        impact_method=1,
    )
    (track,) = json.loads(msgspec.json.encode(TrackDocuments(0).take(reported)))["tracks"]
    impact = track["impact_point"]
    assert (impact["method"], impact["containment"], impact["sigma_m"]) == ("paper", None, 2000.0)
    assert [impact[name] for name in ("ellipse", "ellipse_50", "ellipse_90")] == [None] * 3
    assert {region["geometry"]["type"] for region in track["impact_regions"]} == {"MultiPolygon"}
    validate({"tracks": [track]})


def test_tracks_that_were_not_updated_for_longest_are_removed():
    documents = TrackDocuments(0, 3)
    for number in (0, 1, 2, 0, 3):
        documents.take(stub_estimates(1, tick_s=1.0, track=np.array([number])))
    assert [track["track_id"] for track in documents.latest(9)] == [3, 0, 2]
    documents.maximum = 1
    documents.take(stub_estimates(1, tick_s=2.0, track=np.array([0])))
    assert [track["track_id"] for track in documents.latest(9)] == [0]


@pytest.mark.slow
def test_earlier_positions_are_those_that_were_reported_and_thinned_where_they_are_old():
    documents = TrackDocuments(0)
    reported = []
    for second in range(1, 301):
        place = np.array([6.5e6, 1e3 * second, 0.0, 0.0, 0.0, 0.0])
        (track,) = documents.take(stub_estimates(1, tick_s=float(second), state=place))["tracks"]
        reported.append(
            [track[name] for name in ("timestamp", "latitude_deg", "longitude_deg", "altitude_m")]
        )
    assert "trail" not in documents.latest(1)[0]
    result = json.loads(msgspec.json.encode(documents.latest(1, trail=True)))
    validate({"tracks": result})
    trail = result[0]["trail"]
    assert len(trail) <= TRAIL
    assert trail[-TRAIL // 4 :] == reported[-TRAIL // 4 :]
    assert [position for position in reported if position in trail] == trail
    assert TrackDocuments(0).latest(1, trail=True) == []


def validate(tracks):
    """Require documents to follow the service's OpenAPI document."""
    jsonschema.validate(
        tracks, {"$ref": "#/components/schemas/Tracks", "components": document()["components"]}
    )


def positive(terms):
    """Return whether the lower triangle, row by row, is that of a positive definite matrix."""
    lower = np.zeros((6, 6))
    lower[np.tril_indices(6)] = terms
    return bool(np.linalg.eigvalsh(lower, UPLO="L").min() > 0.0)


def streamed_track(port):
    """Return the first track of the stream that is two minutes old."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60.0)
    give_up_at = time.monotonic() + 180.0
    try:
        connection.request("GET", "/stream?view=brief")
        lines = connection.getresponse()
        kind = ""
        while time.monotonic() < give_up_at:
            line = lines.readline().decode().strip()
            kind = line[7:] if line.startswith("event: ") else kind
            if kind == "tracks" and line.startswith("data: "):
                track = json.loads(line[6:])["tracks"][0]
                if track["timestamp"] >= "2026-04-01T12:02:00":
                    return track
        raise AssertionError("no track came")
    finally:
        connection.close()


def away_km(point, place):
    """Return the great-circle distance, haversine formula, on a sphere of 6371 km."""
    latitude = math.radians(point["lat_deg"])
    second = math.radians(place[0])
    across = math.radians(point["lon_deg"] - place[1])
    half = (
        math.sin((second - latitude) / 2) ** 2
        + math.cos(latitude) * math.cos(second) * math.sin(across / 2) ** 2
    )
    return 2 * 6371.0 * math.asin(math.sqrt(half))
