"""How many looks and events a second, where the time goes, and how much memory: one process, one
core.

    python benchmarks/throughput.py [--repeat 5] [--targets 100] [--profile]

The scene: 100 ICBMs and 10 sensors in geostationary slots that see them all, 20 looks a second, the
whole boost. Figures are medians.
"""

import argparse
import cProfile
import pstats
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from figures import keep

import opir_core as opir
from opir_core.output.delivery import deliver
from opir_core.planning.plan import Plan
from opir_core.reading import scene_mapping
from opir_core.simulation.run import plan_windows


def raid(duration_s: float = 400.0, targets: int = 100, sensors: int = 10) -> opir.Scene:
    """Return the benchmark's scene."""
    rng = np.random.default_rng(3)
    launches = zip(
        rng.uniform(-20, 20, targets),
        rng.uniform(-10, 10, targets),
        rng.uniform(0, 30, targets),
        strict=True,
    )
    return opir.scene_from_mapping(
        {
            "scene": "throughput",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": duration_s,
            "seed": 1,
            "sensors": [
                {
                    "model": "SBIRS-GEO",
                    "id": f"S{n:02d}",
                    "orbital_slot_deg": -45.0 + 10.0 * n,
                    "scan_period_ms": 50.0,
                }
                for n in range(sensors)
            ],
            "targets": [
                {
                    "id": f"T{n:03d}",
                    "type": "ICBM",
                    "launch": {"lat_deg": float(lat), "lon_deg": float(lon), "time_s": float(at)},
                    "aim": {"lat_deg": float(lat) - 60.0, "lon_deg": float(lon) + 30.0},
                }
                for n, (lat, lon, at) in enumerate(launches)
            ],
            "outputs": [],
        }
    )


def median_s(action: Callable[[], object], repeat: int) -> float:
    """Return the median time of an action, after one call that is not counted."""
    action()
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def drained(plan: Plan) -> tuple[int, int]:
    """Run a plan, keeping nothing, and return its looks and detections."""
    looks = 0
    detections = 0
    for window in plan_windows(plan):
        looks += window.looks
        detections += len(window.detections)
    return looks, detections


def peak_mib() -> float:
    """Return the process's peak memory."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--targets", type=int, default=100)
    parser.add_argument("--profile", action="store_true")
    arguments = parser.parse_args()
    scene = raid(targets=arguments.targets)
    planning_s = median_s(lambda: opir.compile_plan(scene), arguments.repeat)
    plan = opir.compile_plan(scene)
    looks, detections = drained(plan)
    start_mib = peak_mib()
    engine_s = median_s(lambda: drained(plan), arguments.repeat)
    streamed_mib = peak_mib()
    to_file_s = median_s(lambda: to_file(scene), arguments.repeat)
    million = looks / 1e6
    thousand = detections / 1e3
    writing_s = to_file_s - engine_s
    rows = (
        (
            "plan",
            planning_s * 1e3,
            "ms",
            f"{million:.2f} million looks, {thousand:.0f} thousand events",
        ),
        ("columns", engine_s / looks * 1e9, "ns/look", f"{million / engine_s:.2f} million looks/s"),
        ("columns", engine_s / detections * 1e9, "ns/event", ""),
        (
            "JSONL",
            to_file_s / detections * 1e9,
            "ns/event",
            f"{thousand / to_file_s:.0f} thousand events/s, all in",
        ),
        ("  of it", writing_s / detections * 1e9, "ns/event", "encoding and writing"),
        (
            "memory",
            streamed_mib,
            "MiB",
            f"peak while streaming (after the first pass: {start_mib:.0f} MiB)",
        ),
    )
    for what, figure, unit, remark in rows:
        print(f"{what:8} {figure:9.1f} {unit:9} {remark}")
        keep(what.strip(), figure, unit)
    if arguments.profile:
        profiled(plan)


def to_file(scene: opir.Scene) -> None:
    """Run a scene into a file of JSON lines, from plan to bytes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "events.jsonl"
        mapping = {**scene_mapping(scene), "outputs": [{"jsonl": {"path": str(path)}}]}
        deliver(opir.compile_plan(opir.scene_from_mapping(mapping)))


def profiled(plan: Plan) -> None:
    """Print where the time goes."""
    profile = cProfile.Profile()
    profile.runcall(drained, plan)
    pstats.Stats(profile, stream=sys.stdout).sort_stats("tottime").print_stats(25)


if __name__ == "__main__":
    main()
