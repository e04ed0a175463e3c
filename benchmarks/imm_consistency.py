"""Consistency of `imm` in whole scenes: states, launches and impacts, clear, under clouds and with
biases.

python benchmarks/imm_consistency.py [--runs 20] [--only clear] [--set key=value] [--write
docs/benchmarks]
"""

import argparse
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import yaml
from opir_scoring.containments import containment
from opir_scoring.errors import PointErrors, StateErrors, point_errors, state_errors
from opir_scoring.evidence import evidence_of_run, ownership

from opir_core.planning.plan import compile_plan
from opir_core.reading import scene_from_mapping
from opir_core.simulation.run import run_of_plan

LAUNCHES = 10
SETTLED_S = 20.0
CLOUD: Mapping[str, Any] = {
    "atmosphere": {"model": "lowtran", "cloud": {"top_km": 10.0}},
    "detection": "snr",
}
#: Names of cases, what the scene has beside the rest, the bias of its sensors, µrad, and the height
#: of the sites, m.
CASES: dict[str, tuple[Mapping[str, Any], float, float]] = {
    "clear": ({}, 0.0, 0.0),
    "sites at 1.5 km": ({}, 0.0, 1500.0),
    "cloud deck to 10 km": (CLOUD, 0.0, 0.0),
    "pointing biases of 3σ": ({}, 60.0, 0.0),
}

HEAD = (
    "| case | tracked | state NEES | position, m | energy, m | velocity, m/s | energy, m/s"
    " | launch in ellipse | NEES | median error, m"
    " | impact in ellipse | NEES | median error, km | launch time, s |"
)

PAGE = """# Consistency of `imm`

Are the covariances of `imm` consistent in whole scenes? States are conservative. The 95 % regions of launch points and
impacts hold the truth about as often as they say, or more often.

{table}

*NEES* is over its degrees of freedom, with the 99 % interval of the mean over targets: 1 is consistent, above 1 is
overconfident. *In ellipse*: share of truths inside the 95 % ellipse, with its 95 % interval. *Position*, *velocity*:
RMSE; *energy*: their mean energy scores. *Launch time*: median error. {runs} runs a case of ten distant SRBMs and
IRBMs, two SBIRS-GEO (10 looks a second each, P_d 0.6 and 0.72), unknown association. States count every second from
20 s after the first detection to burnout, launches and impacts by each track's last estimate.

It is conservative because the boost model allows other boosts. What a deck of cloud hides for half a minute is dated by
the law of boosts, whose first stages rise a little slower in the mean than these. With biases, each line of sight
counts with noise and bias together, although a constant bias shifts the position, not the velocity.
"""


class Case(NamedTuple):
    """What came of a case's targets: rows of states with the number of their target, and points."""

    states: StateErrors
    whose: np.ndarray
    points: PointErrors
    launches: int


def scene_of(seed: int, case: str, tracker: Mapping[str, Any]) -> Any:
    """Return one run's scene."""
    rng = np.random.default_rng(1000 + seed)
    more, bias_urad, height_m = CASES[case]
    sensors = [
        {
            "model": "SBIRS-GEO",
            "id": name,
            "orbital_slot_deg": slot,
            "line_of_sight_bias_sigma_urad": bias_urad,
        }
        for name, slot in (("WEST", -150.0), ("EAST", -95.0))
    ]
    return scene_from_mapping(
        {
            "scene": "honesty",
            "epoch": "2026-04-01T18:00:00Z",
            "duration_s": 150.0,
            "seed": 100 + seed,
            "sensors": sensors,
            "targets": [_target(number, rng, height_m) for number in range(LAUNCHES)],
            "tracker": {"model": "imm", **tracker},
            **more,
        }
    )


def _target(number: int, rng: np.random.Generator, height_m: float) -> Mapping[str, Any]:
    kind = ("SRBM", "IRBM")[number % 2]
    latitude = -30.0 + 6.0 * number
    longitude = -145.0 + 11.0 * (number % 3)
    reach_deg = rng.uniform(3.0, 4.5) if kind == "SRBM" else rng.uniform(18.0, 28.0)
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    launch = {
        "lat_deg": latitude,
        "lon_deg": longitude,
        "height_m": height_m,
        "time_s": float(rng.uniform(2.0, 8.0)),
    }
    aim = {
        "lat_deg": float(latitude + reach_deg * np.cos(azimuth)),
        "lon_deg": float(longitude + reach_deg * np.sin(azimuth) / np.cos(np.radians(latitude))),
    }
    return {"id": f"T{number}", "type": kind, "launch": launch, "aim": aim}


def case_of(case: str, runs: int, tracker: Mapping[str, Any]) -> Case:
    """Return what came of a case's runs."""
    states = []
    whose = []
    points = []
    for seed in range(runs):
        plan = compile_plan(scene_of(seed, case, tracker))
        evidence = evidence_of_run(run_of_plan(plan), plan)
        owners = ownership(evidence)
        found = state_errors(evidence, owners)
        found = found.take(np.flatnonzero(found.seen_s >= SETTLED_S))
        states.append(found)
        whose.append(found.target + LAUNCHES * seed)
        points.append(point_errors(evidence, owners))
    return Case(
        StateErrors.concatenate(states),
        np.concatenate(whose),
        PointErrors.concatenate(points),
        LAUNCHES * runs,
    )


def lines_of(name: str, case: Case) -> Iterator[str]:
    """Yield a case's line of the table."""
    ratio = case.states.nees / 6.0
    each = np.array([ratio[case.whose == target].mean() for target in np.unique(case.whose)])
    points = case.points
    cells = [name, f"{len(each)} of {case.launches}", _mean(each), _rms(case.states.position_m)]
    cells += [f"{case.states.position_energy_m.mean():.0f}", _rms(case.states.velocity_m_s, 1)]
    cells.append(f"{case.states.velocity_energy_m_s.mean():.1f}")
    for square, error, unit in (
        (points.launch_nees, points.launch_m, 1.0),
        (points.impact_nees, points.impact_m, 1e-3),
    ):
        known = np.isfinite(square)
        share = containment(square[known], 2, 0.95)
        cells += [f"{100.0 * share[0]:.1f} % [{100.0 * share[1]:.1f}, {100.0 * share[2]:.1f}]"]
        cells += [
            _mean(square[known] / 2.0),
            f"{unit * np.median(error[known]):.{0 if unit == 1.0 else 1}f}",
        ]
    cells.append(f"{np.nanmedian(points.launch_time_s):+.2f}")
    yield "| " + " | ".join(cells) + " |"


def _mean(values: np.ndarray) -> str:
    wide = 2.576 * values.std(ddof=1) / np.sqrt(len(values))
    return f"{values.mean():.2f} ± {wide:.2f}"


def _rms(values: np.ndarray, digits: int = 0) -> str:
    return f"{np.sqrt(np.mean(values**2)):.{digits}f}"


def main() -> None:
    """Run the cases and print, or write, the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--only", choices=tuple(CASES))
    parser.add_argument("--set", action="append", default=[], help="of the tracker, KEY=VALUE")
    parser.add_argument("--write", type=Path)
    chosen = parser.parse_args()
    tracker = yaml.safe_load("\n".join(word.replace("=", ": ", 1) for word in chosen.set)) or {}
    rows = [HEAD, "|" + HEAD.count(" | ") * "---|" + "---|"]
    for name in [chosen.only] if chosen.only else CASES:
        rows += lines_of(name, case_of(name, chosen.runs, tracker))
        print(rows[-1], flush=True)
    if chosen.write:
        page = PAGE.format(runs=chosen.runs, table="\n".join(rows))
        (chosen.write / "imm_consistency.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
