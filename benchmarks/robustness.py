"""boost-profile where its assumptions fail, beside stereo-filter on the same detections.

    python benchmarks/robustness.py [--runs 100] [--only SRBM] [--case staged] [--parts FOLDER] [--write FOLDER]

Up to a hundred flights at a time, hundreds of kilometres from each other, are seen by two SBIRS-GEO, or by one, and
tracked by the whole tracker: association, initiation, fit, and the filter that the fit is mixed with. The type is not
told. Burn time, burnout speed and turn are drawn from the priors; `tests/support/other_flights.py` has the courses. A
flight's track is the one with most of its detections. Both trackers' errors are of the same runs.
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
from followed_flights import CHANCES, SIGMA_RAD, USUAL_CONFIG, followed, rows_of, sensors_of, usual
from opir_trackers.configs import BoostProfileConfig
from other_flights import Flown, away_from, flown

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
MARKS = ("50 %", "95 %", "5 s after", "20 s after")
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
    "family": Case("its own family"),
    "staged": Case("stages, two (ICBM: three), with gaps", "staged"),
    "tabulated": Case("a table unlike the family: thrust sags, turn overshoots, heading swerves", "tabulated"),
    "forces": Case("J2 and drag, known", flies=FORCES, believes=FORCES),
    "forces-unknown": Case("J2 and drag, the tracker on kepler", flies=FORCES),
    "bias": Case("biases of 3σ, told", seeing=(("bias_rad", _BIAS),), told_bias_rad=_BIAS),
    "bias-untold": Case("biases of 3σ, not told", seeing=(("bias_rad", _BIAS),)),
    "rare": Case("P_d 0.3", seeing=(("chance", 0.3),)),
    "outliers-near": Case("30 % outliers, evenly within the gate", seeing=_NEAR),
    "outliers-field": Case("30 % outliers, evenly over the Earth", seeing=_FIELD),
    "dead": Case("one sensor dies at half the burn", seeing=(("dies", 0.5),)),
    "family-alone": Case("its own family, one sensor", sensors=1),
    "staged-alone": Case("stages, one sensor", "staged", sensors=1),
    "tabulated-alone": Case("that table, one sensor", "tabulated", sensors=1),
    "family-asked": Case("its own family, impacts asked for while targets burn", config=_ASKED),
    "staged-asked": Case("stages, impacts asked for while targets burn", "staged", config=_ASKED),
    "tabulated-asked": Case("that table, impacts asked for while targets burn", "tabulated", config=_ASKED),
}


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


_COLUMNS = (
    "class",
    "mark",
    "tracked, told, %",
    "position, m (over filter's)",
    "velocity, m/s (over filter's)",
    "impact, km (over filter's)",
    "ANEES / 6",
    "filter's",
    "impact held, 50 / 90 / 95 % of runs",
    "filter's, 95 %",
)
HEAD = [f"| {' | '.join(_COLUMNS)} |", "|" + "---|" * len(_COLUMNS)]


def lines(kind: str, rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of a case's table of a class, a mark each."""
    for mark, name in enumerate(MARKS):
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
        tracked, told = (100.0 * np.isfinite(both[each][:, 0]).mean() for each in ("position", "impact"))
        yield (
            f"| {kind} | {name} | {tracked:.0f}, {told:.0f} | {against(both['position'], 1.0, 0)} "
            f"| {against(both['velocity'], 1.0, 1)} | {against(both['impact'], 1e3, 1)} "
            f"| {anees(both['nees'][:, 0])} | {anees(both['nees'][:, 1])} | {held(both['impact nees'][:, 0])} "
            f"| {held(both['impact nees'][:, 1], (0.95,))} |"
        )


def against(square: np.ndarray, unit: float, digits: int) -> str:
    """Return the RMSE of (n, 2) squared errors of both trackers, and over the other's with its bootstrap interval."""
    own = square[np.isfinite(square[:, 0]), 0]
    if len(own) < _LEAST:
        return "–"
    whole = f"{np.sqrt(own.mean()) / unit:.{digits}f}"
    square = square[np.isfinite(square).all(axis=1)]
    if len(square) < _LEAST:
        return whole
    drawn = np.random.default_rng(1).integers(0, len(square), (1000, len(square)))
    sums = square[drawn].sum(axis=1)
    low, high = np.quantile(np.sqrt(sums[:, 0] / sums[:, 1]), (0.025, 0.975))
    ratio = np.sqrt(square[:, 0].sum() / square[:, 1].sum())
    return f"{whole} ({ratio:.2f}: {low:.2f}–{high:.2f})"


#: Fewer runs in which something is told are no sample of it.
_LEAST = 20


def anees(values: np.ndarray) -> str:
    """Return the average NEES over its degrees of freedom, and behind it the median over that of chi-square."""
    known = values[np.isfinite(values)]
    return f"{known.mean() / 6.0:.2f}, {np.median(known) / 5.348:.2f}" if len(known) >= _LEAST else "–"


def held(values: np.ndarray, nominal: tuple[float, ...] = (0.5, 0.9, 0.95)) -> str:
    """Return shares of ellipses that hold the truth, %, the last one with its interval."""
    if np.count_nonzero(np.isfinite(values)) < _LEAST:
        return "–"
    shares = [containment(values, 2, each) for each in nominal]
    _, low, high = shares[-1]
    return f"{' / '.join(f'{100.0 * each[0]:.0f}' for each in shares)} ({100.0 * low:.0f}–{100.0 * high:.0f})"


PAGE = """# boost-profile where its assumptions fail

Made by `python benchmarks/robustness.py --runs {runs} --write docs/benchmarks`. {docstring}

The filter's figures are those of [stereo-filter](../explanation/association.md) on the same detections and the same
association; ratios are of RMSE over the runs in which both tell something, with their 95 % intervals (bootstrap).
"Tracked, told" are the shares of flights that have a track, and of which an impact is told: once they are taken for
burnt out, but in the last tables, in which it is asked for sooner (`impacts_in_burn`). ANEES is of the state, over
its six degrees of freedom, and behind it the median over that of χ², which single wild runs do not move. Containment
is of the ellipses that are told, that of 95 % with its 95 % interval (Wilson). A dash stands for fewer than 20 runs.
The type is not told, and each counts as likely as the others: what a tracker states can be right of all of them
together ("all"), not of each alone.

{tables}
"""


def main() -> None:
    """Measure what is asked for, or read what was measured, and print or write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=TARGET_TYPES)
    parser.add_argument("--case", choices=CASES)
    parser.add_argument("--parts", type=Path, help="folder in which finished parts are kept and looked for")
    parser.add_argument("--finished", action="store_true", help="show what is in that folder, and measure nothing")
    parser.add_argument("--write", type=Path)
    chosen = parser.parse_args()
    tables = []
    for name, case in CASES.items():
        if chosen.case not in (None, name):
            continue
        table, runs, every = [], [], []
        for kind in TARGET_TYPES[::-1]:
            if chosen.only in (None, kind):
                rows = rows_measured(kind, name, chosen)
                table += list(lines(kind, rows))
                runs.append(f"{kind} {len({row['flight'] for row in rows})}")
                every += [{**row, "flight": f"{kind} {row['flight']}"} for row in rows]
        if chosen.only is None:
            table += list(lines("all", every))
        if table:
            head = [f"## {case.words[0].upper()}{case.words[1:]}", "", f"Runs: {', '.join(runs)}.", ""]
            tables.append("\n".join([*head, *HEAD, *table]))
            print(tables[-1], flush=True)
    if chosen.write:
        docstring = (__doc__ or "").split("\n\n")[2].replace("\n", " ").strip()
        page = PAGE.format(docstring=docstring, runs=chosen.runs, tables="\n\n".join(tables))
        (chosen.write / "robustness.md").write_text(page, encoding="utf-8")


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
