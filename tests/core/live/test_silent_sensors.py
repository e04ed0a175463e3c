"""A live run tells of silence: heartbeats come while nothing is detected."""

from pathlib import Path

from waiting import until

from opir_core.live import LiveRun, LiveSettings
from opir_core.plugin import Host
from opir_core.reading import scene_from_mapping


def test_heartbeats_come_while_nothing_is_seen(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    scene = {
        "scene": "silence",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 600.0,
        "seed": 1,
        "sensors": [{"model": "SBIRS-GEO", "id": "WEST", "orbital_slot_deg": -135}],
        "targets": [],
        "outputs": [{"jsonl": {"path": str(path), "heartbeat_s": 1.0}}],
    }
    host = Host.discover()
    run = LiveRun(scene_from_mapping(scene, host=host), host, LiveSettings(speed=20.0))
    run.start()
    until(lambda: path.exists() and path.read_bytes().count(b"\n") > 5)
    assert run.status().detections == 0
    status = run.stop()
    assert status.sinks[0].delivered == 0
    lines = path.read_text().splitlines()
    assert all('"record":"heartbeat"' in line for line in lines)
    assert lines[0].endswith('12:00:01.000000Z"}')
