"""How well a live run keeps its pace: the raid of 100 targets in real time, or faster; how old events are at the sink.

    python benchmarks/live_pace.py --seconds 300 --speed 1

Twelve satellites of three constellations. The age of an event is the time from the moment it was due to the moment the
sink has it, JSON lines included. A cycle is late that is done more than a scan period after it was due.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

from opir_core.live.running import LiveRun, LiveSettings
from opir_core.plugin.host import Host
from opir_core.reading import load_scene

SCENE = Path(__file__).resolve().parents[1] / "examples" / "raid_100.yaml"


def measured(seconds: float, speed: float) -> str:
    host = Host.discover()
    scene = load_scene(SCENE, overrides=["outputs=[{jsonl: {path: /dev/null}}]"], host=host)
    run = LiveRun(scene, host, LiveSettings(speed=speed, loop=True))
    run.start()
    outlet, ages = run._outlets[0], []
    inner: Any = outlet._sink
    write = inner.write

    def aged(window: Any) -> None:
        write(window)
        due_s = run._pace._start_ns * 1e-9 + window.detections.time_s / speed
        ages.append(time.monotonic() - due_s)

    inner.write = aged
    cpu_s, began_s = time.process_time(), time.monotonic()
    time.sleep(seconds)
    cpu = (time.process_time() - cpu_s) / (time.monotonic() - began_s)
    status = run.stop()
    age_ms = 1e3 * np.concatenate(ages)
    return (
        f"{speed:g}x, {seconds:g} s: {status.cycle} cycles, {status.late_cycles} late by more than a scan period,"
        f" the latest by {1e3 * status.latest_s:.1f} ms; {len(age_ms)} events, age p50"
        f" {np.percentile(age_ms, 50):.1f} ms,"
        f" p99 {np.percentile(age_ms, 99):.1f} ms, most {age_ms.max():.1f} ms; {100 * cpu:.0f} % of a core"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="The pace of a live run.")
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--speed", type=float, action="append")
    arguments = parser.parse_args()
    for speed in arguments.speed or [1.0]:
        print(measured(arguments.seconds, speed))


if __name__ == "__main__":
    main()
