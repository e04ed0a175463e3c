"""Heartbeats among events: who watched when, on a grid of the run, and no event of it."""

import json
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import pytest
from attrs import evolve
from file_sinks import encoder
from opir_testing import stub_sensor, stub_window

import opir_core as opir
from opir_core.builtin.sinks import LineFile
from opir_core.interfaces.records import CommandRecord
from opir_core.output import deliver
from opir_core.output.heartbeats import Heartbeats
from opir_core.planning.partial_looks import SteeringCommands
from opir_core.plugin import Delivery, Sensor

EPOCH = datetime(2026, 4, 1, 12, tzinfo=UTC)
EPOCH_US = round(EPOCH.timestamp() * 1e6)

SCENE = {
    "scene": "beats",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 12.5,
    "seed": 3,
    "sensors": [
        {"model": "SBIRS-GEO", "id": name, "orbital_slot_deg": slot}
        for name, slot in (("WEST", -135), ("EAST", -75))
    ],
    "targets": [
        {
            "id": "T",
            "type": "ICBM",
            "launch": {"lat_deg": 34, "lon_deg": -120},
            "aim": {"lat_deg": 9, "lon_deg": 167},
        }
    ],
    "watched_s": {"WEST": [[0.0, 4.25], [7.5, 12.5]]},
}


def scene(path: Path, **settings: float) -> opir.Scene:
    return opir.scene_from_mapping(
        {**SCENE, "outputs": [{"jsonl": {"path": str(path)} | settings}]}
    )


def beats(lines: bytes) -> list[tuple[str, float, float]]:
    """Return sensor and span, s, of the heartbeats of lines."""
    rows = [json.loads(line) for line in lines.splitlines() if b'"heartbeat"' in line]
    return [
        (row["sensor_id"], seconds(row["watched_from"]), seconds(row["watched_to"])) for row in rows
    ]


def seconds(moment: str) -> float:
    return (datetime.fromisoformat(moment) - EPOCH).total_seconds()


def sensors() -> tuple[Sensor, ...]:
    return opir.compile_plan(opir.scene_from_mapping(SCENE)).sensors


def test_a_run_of_whole_intervals_has_no_rest() -> None:
    for interval_s, end_s in ((0.1, 0.3), (0.3, 0.9), (2.3, 13.8)):
        heartbeats = Heartbeats((stub_sensor(),), EPOCH_US, interval_s)
        heartbeats.until(end_s)
        assert heartbeats.rest() == b""


def test_heartbeats_are_spans_of_a_grid_in_which_a_sensor_watched() -> None:
    heartbeats = Heartbeats(sensors(), EPOCH_US, 5.0)
    lines = heartbeats.until(12.5) + heartbeats.rest()
    west = [beat[1:] for beat in beats(lines) if beat[0] == "WEST"]
    east = [beat[1:] for beat in beats(lines) if beat[0] == "EAST"]
    assert west == [(0.0, 4.25), (7.5, 10.0), (10.0, 12.5)]
    assert east == [(0.0, 5.0), (5.0, 10.0), (10.0, 12.5)]


@pytest.mark.parametrize("cuts", [(12.5,), (0.1, 5.0, 5.0, 9.9999, 12.5), (4.0, 3.0, 12.5)])
def test_heartbeats_do_not_depend_on_the_windows(cuts: tuple[float, ...]) -> None:
    whole, parts = (Heartbeats(sensors(), EPOCH_US, 0.7) for _ in range(2))
    lines = whole.until(12.5) + whole.rest()
    assert b"".join(map(parts.until, cuts)) + parts.rest() == lines
    starts = {start_s for _, start_s, _ in beats(lines)}
    assert all(0.0 < end_s - start_s <= 0.7 + 1e-6 for _, start_s, end_s in beats(lines))
    assert len(starts) == 18 + 1  # 17 intervals and the last, and WEST's at 7.5 s


def test_a_run_writes_heartbeats_between_the_same_events(tmp_path: Path) -> None:
    plain = tmp_path / "plain.jsonl"
    beating = tmp_path / "beating.jsonl"
    for path, settings in ((plain, {}), (beating, {"heartbeat_s": 1.0})):
        outcome = deliver(opir.compile_plan(scene(path, **settings)))
        assert outcome.report.sinks[0].delivered == plain.read_bytes().count(b"\n")
        assert outcome.report.sinks[0].dropped == 0
    lines = beating.read_bytes().splitlines(keepends=True)
    events = [line for line in lines if b'"heartbeat"' not in line]
    assert b"".join(events) == plain.read_bytes()
    east = [beat for beat in beats(beating.read_bytes()) if beat[0] == "EAST"]
    assert [end == start for (_, _, end), (_, start, _) in pairwise(east)] == [True] * 12
    assert east[-1] == ("EAST", 12.0, 12.5)


def test_heartbeats_follow_the_events_of_their_window(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    out = LineFile(str(path), encoder(), heartbeats=Heartbeats((stub_sensor(),), 0, 1.0))
    for number in range(2):
        out.write(evolve(stub_window(3), start_s=2.0 * number, end_s=2.0 * number + 2.0))
    assert out.close() == Delivery(delivered=6)
    records = [json.loads(line).get("record", "event") for line in path.read_text().splitlines()]
    assert records.count("event") == 6
    one = ["event"] * 3 + ["heartbeat"] * 2
    assert records == one + one


def test_commands_of_the_past_are_forgotten_and_change_no_line() -> None:
    wide = evolve(stub_sensor(), modes={"sector": stub_sensor()})
    turns = [
        CommandRecord(at_s, wide.id, -1, "", start_s=at_s + 0.1, from_s=at_s + 0.3, mode="sector")
        for at_s in (0.5 * number for number in range(80))
    ]
    whole, parts = (Heartbeats((wide,), EPOCH_US, 1.0) for _ in range(2))
    lines = b"".join(parts.until(end_s, turns[2 * end_s - 2 : 2 * end_s]) for end_s in range(1, 41))
    assert lines == whole.until(40.0, turns)
    assert lines.count(b"\n") == 120
    steering = SteeringCommands([wide])
    steering.take(turns)
    steering.forget(20.0)
    assert [record.start_s for record in steering.commands] == [turn.start_s for turn in turns[39:]]
