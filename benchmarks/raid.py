"""How long does a raid take, from the plan to files of events and truth: one process, and what of
it is text.

    python benchmarks/raid.py [--launches 1000] [--sensors 12] [--duration 300] [--to
                              jsonl|parquet|null] [--no-truth] [--repeat 1] [--plan] [--profile]

The scene: 1 000 ICBMs and 12 sensors in geostationary slots around the Earth, ten looks a second,
events and truth to files. Prints processor time of the plan and of the run, events, bytes, and the
peak of memory; with `--plan` of the plan alone, with `--profile` the functions that take the most.
"""

import argparse
import cProfile
import pstats
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from figures import keep

import opir_core as opir
from opir_core.output.delivery import RunOutcome, deliver
from opir_core.output.transaction import FILES_KEY
from opir_core.planning.plan import Plan


def raid(launches: int, sensors: int, duration_s: float, outputs: list[object]) -> opir.Scene:
    """Return the scene: launches from everywhere between 60° south and north, within its first
    minute.
    """
    random = np.random.default_rng(5)
    latitude = random.uniform(-60.0, 60.0, launches)
    longitude = random.uniform(-180.0, 180.0, launches)
    ignition = random.uniform(0.0, 60.0, launches)
    return opir.scene_from_mapping(
        {
            "scene": "raid",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": duration_s,
            "seed": 1,
            "sensors": [
                {
                    "model": "SBIRS-GEO",
                    "id": f"S{n:02d}",
                    "orbital_slot_deg": float((slot + 180.0) % 360.0 - 180.0),
                }
                for n, slot in enumerate(-165.0 + 360.0 / sensors * np.arange(sensors))
            ],
            "targets": [
                {
                    "id": f"T{n:04d}",
                    "type": "ICBM",
                    "launch": {"lat_deg": float(lat), "lon_deg": float(lon), "time_s": float(at)},
                    "aim": {
                        "lat_deg": float(-0.5 * lat),
                        "lon_deg": float((lon + 250.0) % 360.0 - 180.0),
                    },
                }
                for n, (lat, lon, at) in enumerate(zip(latitude, longitude, ignition, strict=True))
            ],
            "outputs": outputs,
        }
    )


def run(plan: Plan, truth: Path | None) -> RunOutcome:
    """Run a plan into the outputs of its scene, and its truth into a file."""
    outcome = deliver(plan, truth_path=truth)
    outcome.raise_for_failures()
    return outcome


def memory() -> tuple[str, float, str, str]:
    """Return the peak of memory as a row of the output."""
    return "memory", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, "MiB", "peak"


def show(rows: Iterable[tuple[str, float, str, str]]) -> None:
    """Keep and print names, figures, units and remarks."""
    for what, figure, unit, remark in rows:
        keep(what, figure, unit)
        print(f"{what:8} {figure:9.2f} {unit:8} {remark}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--launches", type=int, default=1000)
    parser.add_argument("--sensors", type=int, default=12)
    parser.add_argument("--duration", type=float, default=300.0, help="s of scene time")
    parser.add_argument("--to", default="jsonl", choices=("jsonl", "parquet", "null"))
    parser.add_argument("--no-truth", action="store_true")
    parser.add_argument("--repeat", type=int, default=1)
    parser.add_argument("--plan", action="store_true", help="compile the plan, and run nothing")
    parser.add_argument("--profile", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        events = Path(folder) / f"events.{arguments.to}"
        truth = (
            None
            if arguments.no_truth
            else Path(folder) / ("truth.parquet" if arguments.to == "parquet" else "truth.jsonl")
        )
        output = {"null": {}} if arguments.to == "null" else {arguments.to: {"path": str(events)}}
        scene = raid(arguments.launches, arguments.sensors, arguments.duration, [output])
        before_s = time.process_time()
        plan = opir.compile_plan(scene)
        plan_s = time.process_time() - before_s
        if arguments.plan:
            show([("plan", plan_s, "s", f"{len(plan.pairs)} pairs"), memory()])
            return
        profile = cProfile.Profile()
        times = []
        outcome = None
        for _ in range(arguments.repeat):
            before_s = time.process_time()
            outcome = profile.runcall(run, plan, truth) if arguments.profile else run(plan, truth)
            times.append(time.process_time() - before_s)
        counts = outcome.summary["counts"]
        run_s = statistics.median(times)
        written = sum(file["bytes"] for file in outcome.manifest[FILES_KEY])
        rows = (
            ("plan", plan_s, "s", ""),
            ("run", run_s, "s", f"{run_s / counts['detections'] * 1e9:.0f} ns/event, all in"),
            (
                "events",
                counts["detections"] * 1e-6,
                "million",
                f"of {counts['looks'] * 1e-6:.2f} million looks",
            ),
            (
                "written",
                written * 1e-6,
                "MB",
                f"by the renderer {outcome.manifest.get('renderer', 'none')}",
            ),
            memory(),
        )
        show(rows)
        for file in outcome.manifest[FILES_KEY]:
            print(f"{file['name'].rsplit('/')[-1]:16} {file['sha256']}")
    if arguments.profile:
        pstats.Stats(profile, stream=sys.stdout).sort_stats("tottime").print_stats(30)


if __name__ == "__main__":
    main()
