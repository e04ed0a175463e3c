"""Every tracker on one scene: run time against error over the bound, of the core's trackers and of
peers.

    python benchmarks/work_precision/tracking_scene.py [--runs 5] [--only TRACKER ...] [--write
    FOLDER] python benchmarks/work_precision/tracking_scene.py --from-csv
    docs/benchmarks/tracking_scene.csv

The same detections for all, seed by seed, in one run. FilterPy is a filter and no tracker: it gets
the true association. One ICBM in boost, two SBIRS-GEO. Processor time of one core, of the tracker
alone. Peers that are not installed are left out. `tracking.py` runs it too.
"""

import argparse
import os
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from attrs import evolve
from filterpy_tracker import FilterPyTracker
from opir_scoring.containments import root_mean_square
from opir_scoring.errors import StateErrors, state_errors
from opir_scoring.evidence import evidence_of_run, ownership
from opir_studies.comparison import TimedTracker
from peers import installed, times_faster
from tracking_scene_page import write_csv, write_page

from opir_core.interfaces.protocols import Tracker
from opir_core.planning.plan import Plan, compile_plan
from opir_core.reading import scene_from_mapping
from opir_core.simulation.run import run_of_plan

#: Errors count from here to the end, s since ignition: from when directions of both sensors tell
#: the place.
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
    "imm, 0.2 s": {"model": "imm", "cadence_s": 0.2},
    "imm, 1 s": {"model": "imm"},
    "imm, 5 s": {"model": "imm", "cadence_s": 5.0, "slice_s": 5.0},
    "Stone Soup EKF, acceleration, 1 s": {"model": "stonesoup"},
    "Stone Soup EKF, jerk, 1 s": {"model": "stonesoup", "motion": "jerk", "noise": 0.3},
    "Stone Soup UKF, jerk, 1 s": {
        "model": "stonesoup",
        "filter": "ukf",
        "motion": "jerk",
        "noise": 0.3,
    },
    "FilterPy EKF, acceleration, true association, 1 s": None,
}


class Ratios(NamedTuple):
    """RMSE over the bound with the thrust known, and over that with the thrust unknown with its 95
    % interval.
    """

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
    return plan.make_tracker() if TRACKERS[name] else FilterPyTracker()


def line_of(name: str, runs: int) -> Line:
    """Return what a tracker took and reached over runs."""
    scene = scene_from_mapping({**SCENE, "tracker": TRACKERS[name] or "imm"})
    errors = []
    seconds = 0.0
    detections = 0
    updates = 0
    for number in range(runs):
        plan = compile_plan(evolve(scene, seed=scene.seed + number))
        timed = TimedTracker(tracker_of(plan, name))
        run = run_of_plan(evolve(plan, make_tracker=iter([timed]).__next__))
        evidence = evidence_of_run(run, plan, timed.seconds)
        errors.append(state_errors(evidence, ownership(evidence)))
        seconds = seconds + timed.seconds
        detections = detections + len(run.detections)
        updates = updates + len(run.tracks)
    run_of = np.repeat(np.arange(runs), [len(each) for each in errors])
    every = StateErrors.concatenate(errors)
    late = every.since_s >= FROM_S
    every = every.take(late)
    run_of = run_of[late]
    position = ratios(every.position_m, every.position_bound_m, every.position_free_bound_m, run_of)
    velocity = ratios(
        every.velocity_m_s, every.velocity_bound_m_s, every.velocity_free_bound_m_s, run_of
    )
    return Line(
        name,
        1e6 * seconds / detections,
        1e6 * seconds / max(updates, 1),
        position,
        velocity,
        detections,
    )


def ratios(error: np.ndarray, known: np.ndarray, unknown: np.ndarray, run: np.ndarray) -> Ratios:
    """Return errors over bounds, with the interval over runs."""
    value, low, high = root_mean_square(error, run)
    bound = float(np.sqrt(np.mean(unknown**2)))
    return Ratios(
        value / float(np.sqrt(np.mean(known**2))), value / bound, low / bound, high / bound
    )


def lines(runs: int, only: Sequence[str] = ()) -> Iterator[Line]:
    """Yield a line for each tracker; what is imported at its first use is not counted."""
    for name in installed(name for name in TRACKERS if not only or name in only):
        warm = scene_from_mapping({**SCENE, "duration_s": 8.0, "tracker": TRACKERS[name] or "imm"})
        plan = compile_plan(warm)
        run_of_plan(evolve(plan, make_tracker=partial(tracker_of, plan, name)))
        yield line_of(name, runs)


def csv_rows(found: list[Line], runs: int) -> list[dict[str, str]]:
    """Return the rows of the CSV file."""
    stone = next(
        (line.detection_us for line in found if line.name.startswith("Stone Soup EKF")), None
    )
    rows = []
    for line in found:
        row = {"tracker": line.name, "runs": str(runs), "first_seed": str(SCENE["seed"])}
        row |= {
            "duration_s": f"{END_S:g}",
            "errors_from_s": f"{FROM_S:g}",
            "detections": str(line.detections),
        }
        row |= {
            "time_per_detection_us": f"{line.detection_us:.1f}",
            "time_per_track_update_us": f"{line.update_us:.0f}",
        }
        row["speed_over_stone_soup"] = times_faster(stone, line.detection_us, 1)
        for what, ratio in (("position", line.position), ("velocity", line.velocity)):
            unknown = f"{what}_rmse_over_bound_thrust_unknown"
            row |= {
                f"{what}_rmse_over_bound_thrust_known": f"{ratio.known:.2f}",
                unknown: f"{ratio.unknown:.2f}",
            }
            row |= {
                f"{unknown}_low95": f"{ratio.low:.2f}",
                f"{unknown}_high95": f"{ratio.high:.2f}",
            }
        rows.append(row)
    return rows


def written(runs: int, folder: Path | None, only: Sequence[str] = ()) -> None:
    """Run everything, print the rows of the CSV file, and write it, the page and the plot."""
    rows = csv_rows(list(lines(runs, only)), runs)
    print("\n".join(",".join(row.values()) for row in rows), flush=True)
    if folder is None:
        return
    write_csv(folder / "tracking_scene.csv", rows)
    write_page(folder / "tracking_scene.csv")


def main() -> None:
    """Run everything and write the results, or redraw page and plot from a CSV file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument(
        "--only", nargs="+", choices=tuple(TRACKERS), default=(), help="these trackers"
    )
    parser.add_argument("--write", type=Path, help="folder for the CSV file, the page and the plot")
    parser.add_argument(
        "--from-csv", type=Path, help="redraw page and plot beside this file, and run nothing"
    )
    chosen = parser.parse_args()
    if chosen.from_csv:
        write_page(chosen.from_csv)
        return
    written(chosen.runs, chosen.write, chosen.only)


if __name__ == "__main__":
    main()
