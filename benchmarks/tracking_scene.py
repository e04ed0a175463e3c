"""Every tracker on one scene: run time against error over the bound, of opir's trackers and of
peers.

The same detections for all, seed by seed, in one run. FilterPy is a filter and no tracker: it gets
the true association. One ICBM in boost, two SBIRS-GEO. Processor time of one core, of the tracker
alone. Peers that are not installed are left out.
"""

import os
from functools import partial

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from attrs import evolve
from filterpy_tracker import FilterPyTracker
from opir_scoring.containments import root_mean_square
from opir_scoring.errors import StateErrors, state_errors
from opir_scoring.evidence import evidence_of_run, ownership
from opir_studies.comparison import TimedTracker
from pages import (
    COLOURS,
    installed,
    interval_text,
    left_out,
    markdown_table,
    options_of,
    publish,
    shown,
    svg_plot,
)

import opir_core as opir

#: Errors count from here to the end, s since ignition: from when directions of both sensors
#: determine the place.
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

#: Names of lines, and the tracker of the scene; FilterPy has none.
TRACKERS = {
    "kepler-arc, 1 s": {"model": "kepler-arc"},
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
#: Lines in the data and the plot, not in the table.
UNSHOWN = ("imm, 0.2 s", "imm, 5 s", "Stone Soup EKF, jerk, 1 s")
UNKNOWN = "rmse_over_bound_thrust_unknown"

PAGE = """# Tracking: every tracker on one scene

How accurate and how fast are opir's trackers and their peers on the same detections of one
boosting ICBM?

imm at 1 s is {faster} times faster than Stone Soup's EKF at about the same error; kepler-arc is
far from the bound.

![Time per detection against RMSE over the bound with the thrust unknown](tracking_scene.svg)

{table}
{left_out}
One ICBM in boost, two SBIRS-GEO (10 looks a second each, P_d 0.8),
{detections} detections in {runs} runs of {duration_s} s (seeds {first_seed} to {final_seed}).
Processor time of one core, of the tracker alone; ratios count, not times. Position and velocity
are RMSE over the Cramér–Rao bound with specific force and jerk in the state, from {errors_from_s}
s after ignition on, with 95 % intervals over runs ([bounds](../how-to/score-tracks.md)). A
tracker below 1 uses more than lines of sight: imm assumes a boost about along the velocity.
kepler-arc assumes a Keplerian arc, which a thrusting target does not fly. The two share one data
association; Stone Soup's trackers have their own. Raids and salvos with clutter, scored alike for
all: [tracking set](tracking_set.md).

Figures with the thrust known too: [tracking_scene.csv](tracking_scene.csv), by `--runs {runs}`.
"""
HEAD = (
    "tracker, cadence",
    "µs per detection",
    "faster than Stone Soup EKF",
    "position / bound",
    "velocity / bound",
)


def tracker_of(plan, name):
    """Return the tracker of a line."""
    return plan.make_tracker() if TRACKERS[name] else FilterPyTracker()


def scene_of(name, **changes):
    """Return the scene with the tracker of a line."""
    return opir.scene_from_mapping({**SCENE, **changes, "tracker": TRACKERS[name] or "imm"})


def row_of(name, runs):
    """Return the row of a tracker over runs."""
    scene = scene_of(name)
    errors = []
    seconds = 0.0
    detections = 0
    updates = 0
    for number in range(runs):
        plan = opir.compile_plan(evolve(scene, seed=scene.seed + number))
        timed = TimedTracker(tracker_of(plan, name))
        run = opir.run_of_plan(evolve(plan, make_tracker=iter([timed]).__next__))
        evidence = evidence_of_run(run, plan, timed.seconds)
        errors.append(state_errors(evidence, ownership(evidence)))
        seconds += timed.seconds
        detections += len(run.detections)
        updates += len(run.tracks)
    state = StateErrors.concatenate(errors)
    counted = state.since_s >= FROM_S
    run_number = np.repeat(np.arange(runs), [len(error) for error in errors])[counted]
    return {
        "tracker": name,
        "runs": runs,
        "first_seed": SCENE["seed"],
        "duration_s": END_S,
        "errors_from_s": FROM_S,
        "detections": detections,
        "time_per_detection_us": 1e6 * seconds / detections,
        "time_per_track_update_us": 1e6 * seconds / max(updates, 1),
        **ratios(state.take(counted), run_number, "position", "m"),
        **ratios(state.take(counted), run_number, "velocity", "m_s"),
    }


def ratios(state, run, name, unit):
    """Return RMSE over the bound with the thrust known, and over that with the thrust unknown with
    its interval over runs.
    """

    def rms(column):
        return float(np.sqrt(np.mean(getattr(state, f"{name}_{column}_{unit}") ** 2)))

    value, low, high = root_mean_square(getattr(state, f"{name}_{unit}"), run)
    bound = rms("free_bound")
    return {
        f"{name}_rmse_over_bound_thrust_known": value / rms("bound"),
        f"{name}_{UNKNOWN}": value / bound,
        f"{name}_{UNKNOWN}_low95": low / bound,
        f"{name}_{UNKNOWN}_high95": high / bound,
    }


def rows_of(runs, names):
    """Yield a row for each tracker; imports at its first use are not counted."""
    for name in installed(names):
        plan = opir.compile_plan(scene_of(name, duration_s=8.0))
        opir.run_of_plan(evolve(plan, make_tracker=partial(tracker_of, plan, name)))
        yield row_of(name, runs)


def page(table):
    """Return the page."""
    names = table.names("tracker")
    stone = [row for row in table if row["tracker"].startswith("Stone Soup EKF")]
    reference_us = stone[0]["time_per_detection_us"] if stone else float("nan")
    speed = {row["tracker"]: reference_us / row["time_per_detection_us"] for row in table}
    lines = [
        (
            row["tracker"],
            f"{row['time_per_detection_us']:.1f}",
            shown(speed[row["tracker"]], ".1f"),
            interval_text(row, f"position_{UNKNOWN}", ".2f"),
            interval_text(row, f"velocity_{UNKNOWN}", ".2f"),
        )
        for row in table
        if row["tracker"] not in UNSHOWN
    ]
    head_row = table[0]
    return PAGE.format(
        faster=shown(speed.get("imm, 1 s", float("nan")), ".1f"),
        table=markdown_table(HEAD, lines),
        left_out=left_out(names),
        final_seed=head_row["first_seed"] + head_row["runs"] - 1,
        **head_row,
    )


def draw(path, table):
    """Draw time per detection against error over the bound with the thrust unknown."""
    with svg_plot(path, 1, 2, figsize=(11.0, 4.8), sharex=True) as (_, axes):
        for panel, name in zip(axes, ("position", "velocity"), strict=True):
            panel.axhline(1.0, color="black", linewidth=0.8)
            value, low, high = (
                np.array(table.column(f"{name}_{UNKNOWN}{end}"), dtype=np.float64)
                for end in ("", "_low95", "_high95")
            )
            for row, label in enumerate(table.column("tracker")):
                style = {"color": COLOURS[row % len(COLOURS)], "marker": "osv"[row % 3]}
                error = [[value[row] - low[row]], [high[row] - value[row]]]
                time_us = table[row]["time_per_detection_us"]
                panel.errorbar(time_us, value[row], error, label=label, **style)
            panel.loglog()
            panel.set(xlabel="µs per detection", ylabel=f"{name} RMSE / bound, thrust unknown")


def main():
    """Measure and write."""
    options = options_of(__doc__, runs=5, only=tuple(TRACKERS))
    publish(options, page, draw, tracking_scene=rows_of(options.runs, options.only))


if __name__ == "__main__":
    main()
