"""Cursor on Target events: what MITRE's public schema (Event.xsd 2.0) asks for, and what they say of tracks."""

import re
from datetime import datetime
from xml.etree import ElementTree

import numpy as np
import pytest
from opir_testing.contracts.outputs import edge_case_windows
from udp_display import sent, tracked

from opir_core.geometry import geodetic_to_ecef

#: Attributes of the elements, all required, and the patterns of their types.
TIME = r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d+Z"
DECIMAL = r"-?\d+(\.\d+)?"
EVENT = {
    "version": "2.0",
    "uid": ".+",
    "type": r"\w+(-\w+)*(;[^;]*)?",
    "how": r"\w(-\w+)*",
    "opex": "s",
    "time": TIME,
    "start": TIME,
    "stale": TIME,
}
POINT = dict.fromkeys(("lat", "lon", "hae", "ce", "le"), DECIMAL)
ELLIPSE = dict.fromkeys(("major", "minor", "angle"), DECIMAL)
TRACK = dict.fromkeys(("course", "speed", "slope"), DECIMAL)

#: Above the equator at longitude 0, where ECEF is up, east and north.
STATE = [6_379_137.0, 0.0, 0.0, 0.0, 300.0, 400.0]
SPREAD = np.diag([100.0, 400.0, 300.0, 1.0, 1.0, 1.0]) ** 2


def events(*windows, **settings):
    """Return the events of windows, parsed and held to the schema."""
    datagrams, _ = sent("cot", windows, **settings)
    parsed = [ElementTree.fromstring(datagram) for datagram in datagrams]
    for event in parsed:
        assert event.tag == "event"
        assert [child.tag for child in event] == ["point", "detail"]
        require(event, EVENT)
        require(event.find("point"), POINT)
        assert abs(float(event.find("point").get("lat"))) <= 90.0
        assert abs(float(event.find("point").get("lon"))) <= 180.0
        for name, attributes in (("track", TRACK), ("shape/ellipse", ELLIPSE)):
            for element in event.findall(f"detail/{name}"):
                require(element, attributes)
    return parsed


def require(element, attributes):
    assert set(element.attrib) == set(attributes)
    for name, pattern in attributes.items():
        assert re.fullmatch(pattern, element.get(name)), (name, element.get(name))


def numbers(element):
    return {name: float(value) for name, value in element.attrib.items()}


def seconds(event, name):
    return datetime.fromisoformat(event.get(name)).timestamp()


def test_events_of_all_windows_follow_the_schema():
    everything = events(*edge_case_windows().values())
    assert {event.get("uid").rpartition(".")[2] for event in everything} == {
        "0",
        "launch",
        "impact",
    }


def test_a_track_is_sent_with_its_position_motion_errors_and_type():
    columns = {"state": STATE, "state_covariance": SPREAD, "type_probability": [0.1, 0.2, 0.7, 0.0]}
    (event,) = events(tracked(1, track=7, tick_s=65.0, **columns), scene_name="a & <b>")
    assert event.get("uid") == "opir.a & <b>.7"
    assert event.get("type") == "a-u-A-W-M"
    assert event.get("how") == "m-s"
    assert event.get("time") == event.get("start") == "2026-04-01T12:01:05.000000Z"
    assert event.get("stale") == "2026-04-01T12:01:35.000000Z"
    errors = {"ce": 400.0, "le": 100.0}
    place = {"lat": 0.0, "lon": 0.0, "hae": 1000.0}
    assert numbers(event.find("point")) == pytest.approx(place | errors, abs=0.06)
    motion = {"course": 36.8699, "speed": 500.0, "slope": 0.0}
    assert numbers(event.find("detail/track")) == pytest.approx(motion, abs=1e-4)
    assert event.find("detail/contact").get("callsign") == "T7 SRBM"
    assert event.find("detail/remarks").text == "simulated; SRBM 0.70"


def test_positions_are_right_to_a_centimetre_and_motion_is_at_the_place():
    random = np.random.default_rng(5)
    latitude, longitude = random.uniform(-1.5, 1.5, 40), random.uniform(-3.14, 3.14, 40)
    height_m = random.uniform(0.0, 1.2e6, 40)
    north = geodetic_to_ecef(latitude + 1e-7, longitude, height_m)
    above = geodetic_to_ecef(latitude, longitude, height_m + 1.0)
    position = geodetic_to_ecef(latitude, longitude, height_m)
    northward = (north - position) / np.linalg.norm(north - position, axis=1)[:, None]
    velocity = 3000.0 * northward + 4000.0 * (above - position)
    state = np.column_stack([position, velocity])
    sent_events = events(tracked(40, track=np.arange(40), tick_s=0.0, state=state))
    for event, expected in zip(sent_events, position, strict=True):
        point = numbers(event.find("point"))
        radians = np.radians([point["lat"], point["lon"]])
        assert np.linalg.norm(geodetic_to_ecef(*radians, point["hae"]) - expected) < 0.01
        motion = numbers(event.find("detail/track"))
        assert min(motion["course"], 360.0 - motion["course"]) == pytest.approx(0.0, abs=0.01)
        assert motion["speed"] == pytest.approx(3000.0, abs=0.01)  # over ground
        assert motion["slope"] == pytest.approx(np.degrees(np.arctan2(4, 3)), abs=0.01)
        assert (point["ce"], point["le"]) == (9_999_999.0, 9_999_999.0)


def test_errors_of_tracks_are_those_of_one_standard_deviation():
    random = np.random.default_rng(6)
    root = random.normal(0.0, 100.0, (6, 6))
    (event,) = events(tracked(1, state=STATE, state_covariance=root @ root.T))
    up, *level = (root @ random.normal(size=(6, 40_000)))[:3]
    point = numbers(event.find("point"))
    widest = np.sqrt(np.linalg.eigvalsh(np.cov(level))[-1])
    assert point["ce"] == pytest.approx(widest, rel=0.02)
    assert point["le"] == pytest.approx(np.std(up), rel=0.02)


def test_launch_and_impact_points_have_their_ellipses():
    columns = {
        "launch": [np.radians(34.0), np.radians(239.5), 12.0],
        "launch_covariance": np.diag([300.0, 400.0, 1.0]) ** 2,
        "impact": [np.radians(9.0), np.radians(167.7), 1500.0],
        "impact_covariance": np.diag([4000.0, 1000.0, 1.0]) ** 2,
        "impact_sigmas": [1.2, 2.5, 3.0],
    }
    launch, impact = events(tracked(1, track=3, tick_s=60.0, **columns))
    assert (launch.get("uid"), impact.get("uid")) == ("opir.stub.3.launch", "opir.stub.3.impact")
    assert launch.get("type") == impact.get("type") == "u-d-c-c"
    place = {"lat": 34.0, "lon": -120.5, "hae": 0.0, "ce": 979.1, "le": 9_999_999.0}
    assert numbers(launch.find("point")) == pytest.approx(place, abs=0.01)
    northward = {"major": 979.1, "minor": 734.3, "angle": 0.0}
    assert numbers(launch.find("detail/shape/ellipse")) == pytest.approx(northward, abs=0.01)
    eastward = {"major": 12_000.0, "minor": 3000.0, "angle": 90.0}
    assert numbers(impact.find("detail/shape/ellipse")) == pytest.approx(eastward, abs=0.01)
    remarks = "simulated; impact at 2026-04-01T12:25:00.000000Z"
    assert impact.find("detail/remarks").text == remarks
    # The paper's law states no area.
    (_, paper) = events(tracked(1, track=3, impact_method=1, **columns))
    assert paper.get("type") == "b-m-p-s-m"
    assert paper.find("detail/shape") is None
    assert numbers(paper.find("point"))["ce"] == 9_999_999.0


def test_a_track_that_has_ended_is_stale_at_once_and_a_late_one_tells_both_times():
    ended, delayed = events(
        tracked(2, track=[1, 2], tick_s=10.0, available_s=[10.0, 14.0], end=[1, 0], state=STATE),
        affiliation="h",
        stale_s=5.0,
    )
    assert ended.get("stale") == ended.get("time")
    assert delayed.get("type") == "a-h-A"
    assert seconds(delayed, "time") - seconds(delayed, "start") == 4.0
    assert seconds(delayed, "stale") - seconds(delayed, "time") == 5.0


def test_a_track_of_which_nothing_is_known_is_withheld():
    datagrams, delivery = sent("cot", [tracked(3), tracked(1, state=STATE)])
    assert len(datagrams) == 1
    assert (delivery.delivered, delivery.withheld) == (1, 3)
