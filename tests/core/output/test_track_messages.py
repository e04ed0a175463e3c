"""Messages of tracks: the lines of the tracks file with timestamps, also at ticks without
detections.
"""

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from attrs import evolve
from json_lines import json_lines
from opir_testing import stub_estimates, stub_regions, stub_window
from opir_testing.doubles import stub_hypotheses
from scored_scene import SCENE
from spool_transports import MIB, PATIENT, QUICK, SENSORS, Holding
from waiting import until

from opir_core import compile_plan, run_of_plan
from opir_core.builtin.sinks import LineFile, MemorySink
from opir_core.errors import SinkError
from opir_core.live import LiveRun, LiveSettings
from opir_core.output import ForgeEncoder, TracksFile, deliver, schema
from opir_core.output.events.encoder_input import track_count
from opir_core.output.events.tracks import TracksEncoder
from opir_core.output.pump import pump
from opir_core.output.spool import EncodedBatcher, Journal, TransportSink
from opir_core.plugin import Delivery, Encoder, EncoderContext, Host, Tracks, Window
from opir_core.reading import scene_from_mapping
from opir_core.scene import core_hypotheses

AIM = {"lat_deg": 32.0, "lon_deg": -124.0}
EPOCH_US = 1_775_044_800_000_000
HYPOTHESES = tuple(each.name for each in core_hypotheses())
CONTEXT = EncoderContext(sensors=SENSORS, epoch_us=EPOCH_US, hypotheses=HYPOTHESES)
ENCODER: Encoder = TracksEncoder(CONTEXT)
VALIDATOR = jsonschema.Draft202012Validator(
    schema("track", is_closed=True), format_checker=jsonschema.Draft202012Validator.FORMAT_CHECKER
)
TIMESTAMPS = {"timestamp", "available_at"}
#: A short burn, of which tracks go on for a while.
SHORT = {
    **SCENE,
    "duration_s": 110.0,
    "targets": [{**SCENE["targets"][0], "type": "SRBM", "aim": AIM}],
}


def tracks_of(count: int, **columns: Any) -> Tracks:
    estimate_columns = {
        "track": np.arange(count),
        "tick_s": np.full(count, 60.0),
        "state": np.arange(6.0),
        "state_covariance": np.eye(6),
        "launch": [0.1, 0.2, 3.0],
        "launch_covariance": np.eye(3),
        "burnout": np.arange(7.0),
        "impact": [0.3, -0.2, 1800.0],
        "impact_covariance": np.diag([4e6, 4e6, 4.0]),
        "impact_regions": [stub_regions(17.2, -11.5)] * count,
        "impact_method": np.arange(count) % 2,
        "type_probability": [0.7, 0.3, 0.0, 0.0],
        "hypothesis_probability": stub_hypotheses(ICBM=0.5, SLV=0.25),
        "end": np.arange(count) % 4,
        "probability_burning": 0.5,
    }
    return stub_estimates(count, **(estimate_columns | columns))


def window_of(tracks: Tracks, detections: int = 0) -> Window:
    return evolve(stub_window(detections), tracks=tracks)


def messages_of(tracks: Tracks) -> list[dict[str, Any]]:
    return [json.loads(line) for line in ENCODER.encode(window_of(tracks)).splitlines()]


def test_messages_follow_their_schema() -> None:
    for tracks in (
        tracks_of(4),
        stub_estimates(3),
        tracks_of(1, impact_regions=[stub_regions(9.0, 180.0)]),
    ):
        for message in messages_of(tracks):
            VALIDATOR.validate(message)
            assert list(message) == list(schema("track")["properties"])
    for wrong in ({"probability_burning": 1.5}, {"end": "gone"}, {"hypotheses": {"ICBM": 2.0}}):
        with pytest.raises(jsonschema.ValidationError):
            VALIDATOR.validate(messages_of(tracks_of(1))[0] | wrong)


def test_messages_are_lines_of_the_tracks_file(tmp_path: Path) -> None:
    tracks = tracks_of(3, available_s=np.full(3, 61.5))
    with TracksFile(tmp_path / "t.jsonl", HYPOTHESES) as file:
        file.write(tracks)
    lines = json_lines(tmp_path / "t.jsonl")
    for line, message in zip(lines, messages_of(tracks), strict=True):
        assert message["schema_version"] == ENCODER.schema_version == "tracks-1.0"
        assert (message["timestamp"], message["available_at"]) == (
            "2026-04-01T12:01:00.000000Z",
            "2026-04-01T12:01:01.500000Z",
        )
        assert message["launch"].pop("time") == "2026-04-01T12:00:03.000000Z"
        assert message["burnout"].pop("time") == "2026-04-01T12:00:06.000000Z"
        assert message["impact"].pop("time") == "2026-04-01T12:30:00.000000Z"
        assert {
            name: value
            for name, value in message.items()
            if name not in {*TIMESTAMPS, "schema_version"}
        } | {"schema_version": "tracks-2.0"} == line


def test_a_tick_beyond_timestamps_is_refused() -> None:
    with pytest.raises(SinkError, match="1 of 1 times lie outside the years 1 to 9999"):
        ENCODER.encode(window_of(tracks_of(1, tick_s=np.array([3e11]))))


def test_batches_are_keyed_by_track() -> None:
    tracks = tracks_of(1200, track=np.repeat([3, 7, 12], 400))
    batches = list(EncodedBatcher(ENCODER, SENSORS).batches(window_of(tracks, detections=5)))
    keys = [int(batch.keys[key]) for batch in batches for key in batch.key_of]
    numbers = [json.loads(message)["track_id"] for batch in batches for message in batch.messages()]
    assert keys == numbers == tracks.track.tolist()
    assert {batch.schema_version for batch in batches} == {"tracks-1.0"}
    assert len(batches) > 1
    assert not list(EncodedBatcher(ENCODER, SENSORS).batches(stub_window(5)))


def test_events_of_an_output_are_its_tracks(tmp_path: Path) -> None:
    windows = [window_of(tracks_of(600), 2), window_of(Tracks.empty(), 7), window_of(tracks_of(3))]
    expected = b"".join(map(ENCODER.encode, windows))
    memory = MemorySink(lambda: ENCODER, track_count)
    forge = LineFile(str(tmp_path / "e.jsonl"), ForgeEncoder(CONTEXT))
    sinks = {
        "line": LineFile(str(tmp_path / "t.jsonl"), ENCODER),
        "memory": memory,
        "sent": TransportSink(
            "stub",
            Holding(),
            Journal(str(tmp_path / "s"), MIB * 64),
            EncodedBatcher(ENCODER, SENSORS),
            PATIENT,
        ),
        "forge": forge,
    }
    assert ENCODER.encodes_tracks
    report = pump(windows, sinks, counts=dict.fromkeys(("line", "memory", "sent"), track_count))
    assert [sink.delivered for sink in report.sinks] == [603, 603, 603, 9]
    assert not report.failures
    assert [(sink.dropped, sink.withheld) for sink in report.sinks] == [(0, 0)] * 4
    assert (tmp_path / "t.jsonl").read_bytes() == memory.lines() == expected
    assert (tmp_path / "e.jsonl").read_bytes().count(b"\n") == 9


def outputs(tmp_path: Path, **more: Any) -> list[dict[str, Any]]:
    return [{"jsonl": {"path": str(tmp_path / "tracks.jsonl"), "encoder": "tracks", **more}}]


@pytest.mark.slow
def test_tracks_are_written_without_detections_and_from_a_spool(tmp_path: Path) -> None:
    written = []
    for more in ({}, {"spool": {"path": str(tmp_path / "spool")}}):
        plan = compile_plan(scene_from_mapping({**SHORT, "outputs": outputs(tmp_path, **more)}))
        outcome = deliver(plan)
        written.append((tmp_path / "tracks.jsonl").read_bytes())
        (tmp_path / "tracks.jsonl").unlink()
        run = run_of_plan(plan)
        assert outcome.report.sinks[0].delivered == len(run.tracks) == written[0].count(b"\n") > 0
    assert (
        written[0]
        == written[1]
        == TracksEncoder(
            EncoderContext(
                sensors=plan.sensors, epoch_us=plan.scene.epoch_us, hypotheses=plan.hypothesis_names
            )
        ).encode(evolve(stub_window(0), tracks=run.tracks))
    )
    last_message = json.loads(written[0].splitlines()[-1])
    seen_s = run.detections.time_s[run.detections.track >= 0].max()
    assert (last_message["time_s"], last_message["impact"]["method"]) == (
        plan.scene.duration_s,
        "posterior",
    )
    assert last_message["time_s"] > seen_s + 10.0


@pytest.mark.slow
def test_a_live_run_writes_the_tracks_of_the_batch(tmp_path: Path) -> None:
    scene = scene_from_mapping({**SCENE, "outputs": outputs(tmp_path)})
    deliver(compile_plan(scene))
    batch = (tmp_path / "tracks.jsonl").read_bytes()
    run = LiveRun(scene, Host.discover(), LiveSettings(speed=None))
    run.start()
    until(lambda: run.state == "ended")
    (sink,) = run.stop().sinks
    assert (tmp_path / "tracks.jsonl").read_bytes() == batch
    assert (sink.given, sink.delivered, sink.dropped) == (batch.count(b"\n"),) * 2 + (0,)


@pytest.mark.slow
def test_an_output_may_change_its_encoder_while_the_run_goes_on(tmp_path: Path) -> None:
    run = LiveRun(
        scene_from_mapping({**SCENE, "outputs": outputs(tmp_path)}),
        Host.discover(),
        LiveSettings(speed=20.0),
    )
    run.start()
    until(lambda: run.status().sinks[0].delivered > 3)
    settings = run.settings_mapping()
    settings["outputs"][0]["jsonl"] = {"path": str(tmp_path / "e.jsonl"), "encoder": "forge"}
    run.configure(settings)
    until(
        lambda: (
            (tmp_path / "e.jsonl").is_file()
            and (tmp_path / "e.jsonl").read_bytes().count(b"\n") > 50
        )
    )
    (sink,) = run.stop(within_s=60.0).sinks
    tracks, events = (
        (tmp_path / name).read_bytes().count(b"\n") for name in ("tracks.jsonl", "e.jsonl")
    )
    assert (sink.given, sink.delivered, sink.dropped) == (tracks + events, tracks + events, 0)


def test_a_spool_holds_tracks_of_a_killed_run(tmp_path: Path) -> None:
    windows = [window_of(tracks_of(2), 4), window_of(tracks_of(1))]
    journal = Journal(str(tmp_path / "spool"), MIB)
    first_sink = TransportSink(
        "stub", Holding("hold"), journal, EncodedBatcher(ENCODER, SENSORS), QUICK
    )
    for window in windows:
        first_sink.write(window)
    assert first_sink.close() == Delivery(delivered=0, spooled=3)
    held = Holding()
    second_sink = TransportSink(
        "stub", held, Journal(str(tmp_path / "spool"), MIB), EncodedBatcher(ENCODER, SENSORS), QUICK
    )
    assert second_sink.close() == Delivery(delivered=3, recovered=3)
