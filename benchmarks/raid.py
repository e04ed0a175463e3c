"""How long does a raid take, from the plan to files of events and truth?

Launches between 60° south and north within the first minute, and sensors in geostationary slots
around the Earth, ten looks a second. Prints processor time of the plan and of the run, events,
bytes, and the peak of memory; with `--plan` of the plan alone, with `--profile` the functions that
take the most. `--to` is jsonl, parquet or null.
"""

import cProfile
import pstats
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from figures import keep
from pages import median_s, options_of

import opir_core as opir
from opir_core.output.delivery import deliver
from opir_core.output.transaction import FILES_KEY


def raid_scene(launches, sensors, duration_s, outputs, **sensor):
    """Return the scene; `sensor` are settings of all sensors."""
    rng = np.random.default_rng(5)
    latitude = rng.uniform(-60.0, 60.0, launches)
    longitude = rng.uniform(-180.0, 180.0, launches)
    ignition = rng.uniform(0.0, 60.0, launches)
    slots = (15.0 + 360.0 / sensors * np.arange(sensors)) % 360.0 - 180.0
    return opir.scene_from_mapping(
        {
            "scene": "raid",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": duration_s,
            "seed": 1,
            "sensors": [
                {"model": "SBIRS-GEO", "id": f"S{n:02d}", "orbital_slot_deg": slot, **sensor}
                for n, slot in enumerate(slots.tolist())
            ],
            "targets": [
                {
                    "id": f"T{n:04d}",
                    "type": "ICBM",
                    "launch": {"lat_deg": float(lat), "lon_deg": float(lon), "time_s": float(time)},
                    "aim": {
                        "lat_deg": float(-0.5 * lat),
                        "lon_deg": float((lon + 250.0) % 360.0 - 180.0),
                    },
                }
                for n, (lat, lon, time) in enumerate(
                    zip(latitude, longitude, ignition, strict=True)
                )
            ],
            "outputs": outputs,
        }
    )


def delivered(plan, truth):
    """Run a plan into the outputs of its scene, and its truth into a file."""
    outcome = deliver(plan, truth_path=truth)
    outcome.raise_for_failures()
    return outcome


def show(name, figure, unit, remark=""):
    """Keep and print a figure."""
    keep(name, figure, unit)
    print(f"{name:8} {figure:9.2f} {unit:8} {remark}")


def show_memory():
    """Keep and print the peak of memory."""
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    show("memory", peak_mib, "MiB", "peak")


def main():
    """Measure and print."""
    options = options_of(
        __doc__,
        launches=1000,
        sensors=12,
        duration=300.0,
        to="jsonl",
        no_truth=False,
        repeat=1,
        plan=False,
        profile=False,
    )
    with tempfile.TemporaryDirectory() as folder:
        truth_name = "truth.parquet" if options.to == "parquet" else "truth.jsonl"
        truth = None if options.no_truth else Path(folder, truth_name)
        settings = {} if options.to == "null" else {"path": f"{folder}/events.{options.to}"}
        outputs = [{options.to: settings}]
        scene = raid_scene(options.launches, options.sensors, options.duration, outputs)
        start_s = time.process_time()
        plan = opir.compile_plan(scene)
        show("plan", time.process_time() - start_s, "s", f"{len(plan.pairs)} pairs")
        if options.plan:
            show_memory()
        else:
            show_run(plan, truth, options.repeat, options.profile)


def show_run(plan, truth, repeat, has_profile):
    """Measure and print runs of a plan."""
    profile = cProfile.Profile()
    outcomes = []

    def run():
        work = profile.runcall if has_profile else lambda action, *words: action(*words)
        outcomes.append(work(delivered, plan, truth))

    run_s = median_s(run, repeat, warm=False)
    counts = outcomes[-1].summary["counts"]
    manifest = outcomes[-1].manifest
    events = counts["detections"]
    show("run", run_s, "s", f"{run_s / events * 1e9:.0f} ns/event, all in")
    show("events", events * 1e-6, "million", f"of {counts['looks'] * 1e-6:.2f} million looks")
    size = sum(file["bytes"] for file in manifest[FILES_KEY])
    show("written", size * 1e-6, "MB", f"by the renderer {manifest.get('renderer', 'none')}")
    show_memory()
    for file in manifest[FILES_KEY]:
        print(f"{file['name'].rsplit('/')[-1]:16} {file['sha256']}")
    if has_profile:
        pstats.Stats(profile, stream=sys.stdout).sort_stats("tottime").print_stats(30)


if __name__ == "__main__":
    main()
