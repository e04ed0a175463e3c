"""Every tracker on one scene: run time against error over the bound, of the core's trackers and of peers.

    python benchmarks/work_precision/tracking_scene.py [--runs 5] [--write FOLDER]

The same detections for all, seed by seed, in one run; association unknown to all but FilterPy, which is a filter and no
tracker: it is told. One ICBM in boost, two SBIRS-GEO. Processor time of one core, of the tracker alone. Needs stonesoup
and filterpy. `tracking.py` runs it too.
"""

import argparse
import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from attrs import evolve
from filterpy_tracker import FilterPyTracker

from opir_core.interfaces.protocols import Tracker
from opir_core.planning.plan import Plan, compile_plan
from opir_core.scene.reading import scene_from_mapping
from opir_core.scoring.comparison import TimedTracker
from opir_core.scoring.consistency import root_mean_square
from opir_core.scoring.errors import StateErrors, state_errors
from opir_core.scoring.evidence import evidence_of_run
from opir_core.scoring.ownership import ownership
from opir_core.simulation.run import run_of_plan

#: Errors count from here to the end, s since ignition: from when directions of both sensors tell the place.
FROM_S = 40.0
END_S = 120.0

SCENE = {
    "scene": "tracking",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": END_S,
    "seed": 100,
    "sensors": [
        {"model": "SBIRS-GEO", "id": "WEST", "orbital_slot_deg": -150.0},
        {"model": "SBIRS-GEO", "id": "EAST", "orbital_slot_deg": -90.0},
    ],
    "targets": [
        {
            "id": "T1",
            "type": "ICBM",
            "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 2.0},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
        }
    ],
}

#: Names of lines, and what a scene writes after `tracker:`.
TRACKERS = {
    "kepler-arc, 1 s": {"model": "kepler-arc"},
    "kepler-arc, memory 5 s, 1 s": {"model": "kepler-arc", "memory_s": 5.0},
    "boost-profile, 1 s": {"model": "boost-profile"},
    "boost-profile, 5 s": {"model": "boost-profile", "cadence_s": 5.0},
    "stereo-filter, 0.2 s": {"model": "stereo-filter", "cadence_s": 0.2},
    "stereo-filter, 1 s": {"model": "stereo-filter"},
    "stereo-filter, 5 s": {"model": "stereo-filter", "cadence_s": 5.0, "slice_s": 5.0},
    "stereo-filter, jerk, 1 s": {"model": "stereo-filter", "boost_model": "jerk"},
    "Stone Soup EKF, acceleration, 1 s": {"model": "stonesoup"},
    "Stone Soup EKF, jerk, 1 s": {"model": "stonesoup", "motion": "jerk", "noise": 0.3},
    "Stone Soup UKF, jerk, 1 s": {"model": "stonesoup", "filter": "ukf", "motion": "jerk", "noise": 0.3},
    "FilterPy EKF, acceleration, told whose, 1 s": None,
}

PAGE = """# Tracking: every tracker on one scene

Made by `python benchmarks/work_precision/tracking_scene.py --write docs/benchmarks`. One ICBM in boost, two
SBIRS-GEO (10 looks a second each, P_d 0.8), the same {detections} detections for all in {runs} runs of {seconds:g}
s, seeds {seeds}; processor time of one core, of the tracker alone. Errors are the RMSE of position and velocity at
ticks from {start:g} s after ignition on, with 95 % intervals over runs, over the Cramér–Rao bound: *known* with the
thrust known, *unknown* with specific force and jerk in the state and a jerk that wanders
([bounds](../how-to/score-tracks.md)). The machine had other work: ratios count,
not times. A tracker below 1 of the second had more to go by than directions.

{table}

![Time a detection against error over the bound](tracking_scene.svg)

kepler-arc, boost-profile and stereo-filter share the association of the last. kepler-arc is the paper's: a thrusting
target is on no Keplerian arc, so more detections do not help it. boost-profile knows the generic classes, of which
the target is one; stereo-filter knows that a boost is about along the velocity, and with `jerk` not even that.
FilterPy's filter is told which detections are the target's; the others find out.
"""


class Ratios(NamedTuple):
    """RMSE over the bound with the thrust known, and over that with the thrust unknown with its 95 % interval."""

    known: float
    unknown: float
    low: float
    high: float


class Line(NamedTuple):
    """What one tracker took and reached."""

    name: str
    detection_us: float
    update_us: float
    position: "Ratios"
    velocity: "Ratios"
    detections: int


def tracker_of(plan: Plan, name: str) -> Tracker:
    """Return the tracker of a line."""
    return plan.tracker if TRACKERS[name] else FilterPyTracker()


def line_of(name: str, runs: int) -> Line:
    """Return what a tracker took and reached over runs."""
    scene = scene_from_mapping({**SCENE, "tracker": TRACKERS[name] or "stereo-filter"})
    errors, seconds, detections, updates = [], 0.0, 0, 0
    for number in range(runs):
        plan = compile_plan(evolve(scene, seed=scene.seed + number))
        timed = TimedTracker(tracker_of(plan, name))
        run = run_of_plan(evolve(plan, tracker=timed))
        evidence = evidence_of_run(run, plan, timed.seconds)
        errors.append(state_errors(evidence, ownership(evidence)))
        seconds, detections, updates = (
            seconds + timed.seconds,
            detections + len(run.detections),
            updates + len(run.tracks),
        )
    run_of = np.repeat(np.arange(runs), [len(each) for each in errors])
    every = StateErrors.concatenate(errors)
    late = every.since_s >= FROM_S
    every, run_of = every.take(late), run_of[late]
    position = ratios(every.position_m, every.position_bound_m, every.position_free_bound_m, run_of)
    velocity = ratios(every.velocity_m_s, every.velocity_bound_m_s, every.velocity_free_bound_m_s, run_of)
    return Line(name, 1e6 * seconds / detections, 1e6 * seconds / max(updates, 1), position, velocity, detections)


def ratios(error: np.ndarray, known: np.ndarray, unknown: np.ndarray, run: np.ndarray) -> Ratios:
    """Return errors over bounds, with the interval over runs."""
    value, low, high = root_mean_square(error, run)
    bound = float(np.sqrt(np.mean(unknown**2)))
    return Ratios(value / float(np.sqrt(np.mean(known**2))), value / bound, low / bound, high / bound)


def lines(runs: int) -> Iterator[Line]:
    """Yield a line for each tracker; what is imported at its first use is not counted."""
    for name in TRACKERS:
        warm = scene_from_mapping({**SCENE, "duration_s": 8.0, "tracker": TRACKERS[name] or "stereo-filter"})
        plan = compile_plan(warm)
        run_of_plan(evolve(plan, tracker=tracker_of(plan, name)))
        yield line_of(name, runs)


def table_of(found: list[Line]) -> str:
    """Return the lines as a table."""
    stone = next(line.detection_us for line in found if line.name.startswith("Stone Soup EKF"))
    head = [
        (
            "| tracker, cadence | µs a detection | µs a track update | faster than Stone Soup EKF"
            " | position: known | unknown | velocity: known | unknown |"
        ),
        "|---|---|---|---|---|---|---|---|",
    ]
    rows = [
        f"| {line.name} | {line.detection_us:.1f} | {line.update_us:.0f} | {stone / line.detection_us:.1f} |"
        f" {told(line.position)} | {told(line.velocity)} |"
        for line in found
    ]
    return "\n".join([*head, *rows])


def told(ratio: Ratios) -> str:
    """Return ratios as two cells."""
    return f"{ratio.known:.2f} | {ratio.unknown:.2f} [{ratio.low:.2f}, {ratio.high:.2f}]"


def plot(found: list[Line], path: Path) -> None:
    """Draw time a detection against error over the bound with the thrust unknown."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "opir"
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 5), sharex=True)
    for number, line in enumerate(found):
        for axes, ratio in ((left, line.position.unknown), (right, line.velocity.unknown)):
            axes.loglog(line.detection_us, ratio, "osDv^<>PX*hd"[number % 12], label=line.name)
    for axes, what in ((left, "position"), (right, "velocity")):
        axes.axhline(1.0, color="grey", linewidth=0.8)
        axes.set_xlabel("µs a detection")
        axes.set_ylabel(f"{what}: RMSE / bound, thrust unknown")
        axes.grid(True, which="both", alpha=0.3)
    left.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})


def written(runs: int, folder: Path | None) -> None:
    """Run everything, print the table, and write page and plot."""
    found = list(lines(runs))
    table = table_of(found)
    print(table, flush=True)
    if folder is None:
        return
    page = PAGE.format(
        table=table,
        runs=runs,
        seconds=END_S,
        start=FROM_S,
        detections=found[0].detections,
        seeds=f"{SCENE['seed']} to {int(str(SCENE['seed'])) + runs - 1}",
    )
    (folder / "tracking_scene.md").write_text(page, encoding="utf-8")
    plot(found, folder / "tracking_scene.svg")


def main() -> None:
    """Run everything and print, or write, the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--write", type=Path)
    chosen = parser.parse_args()
    written(chosen.runs, chosen.write)


if __name__ == "__main__":
    main()
