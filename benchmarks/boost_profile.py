"""Error over the bound, consistency and containment of boost-profile on flights drawn from its own priors.

    python benchmarks/boost_profile.py [--runs 150] [--batches 4] [--again 2] [--only SRBM] [--parts FOLDER]
                                       [--write FOLDER]
    python benchmarks/boost_profile.py --from-csv docs/benchmarks/boost_profile.csv

The fit gets each flight's detections and its class; data association is not part of it. The page states the times, the
bounds and the statistics (`boost_profile_page.py`).
"""

import argparse
import json
import os
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
from boost_profile_flights import PARTS, SENSORS, inverse, measured
from boost_profile_page import EFFICIENT, HELD, LEAST_P, TIMES, write_page
from result_files import write_csv

from opir_core.scene.scene import TARGET_TYPES
from opir_core.scoring.consistency import consistency, containment


def van_trees(sums: dict[str, Any]) -> dict[str, float]:
    """Return the bounds, squared, of position, velocity and impact, of the information and slopes averaged."""
    spread = inverse(np.array(sums["information"])[None])[0] * sums["count"]
    found = {}
    for name, part in PARTS.items():
        slopes = np.array(sums["slopes"])[part] / sums["landed" if name == "impact" else "count"]
        found[name] = float(np.trace(slopes @ spread @ slopes.T))
    return found


class Line(NamedTuple):
    """A row of the CSV file, its mark, and whether any of its figures is in doubt."""

    row: dict[str, str]
    mark: int
    is_doubted: bool


def drawn(count: int, samples: int) -> np.ndarray:
    """Return bootstrap samples (samples, count) of flights, of a fixed stream."""
    return np.random.default_rng(1).integers(0, count, (samples, count))


def ratios(rows: list[dict[str, float]], name: str, bound: float) -> tuple[dict[str, str], float]:
    """Return the RMSE over the bound (given squared) and over the expected bound, with 95 % intervals, and the last."""
    square = np.array([[row[name], row[f"{name} at the truth"]] for row in rows])
    square = square[np.isfinite(square).all(axis=1)]
    sampled, whole = square[drawn(len(square), 1000)].mean(axis=1), square.mean(axis=0)
    cells = {}
    for what, over in (
        ("bound", lambda means: np.sqrt(means[..., 0] / bound)),
        ("expected", lambda means: np.sqrt(means[..., 0] / means[..., 1])),
    ):
        low, high = np.quantile(over(sampled), (0.025, 0.975))
        column = f"{name}_rmse_over_{what}"
        cells |= {column: f"{over(whole):.2f}", f"{column}_low95": f"{low:.2f}", f"{column}_high95": f"{high:.2f}"}
    return cells, float(np.sqrt(whole[0] / whole[1]))


def anees(values: np.ndarray, rescaled: np.ndarray) -> tuple[dict[str, str], bool]:
    """Return ANEES of values (n,) over six with its interval, the same rescaled, and p; and whether it is in doubt."""
    found, over = consistency(rescaled, 6), values / 6.0
    low, high = np.quantile(over[drawn(len(over), 4000)].mean(axis=1), (0.005, 0.995))
    is_apart = not low <= 1.0 <= high
    cells = {
        "anees_over_6": f"{over.mean():.2f}",
        "anees_over_6_low99": f"{low:.2f}",
        "anees_over_6_high99": f"{high:.2f}",
        "anees_interval_excludes_1": str(int(is_apart)),
        "rescaled_anees_over_6": f"{found.mean / 6.0:.2f}",
        "rescaled_anees_outside_band99": str(int(not found.is_inside)),
        "ks_p": f"{found.p_value:.4f}",
    }
    return cells, is_apart or not found.is_inside or found.p_value < LEAST_P


def contained(impact: np.ndarray) -> tuple[dict[str, str], float]:
    """Return shares of impacts, by their NEES (n,), in the 50, 90 and 95 % ellipses, the last with limits; the last."""
    found = [containment(impact, 2, nominal) for nominal in (0.5, 0.9, 0.95)]
    names = [f"impacts_in_{nominal}_ellipse_percent" for nominal in (50, 90, 95)]
    names += [f"{names[-1]}_low95", f"{names[-1]}_high95"]
    shares = [100.0 * share for share in (*(each[0] for each in found), *found[-1][1:])]
    return {name: f"{share:.0f}" for name, share in zip(names, shares, strict=True)}, shares[2]


def cells(kind: str, model: str, sensors: int, part: dict[str, Any]) -> Iterator[Line]:
    """Yield the rows of the CSV file of a class and sensors, a mark each."""
    for mark, when in enumerate(TIMES):
        mine = [row for row in part["rows"] if row["mark"] == mark]
        if len(mine) < 2:
            continue
        consistent, is_doubted = anees(*(np.array([row[each] for row in mine]) for each in ("nees", "told nees")))
        inside, share = contained(np.array([row["impact nees"] for row in mine]))
        bound = van_trees(part["sums"][str(mark)])
        errors, over = {}, []
        for name, unit, scale, digits in (
            ("position", "m", 1.0, 0),
            ("velocity", "m_s", 1.0, 1),
            ("impact", "km", 1e-3, 1),
        ):
            rmse = scale * np.sqrt(np.nanmean([row[name] for row in mine]))
            found, last = ratios(mine, name, bound[name])
            errors |= {f"{name}_rmse_{unit}": f"{rmse:.{digits}f}", **found}
            over.append(last)
        is_doubted |= (mark > 0 and max(over) > EFFICIENT) or not HELD[0] <= share <= HELD[1]
        head = {"class": kind, "sensors": str(sensors), "sensor_model": model, "time": when, "flights": str(len(mine))}
        yield Line({**head, **errors, **consistent, **inside}, mark, is_doubted)


def main() -> None:
    """Measure what is asked for and write the results, or redraw page and plot from a CSV file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=150, help="flights of a batch, flown together")
    parser.add_argument("--batches", type=int, default=1, help="so many batches, with seeds from the first on")
    parser.add_argument("--again", type=int, default=0, help="batches of other flights to repeat doubtful cells with")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=TARGET_TYPES)
    parser.add_argument("--parts", type=Path, help="folder in which finished parts are kept and looked for")
    parser.add_argument("--finished", action="store_true", help="show what is in that folder, and measure nothing")
    parser.add_argument(
        "--write", type=Path, help="folder for boost_profile.csv, boost_profile.md and boost_profile.svg"
    )
    parser.add_argument("--from-csv", type=Path, help="redraw page and plot beside this file, and measure nothing")
    chosen = parser.parse_args()
    if chosen.from_csv:
        write_page(chosen.from_csv, band_of)
        return
    rows = list(rows_of(chosen))
    if chosen.write and rows:
        write_csv(chosen.write / "boost_profile.csv", rows)
        write_page(chosen.write / "boost_profile.csv", band_of)


def band_of(flights: int) -> tuple[float, float]:
    """Return the 99 % band of ANEES / 6 of so many flights."""
    band = consistency(np.ones(flights), 6)
    return band.lower / 6, band.upper / 6


def rows_of(chosen: argparse.Namespace) -> Iterator[dict[str, str]]:
    """Yield the rows of the CSV file, printed as well: of every cell, and of other flights of doubtful cells."""
    cases = [(s, m, k) for s, m, k in product((2, 1), SENSORS, TARGET_TYPES[::-1]) if chosen.only in (None, k)]
    doubted: dict[tuple[int, str, str], set[int]] = {}
    for sample, batches in (("first", chosen.batches), ("repeat", chosen.again)):
        for sensors, model, kind in cases:
            marks = doubted.get((sensors, model, kind), set())
            if not batches or (sample == "repeat" and not marks):
                continue
            seeds = seeds_of(chosen, is_again=sample == "repeat")
            for line in cells(kind, model, sensors, batches_of(kind, model, sensors, seeds, chosen)):
                if sample == "repeat" and line.mark not in marks:
                    continue
                if sample == "first" and line.is_doubted:
                    doubted.setdefault((sensors, model, kind), set()).add(line.mark)
                row = {"sample": sample, "batch_size": str(chosen.runs), "batches": str(batches), **line.row}
                print(",".join(row.values()), flush=True)
                yield row


def seeds_of(chosen: argparse.Namespace, *, is_again: bool = False) -> range:
    """Return the seeds of the batches of all cells, or of those behind them, with which cells in doubt are told."""
    first = chosen.seed + chosen.batches * is_again
    return range(first, first + (chosen.again if is_again else chosen.batches))


def batches_of(kind: str, model: str, sensors: int, seeds: range, chosen: argparse.Namespace) -> dict[str, Any]:
    """Return what came of batches of one class and sensors."""
    return joined([part_of(kind, model, sensors, seed, chosen) for seed in seeds])


def part_of(kind: str, model: str, sensors: int, seed: int, chosen: argparse.Namespace) -> Any:
    """Return what came of a batch of one class and sensors, measured or read."""
    path = chosen.parts / f"{kind}-{model}-{sensors}-{chosen.runs}-{seed}.json" if chosen.parts else None
    if path and path.exists():
        return json.loads(path.read_text(encoding="utf-8"))
    if chosen.finished:
        return {"rows": [], "sums": {}}
    part = measured(kind, model, sensors, chosen.runs, seed).told()
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(part), encoding="utf-8")
    return part


def joined(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what came of several batches as one."""
    whole: dict[str, Any] = {"rows": [row for part in parts for row in part["rows"]], "sums": {}}
    for part in parts:
        for mark, fresh in part["sums"].items():
            kept = whole["sums"].get(mark, dict.fromkeys(fresh, 0.0))
            whole["sums"][mark] = {name: np.asarray(kept[name]) + np.asarray(fresh[name]) for name in fresh}
    return whole


if __name__ == "__main__":
    main()
