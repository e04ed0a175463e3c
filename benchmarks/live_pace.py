"""Latency of a live run: a raid of 100 targets in real time, and the load at which it first misses
deadlines.

Twelve satellites of three constellations. The age of an event is the time from when it was due to
when the sink has written it, JSON lines included. A cycle that is done more than the shortest scan
period after it was due misses its deadline.
"""

import time
from pathlib import Path

import numpy as np
from pages import markdown_table, options_of, printed

from opir_core.host.host import Host
from opir_core.live.loops import limit_pauses
from opir_core.live.running import LiveRun, LiveSettings
from opir_core.reading import load_scene, scene_from_mapping, scene_mapping

SCENE = Path(__file__).resolve().parents[1] / "examples" / "raid_100.yaml"
OUTPUT = ["outputs=[{jsonl: {path: /dev/null}}]"]

PAGE = """# Latency of a live run

How old are events of a live run? With {targets} targets 99 % are at most {p99_ms:.1f} ms old, and
{missed} deadlines are missed. The run {limit}.

{table}

Required: no missed deadline in 300 s, p99 at most 100 ms: {met}.

`examples/raid_100.yaml`: 100 targets launched within ten seconds, twelve satellites, cycles of 50
ms, JSON lines to `/dev/null`; then twice the targets each time. An event's age is the time from
when it was due until the sink has written it. A cycle misses its deadline if it is done more than
50 ms (the shortest scan period) after it was due. CPU is the load of a core. With real-time
priority (`chrt -f 50`).
"""


def measured(host, scene, seconds, speed):
    """Run a scene for a time, s, and return its figures."""
    run = LiveRun(scene, host, LiveSettings(speed=speed, loop=True))
    limit_pauses()
    run.start()
    sink = run._sinks[0]._sink
    write = sink.write
    ages_s = []

    def aged(window):
        write(window)
        due_s = run._pace._start_ns * 1e-9 + window.detections.time_s / speed
        ages_s.append(time.monotonic() - due_s)

    sink.write = aged
    start_cpu_s = time.process_time()
    start_s = time.monotonic()
    time.sleep(seconds)
    core = (time.process_time() - start_cpu_s) / (time.monotonic() - start_s)
    status = run.stop()
    age_ms = 1e3 * np.concatenate(ages_s)
    return {
        "targets": len(scene.targets),
        "s": f"{seconds:g}",
        "events/s": f"{len(age_ms) / seconds:.0f}",
        "missed deadlines": status.late_cycles,
        "latest, ms": f"{1e3 * status.latest_s:.1f}",
        "age p50, ms": f"{np.percentile(age_ms, 50):.1f}",
        "p99": f"{np.percentile(age_ms, 99):.1f}",
        "max": f"{age_ms.max():.1f}",
        "CPU": f"{100 * core:.0f} %",
    }


def raid(host, times):
    """Return the raid with that many times its targets, a tenth of a degree apart."""
    mapping = scene_mapping(load_scene(SCENE, overrides=OUTPUT, host=host))
    targets = []
    for copy in range(times):
        for target in mapping["targets"]:
            launch = target["launch"]
            launch = launch | {"lat_deg": launch["lat_deg"] + 0.1 * copy / times}
            targets.append(target | {"id": f"{target['id']}-{copy}", "launch": launch})
    return scene_from_mapping(mapping | {"targets": targets}, host=host)


def until_late(host, seconds):
    """Yield runs with twice the targets each time, up to the first with missed deadlines."""
    times = 2
    while times <= 64:
        row = measured(host, raid(host, times), seconds, 1.0)
        yield row
        if row["missed deadlines"]:
            return
        times *= 2


def page(rows):
    """Return the page."""
    base = rows[0]
    late = next((row for row in rows[1:] if row["missed deadlines"]), None)
    is_met = not base["missed deadlines"] and float(base["p99"]) <= 100.0
    return PAGE.format(
        targets=base["targets"],
        p99_ms=float(base["p99"]),
        missed=base["missed deadlines"],
        limit=f"first misses a deadline at {late['targets']} targets"
        if late
        else "misses no deadline at higher loads",
        table=markdown_table(list(base), [list(row.values()) for row in rows]),
        met="met" if is_met else "NOT met",
    )


def main():
    """Measure and print; write the page where asked. `--step 0` leaves higher loads out."""
    options = options_of(__doc__, seconds=300.0, step=40.0, speed=1.0)
    host = Host.discover()
    scene = load_scene(SCENE, overrides=OUTPUT, host=host)
    rows = [printed(measured(host, scene, options.seconds, options.speed))]
    rows += map(printed, until_late(host, options.step) if options.step else ())
    if options.write:
        (options.write / "live.md").write_text(page(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
