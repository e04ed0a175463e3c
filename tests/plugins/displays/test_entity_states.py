"""Entity State PDUs, decoded by the field table of IEEE 1278.1-2012, section 7.2.2."""

import struct

import numpy as np
import pytest
from udp_display import sent, tracked

from opir_core.geometry import geodetic_to_ecef

#: Offset, format and name of each field, in the order of the standard's table; big endian.
FIELDS = (
    (0, "B", "protocol_version"),
    (1, "B", "exercise"),
    (2, "B", "pdu_type"),
    (3, "B", "protocol_family"),
    (4, "I", "timestamp"),
    (8, "H", "length"),
    (10, "B", "status"),
    (11, "B", "padding"),
    (12, "3H", "entity"),
    (18, "B", "force"),
    (19, "B", "variable_parameters"),
    (20, "2BH4B", "entity_type"),
    (28, "2BH4B", "alternative_type"),
    (36, "3f", "velocity"),
    (48, "3d", "location"),
    (72, "3f", "orientation"),
    (84, "I", "appearance"),
    (88, "B", "algorithm"),
    (89, "15s", "parameters"),
    (104, "3f", "acceleration"),
    (116, "3f", "angular_velocity"),
    (128, "B", "character_set"),
    (129, "11s", "marking"),
    (140, "I", "capabilities"),
)
#: Along the surface at constant velocity.
STATE = np.array([6.5e6, 0.0, 0.0, 0.0, 3000.0, 4000.0])
PAST_NOON = 2**31 / 3600.0


def decoded(pdu):
    assert len(pdu) == 144
    fields = {
        name: struct.unpack_from(f">{format_}", pdu, offset) for offset, format_, name in FIELDS
    }
    return {name: values[0] if len(values) == 1 else values for name, values in fields.items()}


def pdus(*windows, **settings):
    """Return the decoded PDUs of windows, each with its time, s past the hour of the epoch."""
    datagrams, _ = sent("dis", windows, **settings)
    rows = [decoded(datagram) for datagram in datagrams]
    return [row | {"time_s": (row["timestamp"] >> 1) / PAST_NOON} for row in rows]


def times(*windows, **settings):
    return [round(row["time_s"], 3) for row in pdus(*windows, **settings)]


def straight(ticks_s, **columns):
    """Return a window of a track on a straight line."""
    ticks_s = np.asarray(ticks_s, dtype=float)
    state = np.tile(STATE, (len(ticks_s), 1))
    state[:, :3] += ticks_s[:, None] * STATE[3:]
    return tracked(len(ticks_s), tick_s=ticks_s, state=state, **columns)


def axes(angles):
    """Return the body's axes (3, 3), forward, right and below, from Euler angles about z, y, x."""
    (cz, cy, cx), (sz, sy, sx) = np.cos(angles), np.sin(angles)
    about_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
    about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    return (about_z @ about_y @ about_x).T


def test_fields_that_do_not_change_have_the_standards_values():
    names = {"exercise": 9, "site": 3, "application": 4, "force": 2}
    shares = [0.0, 0.9, 0.1, 0.0]
    (row,) = pdus(
        tracked(1, track=6, tick_s=900.0, end_s=901.0, state=STATE, type_probability=shares),
        **names,
    )
    assert row["protocol_version"] == 7
    assert (row["pdu_type"], row["protocol_family"], row["length"]) == (1, 1, 144)
    assert (row["exercise"], row["entity"], row["force"]) == (9, (3, 4, 7), 2)
    assert row["entity_type"] == (2, 10, 0, 1, 0, 0, 0)
    assert row["timestamp"] == 2**30
    assert (row["character_set"], row["marking"]) == (1, b"T6 IRBM".ljust(11, b"\0"))
    assert row["algorithm"] == 2
    zero_names = ("status", "padding", "variable_parameters", "appearance", "capabilities")
    assert not any(row[name] for name in zero_names)
    assert not any(
        (
            *row["parameters"],
            *row["alternative_type"],
            *row["acceleration"],
            *row["angular_velocity"],
        )
    )


def test_positions_velocities_and_orientations_are_right_everywhere():
    random = np.random.default_rng(3)
    latitude, longitude = random.uniform(-1.5, 1.5, 50), random.uniform(-3.1, 3.1, 50)
    position = geodetic_to_ecef(latitude, longitude, random.uniform(0.0, 1.2e6, 50))
    below = geodetic_to_ecef(latitude, longitude, -1.0) - geodetic_to_ecef(latitude, longitude, 0.0)
    velocity = random.normal(0.0, 3000.0, (50, 3))
    state = np.column_stack([position, velocity])
    rows = pdus(tracked(50, track=np.arange(50), tick_s=0.0, end_s=1.0, state=state))
    for row, (where, speed, down) in zip(
        rows, zip(position, velocity, below, strict=True), strict=True
    ):
        assert np.linalg.norm(np.subtract(row["location"], where)) <= 0.01
        assert row["velocity"] == pytest.approx(speed, rel=1e-6)
        forward, right, under = axes(row["orientation"])
        assert forward == pytest.approx(speed / np.linalg.norm(speed), abs=1e-6)
        assert right @ down == pytest.approx(0.0, abs=1e-6)
        assert under @ down > 0.0


def test_a_late_estimate_is_moved_to_the_time_at_which_it_was_available():
    (row,) = pdus(tracked(1, tick_s=10.0, available_s=12.0, end_s=13.0, state=STATE))
    assert row["time_s"] == pytest.approx(12.0, abs=1e-5)
    assert row["location"] == pytest.approx(STATE[:3] + 2.0 * STATE[3:])


def test_a_track_as_reckoned_is_sent_at_heartbeats_only():
    window = straight(range(21), end_s=21.0)
    assert times(window) == [0.0, 5.0, 10.0, 15.0, 20.0]
    assert times(window, heartbeat_s=8.0) == [0.0, 8.0, 16.0]
    _, delivery = sent("dis", [window])
    assert (delivery.delivered, delivery.withheld) == (5, 16)


def test_heartbeats_are_kept_between_estimates_and_windows():
    window = straight([0.0, 7.0, 14.0], end_s=14.5)
    assert times(window) == [0.0, 5.0, 10.0]
    positions = [row["location"] for row in pdus(window)]
    assert positions[1] == pytest.approx(STATE[:3] + 5.0 * STATE[3:])
    quiet = [tracked(0, end_s=end_s) for end_s in (15.5, 18.0, 20.5)]
    assert times(window, *quiet) == [0.0, 5.0, 10.0, 15.0, 20.0]


def test_a_track_that_says_nothing_for_12_s_is_given_up():
    assert times(straight([0.0, 1.0], end_s=60.0)) == [0.0, 5.0, 10.0]
    revival = tracked(1, tick_s=70.0, end_s=71.0, state=STATE)
    assert times(straight([0.0, 1.0], end_s=60.0), revival) == [0.0, 5.0, 10.0, 70.0]


def test_a_track_off_its_dead_reckoning_is_sent_at_once():
    ticks_s = np.arange(0.0, 5.0, 0.5)
    state = np.tile(STATE, (10, 1))
    state[:, :3] += ticks_s[:, None] * STATE[3:]
    state[:, 0] += 0.5 * 30.0 * ticks_s**2  # m, an acceleration of 30 m/s2
    state[:, 3] += 30.0 * ticks_s
    window = tracked(10, tick_s=ticks_s, end_s=5.0, state=state)
    assert times(window, threshold_m=60.0) == [0.0, 2.5]
    assert times(window, threshold_m=20.0) == [0.0, 1.5, 3.0, 4.5]
    assert len(times(window, threshold_m=0.0)) == 10


def test_a_track_that_ends_is_deactivated_and_sends_no_more_heartbeats():
    rows = pdus(straight([0.0, 1.0, 2.0], end=[0, 0, 1], end_s=30.0))
    assert [row["appearance"] for row in rows] == [0, 1 << 23]
    assert rows[-1]["time_s"] == pytest.approx(2.0, abs=1e-5)


def test_a_change_of_type_is_sent():
    shares = [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0]]
    rows = pdus(straight([0.0, 1.0, 2.0], end_s=3.0, type_probability=shares))
    assert [row["entity_type"][:2] for row in rows] == [(0, 0), (2, 11)]


def test_windows_of_any_length_give_the_same_pdus():
    ticks_s = np.arange(0.0, 20.0)
    window = straight(ticks_s, end_s=20.0)
    halves = [straight(ticks_s[:7], end_s=7.0), straight(ticks_s[7:], start_s=7.0, end_s=20.0)]
    assert pdus(*halves) == pdus(window)
