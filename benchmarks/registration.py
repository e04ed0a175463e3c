"""Can the sensors be trusted? Biases, clocks, noise and outliers, stated in the scene or not.

Twelve SRBMs and IRBMs rise within six seconds in the view of two SBIRS-GEO (or three). Their lines
of sight are disturbed here, after the simulation: turned by a bias drawn for each sensor, spread by
more noise, or moved far off; clocks are set off. Held: states in their 95 % ellipsoid, every second
from 60 s after ignition to burnout. Over bound: error of position over the Cramér–Rao bound of
position and stated bias together, in the last second of each burn. Bias: squared error of the
estimated biases over its covariance, per angle. Seeds are even; odd ones were built on.
"""

import os
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from attrs import evolve
from imm_consistency import short_target
from opir_scoring import evidence_of_run, ownership
from opir_scoring.containments import proportion
from opir_scoring.errors import state_errors
from pages import interval_text, markdown_table, options_of, publish, shown
from scipy.stats import chi2

import opir_core as opir

TARGETS = 12
SETTLED_S = 60.0
DURATION_S = 100.0
SIGMA_RAD = 20e-6

PAGE = """# Registration

Can the sensors be trusted? Twelve launches before two SBIRS-GEO (20 µrad), whose lines of sight
are turned, noisier or far off, and what [`imm`](../explanation/registration.md) makes of it.

{table}

Held: states in their 95 % ellipsoid from 60 s after ignition to burnout, {runs} runs each, with
the interval of independent states; NEES/6 has a median of 0.89 if covariances are right. Over
bound: error of position in the last second of the burn over the Cramér–Rao bound of position and
stated bias together. The stated bias is 0 where nothing is stated; there errors of hundreds of
metres to kilometres remain, as two sensors do not show all of their biases, but the covariances
say so. Bias NEES: squared error of each estimated angle over its variance, 1 if right; the angles
of a run are correlated, and its {runs} runs are few. Noise found: in units of what is stated, by
sensor. All figures: [registration.csv](registration.csv).
"""
COLUMNS = {
    "median_nees_per_6": "median NEES/6",
    "median_position_m": "median error, m",
    "median_over_bound": "over bound",
    "tracks_a_launch": "tracks a launch",
    "bias_nees": "bias NEES",
}


class Case(NamedTuple):
    """Disturbances: sigmas of biases, rad, and clocks, s; noise (rad) added to a share of the looks
    or to one sensor; whether bias and clocks are stated.
    """

    bias_rad: float = 0.0
    clock_s: float = 0.0
    noise_rad: float = 0.0
    noise_share: float = 1.0
    noisy_sensor: int | None = None
    is_stated: bool = False
    sensors: int = 2


CASES = {
    "as stated": Case(),
    "60 µrad, not stated": Case(60e-6),
    "60 µrad, stated": Case(60e-6, is_stated=True),
    "60 µrad, not stated, three sensors": Case(60e-6, sensors=3),
    "clocks off by 0.12 s, stated": Case(clock_s=0.12, is_stated=True),
    "3 × noise in 30 % of the looks": Case(noise_rad=np.sqrt(8.0) * SIGMA_RAD, noise_share=0.3),
    "30 % outliers of 400 µrad": Case(noise_rad=400e-6, noise_share=0.3),
    "3 × noise of one sensor": Case(noise_rad=np.sqrt(8.0) * SIGMA_RAD, noisy_sensor=1),
}


class Outcome(NamedTuple):
    """Results of a run: held states, NEES, errors, m, ratios to the bound, tracks, mean NEES of
    biases, and noise of the sensors over the stated one.
    """

    held: np.ndarray
    nees: np.ndarray
    position_m: np.ndarray
    over_bound: np.ndarray
    tracks: int
    bias_nees: float
    noise: np.ndarray


def scene_of(seed, case, tracker):
    """Return a run's scene; what is stated of the sensors is there with a tracker."""
    rng = np.random.default_rng(seed)
    is_stated = case.is_stated and tracker["model"] != "none"
    stated = {"line_of_sight_bias_sigma_urad": 1e6 * case.bias_rad if is_stated else 0.0}
    clocks = {"clock_sigma_s": case.clock_s} if is_stated and case.clock_s else {}
    slots_deg = (-150.0, -95.0, -125.0)[: case.sensors]
    return opir.scene_from_mapping(
        {
            "scene": "registration",
            "epoch": "2026-04-01T18:00:00Z",
            "duration_s": DURATION_S,
            "seed": seed,
            "sensors": [
                {"model": "SBIRS-GEO", "id": f"S{row}", "orbital_slot_deg": slot_deg, **stated}
                for row, slot_deg in enumerate(slots_deg)
            ],
            "targets": [
                short_target(row, rng, rng.uniform(-35.0, 35.0), rng.uniform(-152.0, -92.0))
                for row in range(TARGETS)
            ],
            "tracker": {**tracker, **clocks},
        }
    )


def disturbed(detections, case, rng):
    """Return detections with the disturbances of a case, and the biases (sensors, 2), rad."""
    count = len(detections)
    bias_rad = case.bias_rad * rng.standard_normal((case.sensors, 2))
    clock_s = case.clock_s * rng.standard_normal(case.sensors)
    noisy = rng.random(count) < case.noise_share
    if case.noisy_sensor is not None:
        noisy = detections.sensor == case.noisy_sensor
    direction = detections.line_of_sight_ecef
    up = detections.sensor_ecef_m
    up = up / np.linalg.norm(up, axis=1)[:, None]
    east = np.cross([0.0, 0.0, 1.0], up)
    east /= np.linalg.norm(east, axis=1)[:, None]
    bias = bias_rad[detections.sensor]
    turn = bias[:, 1:] * east - bias[:, :1] * np.cross(up, east)
    error = np.where(noisy, case.noise_rad, 0.0)[:, None] * rng.standard_normal((count, 3))
    error -= np.sum(error * direction, axis=1)[:, None] * direction
    moved = direction + np.cross(turn, direction) + error
    late_ns = np.rint(1e9 * clock_s[detections.sensor]).astype(np.int64)
    shifted = evolve(
        detections,
        line_of_sight_ecef=moved / np.linalg.norm(moved, axis=1)[:, None],
        time_ns=np.maximum(detections.time_ns + late_ns, 0),
    )
    return shifted, bias_rad


def tracked(plan, detections):
    """Return the track of each detection, all estimates and the health of the sensors at the
    end.
    """
    tracker = plan.make_tracker()
    label = np.full(len(detections), -1)
    estimates = []
    begin = 0
    for tick in range(1, int(DURATION_S) + 1):
        end = int(np.searchsorted(detections.time_ns, tick * 1_000_000_000))
        window = detections.take(slice(begin, end))
        label[begin:end] = tracker.associate(window)
        estimates.append(tracker.step(float(tick), evolve(window, track=label[begin:end])))
        begin = end
    return label, opir.Tracks.concatenate(estimates), tracker.sensor_health()


def outcome_of(case, seed):
    """Return the results of a run."""
    run = opir.simulate(scene_of(seed, case, {"model": "none"}))
    plan = opir.compile_plan(scene_of(seed, case, {"model": "imm", "forecast": "none"}))
    detections, bias_rad = disturbed(run.detections, case, np.random.default_rng([1, seed]))
    order = np.argsort(detections.time_ns, kind="stable")
    detections = detections.take(order)
    label, tracks, health = tracked(plan, detections)
    detections = evolve(detections, track=label)
    run = evolve(run, detections=detections, truth=run.truth.take(order), tracks=tracks)
    evidence = evidence_of_run(run, plan)
    states = state_errors(evidence, ownership(evidence))
    burn_s = (plan.targets.burnout_s - plan.targets.ignition_s)[states.target]
    final = np.flatnonzero((states.since_s <= burn_s) & (states.since_s > burn_s - 1.0))
    settled = np.flatnonzero((states.since_s >= SETTLED_S) & (states.since_s <= burn_s))
    scaled = (health.bias_rad - bias_rad) / np.maximum(health.bias_sigma_rad, 1e-12)
    return Outcome(
        held=states.nees[settled] <= chi2.ppf(0.95, 6),
        nees=states.nees[settled],
        position_m=states.position_m[settled],
        over_bound=states.position_m[final] / states.position_bound_m[final],
        tracks=len(np.unique(tracks.track)),
        bias_nees=float(np.mean(scaled**2)) if bias_rad.any() else np.nan,
        noise=health.noise_scale,
    )


def row_of(name, runs):
    """Return a line of the table."""
    outcomes = [outcome_of(CASES[name], 39_000 + 2 * run) for run in range(runs)]
    held, nees, position_m, over_bound = (
        np.concatenate([getattr(outcome, column) for outcome in outcomes])
        for column in ("held", "nees", "position_m", "over_bound")
    )
    share, low, high = (100.0 * value for value in proportion(int(held.sum()), len(held)))
    noise = np.mean([outcome.noise for outcome in outcomes], axis=0)
    return {
        "case": name,
        "runs": runs,
        "states": len(held),
        "held_percent": share,
        "held_percent_low95": low,
        "held_percent_high95": high,
        "median_nees_per_6": float(np.median(nees) / 6.0),
        "median_position_m": float(np.median(position_m)),
        "median_over_bound": float(np.median(over_bound)),
        "tracks_a_launch": sum(outcome.tracks for outcome in outcomes) / (runs * TARGETS),
        "bias_nees": float(np.mean([outcome.bias_nees for outcome in outcomes])),
        "noise_found": " ".join(f"{scale:.2f}" for scale in noise),
    }


def page(table):
    """Return the page."""
    lines = [
        [
            row["case"],
            interval_text(row, "held_percent", ".1f"),
            *(shown(row[name], ".3g") for name in COLUMNS),
            row["noise_found"],
        ]
        for row in table
    ]
    head = ("sensors", "states held, %", *COLUMNS.values(), "noise found")
    return PAGE.format(table=markdown_table(head, lines), runs=table[0]["runs"])


def main():
    """Measure and write."""
    options = options_of(__doc__, runs=10, only=tuple(CASES))
    publish(options, page, registration=(row_of(name, options.runs) for name in options.only))


if __name__ == "__main__":
    main()
