"""Consistency of `imm` in whole scenes: states, launches and impacts, clear, under clouds and with
biases. `--set KEY=VALUE` are settings of the tracker.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import yaml
from opir_scoring.containments import containment
from opir_scoring.errors import PointErrors, StateErrors, point_errors, state_errors
from opir_scoring.evidence import evidence_of_run, ownership
from pages import markdown_table, options_of

import opir_core as opir

LAUNCHES = 10
SETTLED_S = 20.0
CLOUD: Mapping[str, Any] = {
    "atmosphere": {"model": "lowtran", "cloud": {"top_km": 10.0}},
    "detection": "snr",
}


class Case(NamedTuple):
    """Settings of the scene beside the rest, bias of its sensors, µrad, height of the sites, m."""

    settings: Mapping[str, Any] = {}
    bias_urad: float = 0.0
    height_m: float = 0.0


CASES = {
    "clear": Case(),
    "sites at 1.5 km": Case(height_m=1500.0),
    "cloud deck to 10 km": Case(CLOUD),
    "pointing biases of 3σ": Case(bias_urad=60.0),
}

PAGE = """# Consistency of `imm`

Are the covariances of `imm` consistent in whole scenes? States are conservative. The 95 % regions
of launch points and impacts hold the truth about as often as they say, or more often.

{table}

*NEES* is over its degrees of freedom, with the 99 % interval of the mean over targets: 1 is
consistent, above 1 is overconfident. *In ellipse*: share of truths inside the 95 % ellipse, with
its 95 % interval. *Position*, *velocity*: RMSE; *energy*: their mean energy scores. *Launch time*:
median error. {runs} runs a case of ten distant SRBMs and IRBMs, two SBIRS-GEO (10 looks a second
each, P_d 0.6 and 0.72), unknown association. States count every second from 20 s after the first
detection to burnout, launches and impacts by each track's last estimate.

It is conservative because the boost model allows other boosts. What a deck of cloud hides for half
a minute is dated by the law of boosts, whose first stages rise a little slower in the mean than
these. With biases, each line of sight counts with noise and bias together, although a constant
bias shifts the position, not the velocity.
"""
HEAD = (
    *("case", "tracked", "state NEES", "position, m", "energy, m", "velocity, m/s", "energy, m/s"),
    *("launch in ellipse", "NEES", "median error, m"),
    *("impact in ellipse", "NEES", "median error, km", "launch time, s"),
)


def scene_of(seed, case, tracker):
    """Return one run's scene."""
    rng = np.random.default_rng(1000 + seed)
    sensor = {"model": "SBIRS-GEO", "line_of_sight_bias_sigma_urad": case.bias_urad}
    return opir.scene_from_mapping(
        {
            "scene": "honesty",
            "epoch": "2026-04-01T18:00:00Z",
            "duration_s": 150.0,
            "seed": 100 + seed,
            "sensors": [
                {**sensor, "id": "WEST", "orbital_slot_deg": -150.0},
                {**sensor, "id": "EAST", "orbital_slot_deg": -95.0},
            ],
            "targets": [
                short_target(
                    number, rng, -30.0 + 6.0 * number, -145.0 + 11.0 * (number % 3), case.height_m
                )
                for number in range(LAUNCHES)
            ],
            "tracker": {"model": "imm", **tracker},
            **case.settings,
        }
    )


def short_target(number, rng, lat_deg, lon_deg, height_m=0.0):
    """Return an SRBM or IRBM from a place, in a random direction at 2 to 8 s."""
    kind = ("SRBM", "IRBM")[number % 2]
    reach_deg = rng.uniform(3.0, 4.5) if kind == "SRBM" else rng.uniform(18.0, 28.0)
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    launch = {
        "lat_deg": lat_deg,
        "lon_deg": lon_deg,
        "height_m": height_m,
        "time_s": float(rng.uniform(2.0, 8.0)),
    }
    aim = {
        "lat_deg": float(lat_deg + reach_deg * np.cos(azimuth)),
        "lon_deg": float(lon_deg + reach_deg * np.sin(azimuth) / np.cos(np.radians(lat_deg))),
    }
    return {"id": f"T{number}", "type": kind, "launch": launch, "aim": aim}


def line_of(name, runs, tracker):
    """Return a case's line of the table."""
    states = []
    targets = []
    points = []
    for seed in range(runs):
        plan = opir.compile_plan(scene_of(seed, CASES[name], tracker))
        evidence = evidence_of_run(opir.run_of_plan(plan), plan)
        owners = ownership(evidence)
        errors = state_errors(evidence, owners)
        errors = errors.take(np.flatnonzero(errors.seen_s >= SETTLED_S))
        states.append(errors)
        targets.append(errors.target + LAUNCHES * seed)
        points.append(point_errors(evidence, owners))
    return cells(name, runs, StateErrors.concatenate(states), np.concatenate(targets), points)


def cells(name, runs, state, target, points):
    """Return the cells of a case's line; `target` (n,) numbers the targets of states."""
    point = PointErrors.concatenate(points)
    nees = np.array([state.nees[target == number].mean() / 6.0 for number in np.unique(target)])
    line = [name, f"{len(nees)} of {LAUNCHES * runs}", mean_text(nees)]
    line += [
        f"{np.sqrt(np.mean(state.position_m**2)):.0f}",
        f"{state.position_energy_m.mean():.0f}",
    ]
    line.append(f"{np.sqrt(np.mean(state.velocity_m_s**2)):.1f}")
    line.append(f"{state.velocity_energy_m_s.mean():.1f}")
    for square, error in (
        (point.launch_nees, point.launch_m),
        (point.impact_nees, point.impact_m / 1e3),
    ):
        known = np.isfinite(square)
        share, low, high = (100.0 * value for value in containment(square[known], 2, 0.95))
        line += [f"{share:.1f} % [{low:.1f}, {high:.1f}]", mean_text(square[known] / 2.0)]
        line.append(f"{np.median(error[known]):.4g}")
    return [*line, f"{np.nanmedian(point.launch_time_s):+.2f}"]


def mean_text(values):
    """Return a mean with its 99 % interval."""
    half = 2.576 * values.std(ddof=1) / np.sqrt(len(values))
    return f"{values.mean():.2f} ± {half:.2f}"


def main():
    """Run the cases and print, or write, the table."""
    options = options_of(__doc__, runs=20, only=tuple(CASES), set="")
    tracker = yaml.safe_load(options.set.replace("=", ": ", 1)) or {}
    lines = []
    for name in options.only:
        lines.append(line_of(name, options.runs, tracker))
        print(*lines[-1], sep=", ", flush=True)
    if options.write:
        text = PAGE.format(runs=options.runs, table=markdown_table(HEAD, lines))
        Path(options.write, "imm_consistency.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
