"""The stream says which sensor watched, where the scene asks for it."""

import json
from typing import Any

import pytest
from attrs import evolve
from opir_http.feed import Feed
from opir_testing import stub_sensor, stub_window

from opir_core.interfaces.records import CommandRecord
from opir_core.live import LiveWindow
from opir_core.plugin import EncoderContext, Sensor

SENSOR = stub_sensor()


def heartbeats(heartbeat_s: float | None, sensor: Sensor = SENSOR, **changes: Any) -> list[Any]:
    """Return the heartbeats of the frames of two windows of a second without detections."""
    context = EncoderContext(sensors=(sensor,), epoch_us=0)
    feed = Feed(context, 100, 10, dict, heartbeat_s=heartbeat_s)
    spans = []
    for number in (1, 2):
        window = evolve(stub_window(0), start_s=number - 1.0, end_s=float(number), **changes)
        plan: Any = None
        frames = feed._frames(LiveWindow(window, number, 0, plan))
        for _, full, brief in frames:
            head, _, data = full.partition(b"\ndata: ")
            if head == b"event: heartbeats":
                assert full == brief
                spans += json.loads(data)
    return spans


def test_heartbeats_are_frames_of_the_stream() -> None:
    spans = [(beat["watched_from"][17:21], beat["watched_to"][17:21]) for beat in heartbeats(0.5)]
    assert spans == [("00.0", "00.5"), ("00.5", "01.0"), ("01.0", "01.5"), ("01.5", "02.0")]


@pytest.mark.parametrize("heartbeat_s", [None, 10.0])
def test_a_stream_without_due_heartbeats_has_no_frame_of_them(heartbeat_s: float | None) -> None:
    assert heartbeats(heartbeat_s) == []


def test_a_sensor_that_leaves_its_survey_does_not_watch() -> None:
    wide = evolve(SENSOR, modes={"sector": SENSOR})
    turn = CommandRecord(0.2, wide.id, -1, "", start_s=0.3, from_s=0.4, mode="sector")
    first = heartbeats(0.5, wide, commands=(turn,))[0]
    assert (first["watched_from"][17:21], first["watched_to"][17:21]) == ("00.0", "00.3")
