"""How many looks and events a second, where the time goes, and how much memory: one process.

100 ICBMs and 10 sensors in geostationary slots that see them all, 20 looks a second, the whole
boost. Figures are medians.
"""

import cProfile
import pstats
import sys
import tempfile
from pathlib import Path

import numpy as np
from pages import median_s, options_of
from raid import show, show_memory

import opir_core as opir
from opir_core.output.delivery import deliver
from opir_core.reading import scene_mapping
from opir_core.simulation.run import plan_windows


def boost_scene(targets, sensors=10, duration_s=400.0):
    """Return the benchmark's scene."""
    rng = np.random.default_rng(3)
    launches = zip(
        rng.uniform(-20, 20, targets).tolist(),
        rng.uniform(-10, 10, targets).tolist(),
        rng.uniform(0, 30, targets).tolist(),
        strict=True,
    )
    sensor = {"model": "SBIRS-GEO", "scan_period_ms": 50.0}
    return opir.scene_from_mapping(
        {
            "scene": "throughput",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": duration_s,
            "seed": 1,
            "sensors": [
                {**sensor, "id": f"S{n:02d}", "orbital_slot_deg": -45.0 + 10.0 * n}
                for n in range(sensors)
            ],
            "targets": [
                {
                    "id": f"T{n:03d}",
                    "type": "ICBM",
                    "launch": {"lat_deg": lat, "lon_deg": lon, "time_s": time_s},
                    "aim": {"lat_deg": lat - 60.0, "lon_deg": lon + 30.0},
                }
                for n, (lat, lon, time_s) in enumerate(launches)
            ],
            "outputs": [],
        }
    )


def drained(plan):
    """Run a plan, keeping nothing, and return its looks and detections."""
    counts = [(window.looks, len(window.detections)) for window in plan_windows(plan)]
    looks, detections = map(sum, zip(*counts, strict=True))
    return looks, detections


def written(scene):
    """Run a scene into a file of JSON lines, from plan to bytes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "events.jsonl"
        mapping = {**scene_mapping(scene), "outputs": [{"jsonl": {"path": str(path)}}]}
        deliver(opir.compile_plan(opir.scene_from_mapping(mapping)))


def main():
    """Measure and print."""
    options = options_of(__doc__, repeat=5, targets=100, profile=False)
    scene = boost_scene(options.targets)
    plan = opir.compile_plan(scene)
    looks, detections = drained(plan)
    planning_s = median_s(lambda: opir.compile_plan(scene), options.repeat)
    engine_s = median_s(lambda: drained(plan), options.repeat)
    show_memory()
    file_s = median_s(lambda: written(scene), options.repeat)
    show("plan", planning_s * 1e3, "ms", f"{looks / 1e6:.2f} million looks, {detections} events")
    show("columns", engine_s / looks * 1e9, "ns/look", f"{looks / engine_s / 1e6:.2f} million/s")
    show("columns", engine_s / detections * 1e9, "ns/event")
    rate = f"{detections / file_s / 1e3:.0f} thousand events/s, all in"
    show("JSONL", file_s / detections * 1e9, "ns/event", rate)
    show("of it", (file_s - engine_s) / detections * 1e9, "ns/event", "encoding and writing")
    if options.profile:
        profile = cProfile.Profile()
        profile.runcall(drained, plan)
        pstats.Stats(profile, stream=sys.stdout).sort_stats("tottime").print_stats(25)


if __name__ == "__main__":
    main()
