"""boost-profile where its assumptions do not hold, compared with stereo-filter on the same detections.

    python benchmarks/robustness.py [--runs 100] [--only SRBM] [--case staged] [--parts FOLDER] [--write FOLDER]
    python benchmarks/robustness.py --from-csv docs/benchmarks/robustness.csv

Up to 100 targets at a time, hundreds of kilometres apart, are observed by two SBIRS-GEO sensors or by one. The whole
tracker runs: data association, track initiation, fit, and the stereo filter that the fit is mixed with. Type reports
are UNKNOWN. Burn time, burnout speed and turn are drawn from the priors; `tests/support/off_model_flights.py` defines
the trajectories. The track of a target is the one that holds most of its detections.
"""

import argparse
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
from off_model_flights import Flown, away_from, flown
from opir_trackers.configs import BoostProfileConfig
from result_files import write_csv
from robustness_page import write_page
from tracked_flights import CHANCES, SIGMA_RAD, USUAL_CONFIG, followed, rows_of, sensors_of, usual

from opir_core.flight.forces import Drag, Forces
from opir_core.interfaces.records import Tracks
from opir_core.scene.scene import TARGET_TYPES
from opir_core.scoring.consistency import containment, nees, on_normal_scale

#: The tracker's gate, standard deviations; from geostationary orbit the Earth is so wide, rad.
GATE, DISC_RAD = 4.5, 0.15

#: J2 and drag, with a notional ballistic coefficient, kg/m².
FORCES = Forces(("j2",), Drag(5000.0))

#: Flights of a batch.
BATCH = 100

#: Marks at which flights are looked at: shares of the burn, and seconds after it.
SHARES, AFTER_S = (0.5, 0.95), (5.0, 20.0)
MARKS = ("50 % of burn", "95 % of burn", "5 s after burnout", "20 s after burnout")
TRACKERS = ("boost-profile", "stereo-filter")


class Case(NamedTuple):
    """What is unlike the assumptions: the course, what the sensors do, and the forces on the truth and the tracker's.

    `told_bias_rad` is what sensors say of their bias, `config` what is set of boost-profile. Of `sensors` there are two
    but where one alone sees.
    """

    words: str
    course: str = "family"
    seeing: tuple[tuple[str, Any], ...] = ()
    told_bias_rad: float = 0.0
    flies: Any = "kepler"
    believes: Any = "kepler"
    config: BoostProfileConfig = USUAL_CONFIG
    sensors: int = 2


_BIAS = 3.0 * SIGMA_RAD
_NEAR = (("outliers", 0.3), ("astray_rad", GATE * SIGMA_RAD))
_FIELD = (("outliers", 0.3), ("astray_rad", DISC_RAD), ("everywhere", True))
_ASKED = BoostProfileConfig(impacts_in_burn=True)
CASES = {
    "family": Case("boost family"),
    "staged": Case("staged boosts", "staged"),
    "tabulated": Case("tabulated boosts", "tabulated"),
    "forces": Case("J2 and drag, modelled", flies=FORCES, believes=FORCES),
    "forces-unknown": Case("J2 and drag, not modelled", flies=FORCES),
    "bias": Case("bias 3σ, stated", seeing=(("bias_rad", _BIAS),), told_bias_rad=_BIAS),
    "bias-untold": Case("bias 3σ, not stated", seeing=(("bias_rad", _BIAS),)),
    "rare": Case("P_d 0.3", seeing=(("chance", 0.3),)),
    "outliers-near": Case("30 % outliers in the gate", seeing=_NEAR),
    "outliers-field": Case("30 % outliers over the Earth disc", seeing=_FIELD),
    "dead": Case("one sensor fails at half the burn", seeing=(("dies", 0.5),)),
    "family-alone": Case("boost family, one sensor", sensors=1),
    "staged-alone": Case("staged boosts, one sensor", "staged", sensors=1),
    "tabulated-alone": Case("tabulated boosts, one sensor", "tabulated", sensors=1),
    "family-asked": Case("boost family, impacts in burn", config=_ASKED),
    "staged-asked": Case("staged boosts, impacts in burn", "staged", config=_ASKED),
    "tabulated-asked": Case("tabulated boosts, impacts in burn", "tabulated", config=_ASKED),
}

#: Names of the cases on the page.
LABELS = {name: case.words for name, case in CASES.items()}


def marks_at(truth: Flown, tick_s: float) -> np.ndarray:
    """Return which mark (n,) each flight passes at a tick, -1 for none."""
    found = np.full(len(truth), -1)
    shares = [truth.start_s + share * truth.burn_s for share in SHARES]
    for mark, at in enumerate([*shares, *(truth.burnout_s + after_s for after_s in AFTER_S)]):
        found[(at > tick_s - 1.0) & (at <= tick_s)] = mark
    return found


def measured(kind: str, case: Case, count: int, seed: int) -> list[dict[str, Any]]:
    """Return the figures of flights of a type, a row for each mark, flight and tracker."""
    truth = flown(kind, count, seed, case.course)
    seeing = usual(kind)._replace(**dict(case.seeing))
    said = dict.fromkeys(TARGET_TYPES, seeing.chance) if "chance" in dict(case.seeing) else CHANCES
    sensors = sensors_of(said, case.told_bias_rad)[: case.sensors]
    landed, rows = truth.impacts(case.flies), []
    until_s = truth.burnout_s.max() + AFTER_S[-1] + 1.0

    def asked(tick_s: float) -> np.ndarray:
        return np.flatnonzero(marks_at(truth, tick_s) >= 0)

    for tick in followed(truth, seeing, seed, until_s, sensors, case.believes, asked=asked, config=case.config):
        marks = marks_at(truth, tick.time_s)
        flights = np.flatnonzero(marks >= 0)
        if not len(flights):
            continue
        state = truth.take(flights).states(tick.time_s, case.flies)
        for name, tracks in zip(TRACKERS, (tick.told, tick.filtered), strict=True):
            found = figures(tracks, rows_of(tracks, tick.shared)[flights], state, landed[flights])
            for place, flight in enumerate(flights.tolist()):
                row = {"mark": int(marks[flight]), "flight": flight, "tracker": name}
                rows.append({**row, **{figure: float(values[place]) for figure, values in found.items()}})
    return rows


def figures(tracks: Tracks, row: np.ndarray, state: np.ndarray, landed: np.ndarray) -> dict[str, np.ndarray]:
    """Return squared errors and NEES (n,) of flights' tracks, by row; nan of what is not told."""
    known = row >= 0
    found = {name: np.full(len(row), np.nan) for name in ("position", "velocity", "impact", "nees", "impact nees")}
    mine = tracks.take(row[known])
    error, away = mine.state - state[known], away_from(mine.impact, landed[known])
    found["position"][known] = np.sum(error[:, :3] ** 2, axis=1)
    found["velocity"][known] = np.sum(error[:, 3:] ** 2, axis=1)
    found["impact"][known] = np.sum(away**2, axis=1)
    found["nees"][known] = nees(error, mine.state_covariance)
    found["impact nees"][known] = on_normal_scale(nees(away, mine.impact_covariance[:, :2, :2]), mine.impact_sigmas)
    return found


def summary(name: str, kind: str, rows: list[dict[str, Any]]) -> Iterator[dict[str, str]]:
    """Yield the rows of the CSV file of a case and class, one for each mark."""
    flights = str(len({row["flight"] for row in rows}))
    for mark, when in enumerate(MARKS):
        ours, theirs = (
            {row["flight"]: row for row in rows if row["mark"] == mark and row["tracker"] == tracker}
            for tracker in TRACKERS
        )
        if len(ours) < 2:
            continue
        both = {
            figure: np.array([[ours[key][figure], theirs[key][figure]] for key in ours], dtype=np.float64)
            for figure in ("position", "velocity", "impact", "nees", "impact nees")
        }
        tracked, reported = (100.0 * np.isfinite(both[each][:, 0]).mean() for each in ("position", "impact"))
        of_impact = both["impact nees"]
        yield {
            "case": name,
            "sensors": str(CASES[name].sensors),
            "class": kind,
            "time": when,
            "flights": flights,
            "tracked_percent": f"{tracked:.0f}",
            "impact_reported_percent": f"{reported:.0f}",
            **against(both["position"], "position", "m", 1.0, 0),
            **against(both["velocity"], "velocity", "m_s", 1.0, 1),
            **against(both["impact"], "impact", "km", 1e3, 1),
            **anees(both["nees"][:, 0], ""),
            **anees(both["nees"][:, 1], "stereo_filter_"),
            **contained(of_impact[:, 0], "", (0.5, 0.9, 0.95)),
            **contained(of_impact[:, 1], "stereo_filter_", (0.95,)),
        }


def against(square: np.ndarray, name: str, unit: str, scale: float, digits: int) -> dict[str, str]:
    """Return the RMSE of (n, 2) squared errors of both trackers, and its ratio to the other's with its interval."""
    ratio = f"{name}_rmse_ratio"
    found = dict.fromkeys((f"{name}_rmse_{unit}", ratio, f"{ratio}_low95", f"{ratio}_high95"), "")
    own = square[np.isfinite(square[:, 0]), 0]
    if len(own) >= _LEAST:
        found[f"{name}_rmse_{unit}"] = f"{np.sqrt(own.mean()) / scale:.{digits}f}"
    square = square[np.isfinite(square).all(axis=1)]
    if len(square) < _LEAST:
        return found
    drawn = np.random.default_rng(1).integers(0, len(square), (1000, len(square)))
    sums = square[drawn].sum(axis=1)
    low, high = np.quantile(np.sqrt(sums[:, 0] / sums[:, 1]), (0.025, 0.975))
    whole = np.sqrt(square[:, 0].sum() / square[:, 1].sum())
    return found | {ratio: f"{whole:.2f}", f"{ratio}_low95": f"{low:.2f}", f"{ratio}_high95": f"{high:.2f}"}


#: Figures of fewer flights are left empty.
_LEAST = 20


def anees(values: np.ndarray, whose: str) -> dict[str, str]:
    """Return the average NEES over its degrees of freedom, and the median over that of chi-square."""
    known = values[np.isfinite(values)]
    figures = (known.mean() / 6.0, np.median(known) / 5.348) if len(known) >= _LEAST else ()
    names = (f"{whose}anees_over_6", f"{whose}median_nees_over_chi2_median")
    return dict.fromkeys(names, "") | {name: f"{value:.2f}" for name, value in zip(names, figures, strict=False)}


def contained(values: np.ndarray, whose: str, nominal: tuple[float, ...]) -> dict[str, str]:
    """Return shares of ellipses that contain the true impact, %, the last one with its interval."""
    names = [f"{whose}impacts_in_{100.0 * each:.0f}_ellipse_percent" for each in nominal]
    names += [f"{names[-1]}_low95", f"{names[-1]}_high95"]
    if np.count_nonzero(np.isfinite(values)) < _LEAST:
        return dict.fromkeys(names, "")
    shares = [containment(values, 2, each) for each in nominal]
    figures = [each[0] for each in shares] + list(shares[-1][1:])
    return {name: f"{100.0 * value:.0f}" for name, value in zip(names, figures, strict=True)}


def main() -> None:
    """Measure what is asked for and write the results, or redraw page and plot from a CSV file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=TARGET_TYPES)
    parser.add_argument("--case", choices=CASES)
    parser.add_argument("--parts", type=Path, help="folder in which finished parts are kept and looked for")
    parser.add_argument("--finished", action="store_true", help="show what is in that folder, and measure nothing")
    parser.add_argument("--write", type=Path, help="folder for robustness.csv, robustness.md and robustness.svg")
    parser.add_argument("--from-csv", type=Path, help="redraw page and plot beside this file, and measure nothing")
    chosen = parser.parse_args()
    if chosen.from_csv:
        write_page(chosen.from_csv, LABELS)
        return
    found = [row for name in CASES if chosen.case in (None, name) for row in case_rows(name, chosen)]
    if chosen.write and found:
        write_csv(chosen.write / "robustness.csv", found)
        write_page(chosen.write / "robustness.csv", LABELS)


def case_rows(name: str, chosen: argparse.Namespace) -> list[dict[str, str]]:
    """Return the rows of the CSV file of a case, and print them."""
    table: list[dict[str, str]] = []
    every = []
    for kind in TARGET_TYPES[::-1]:
        if chosen.only in (None, kind):
            rows = rows_measured(kind, name, chosen)
            table += summary(name, kind, rows)
            every += [{**row, "flight": f"{kind} {row['flight']}"} for row in rows]
    if chosen.only is None:
        table += summary(name, "all", every)
    for row in table:
        print(",".join(row.values()), flush=True)
    return table


def batches(chosen: argparse.Namespace) -> Iterator[tuple[int, int]]:
    """Yield seeds and sizes of the batches of the runs asked for."""
    for number in range(-(-chosen.runs // BATCH)):
        yield chosen.seed + number, min(BATCH, chosen.runs - number * BATCH)


def rows_measured(kind: str, name: str, chosen: argparse.Namespace) -> list[dict[str, Any]]:
    """Return the rows of a case and class, measured or read, with flights numbered through the batches."""
    rows = []
    for seed, count in batches(chosen):
        path = chosen.parts / f"{kind}-{name}-{seed}-{count}.json" if chosen.parts else None
        if path and path.exists():
            part = json.loads(path.read_text(encoding="utf-8"))
        elif chosen.finished:
            continue
        else:
            part = measured(kind, CASES[name], count, seed)
            if path:
                path.write_text(json.dumps(part), encoding="utf-8")
        rows += [{**row, "flight": row["flight"] + BATCH * seed} for row in part]
    return rows


if __name__ == "__main__":
    main()
