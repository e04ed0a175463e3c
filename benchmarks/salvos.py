"""How far apart must launches be for `imm` to tell them apart? Salvos of ten, two sensors, by spacing.

    python benchmarks/salvos.py [--runs 10] [--spacings 0.5 1.5 5] [--write docs/benchmarks]

Ten staged gravity turns of one class rise within ten seconds from a field of launch points, the nearest `spacing`
apart, towards aims as far apart, seen by two SBIRS-GEO at default settings. When the first of them is at 95 % of the
time from ignition to the last burnout, tracks are assigned to launches, one to one, with the least sum of distances:
does the 95 % ellipsoid of its track hold a launch's state, and how far off is the track? Labels are the tracks of
detections in the second half of a burn: wrong where most detections of the track are of another launch. Seeds are those
on which nothing was built.
"""

import argparse
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from opir_scoring import RunEvidence, energy_scores, evidence_of_run, ownership
from opir_scoring.containments import proportion
from opir_scoring.evidence import true_states_ecef
from result_files import BLUE, ORANGE, number, read_csv, svg_plot, write_csv
from scipy.optimize import linear_sum_assignment

import opir_core as opir

LAUNCHES = 10
SPACINGS_KM = (0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0)
#: The share of a burn at which tracks are compared with the truth, and the 95 % quantile of chi-squared with 6 degrees.
MARK, WITHIN = 0.95, 12.592
#: The 95 % quantile of chi-squared with 3 degrees: of positions alone.
WITHIN_PLACE = 7.815
FIRST_SEED = 24_000
KM_PER_DEGREE = 111.2
#: A spacing at which tracks are as of single launches.
FAR_KM = 10.0
#: Ends of the names of a share and of its interval.
ENDS = ("", "_low95", "_high95")


class Salvo(NamedTuple):
    """What became of the launches of one run, and the wrong labels of all labels.

    Which launches have a track, which tracks hold the state, their errors, m, the largest semi-axes of the 95 %
    ellipsoids of position, m, and the energy scores of position, m.
    """

    is_tracked: np.ndarray
    is_held: np.ndarray
    error_m: np.ndarray
    semi_axis_m: np.ndarray
    energy_m: np.ndarray
    wrong: int
    labels: int


def field(count: int, spacing_km: float, rng: np.random.Generator) -> np.ndarray:
    """Return points (count, 2), km east and north: a random part of a hexagonal grid of step `spacing_km`."""
    across = np.arange(4)
    grid = np.array([(x + 0.5 * (y % 2), y * np.sqrt(0.75)) for y in across for x in across])
    turn = rng.uniform(0.0, 2.0 * np.pi)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    chosen = np.sort(rng.choice(len(grid), count, replace=False))
    return spacing_km * grid[chosen] @ rotation


def scene_of(spacing_km: float, seed: int) -> opir.Scene:
    """Return a scene with a salvo."""
    rng = np.random.default_rng([seed, round(1e3 * spacing_km)])
    lat_deg, lon_deg = rng.uniform(20.0, 50.0), rng.uniform(-150.0, 150.0)
    shift = field(LAUNCHES, spacing_km, rng) / KM_PER_DEGREE
    times_s = 10.0 + rng.uniform(0.0, 10.0, LAUNCHES)
    targets = [
        {
            "id": f"T{row}",
            "model": "gravity-turn",
            "type": "IRBM",
            "launch": {
                "lat_deg": float(lat_deg + north),
                "lon_deg": float(lon_deg + east / np.cos(np.radians(lat_deg))),
                "time_s": float(times_s[row]),
            },
            "aim": {
                "lat_deg": float(lat_deg - 15.0 + north),
                "lon_deg": float(lon_deg + 15.0 + east / np.cos(np.radians(lat_deg - 15.0))),
            },
        }
        for row, (east, north) in enumerate(shift.tolist())
    ]
    slots = [(lon_deg + away + 540.0) % 360.0 - 180.0 for away in (-35.0, 30.0)]
    sensors = [{"model": "SBIRS-GEO", "id": f"S{row}", "orbital_slot_deg": slot} for row, slot in enumerate(slots)]
    return opir.scene_from_mapping(
        {
            "scene": "salvo",
            "epoch": "2026-04-01T18:00:00Z",
            "duration_s": 260.0,
            "seed": seed,
            "sensors": sensors,
            "targets": targets,
            "tracker": {"model": "imm", "regions_every_s": 600.0},
        }
    )


def salvo(spacing_km: float, seed: int) -> Salvo:
    """Return what became of a salvo."""
    evidence = evidence_of_run(run := opir.simulate(scene_of(spacing_km, seed)), run.plan)
    return Salvo(*states_at_mark(evidence), *labels(evidence))


def states_at_mark(evidence: RunEvidence) -> tuple[np.ndarray, ...]:
    """Return the first five parts of a `Salvo`."""
    targets, owners, tracks = evidence.plan.targets, ownership(evidence), evidence.tracks
    mark_s = np.min(targets.ignition_s + MARK * (targets.burnout_s - targets.ignition_s))
    tick_s = tracks.tick_s[np.argmin(np.abs(tracks.tick_s - mark_s))]
    now = tracks.take(np.flatnonzero(tracks.tick_s == tick_s))
    numbers = np.arange(LAUNCHES, dtype=np.int32)
    truth = true_states_ecef(evidence.plan, numbers, np.full(LAUNCHES, tick_s))
    distance_m = np.linalg.norm(truth[:, None, :3] - now.state[None, :, :3], axis=2)
    held, error_m, semi_axis_m, energy_m = np.zeros(LAUNCHES, bool), *np.full((3, LAUNCHES), np.nan)
    for launch, row in zip(*linear_sum_assignment(distance_m), strict=True):
        away, covariance = now.state[row] - truth[launch], now.state_covariance[row]
        error_m[launch] = distance_m[launch, row]
        held[launch] = away @ np.linalg.solve(covariance, away) <= WITHIN
        radii = now.state_sigmas[row : row + 1]
        energy_m[launch] = energy_scores(away[None], covariance[None], radii, slice(0, 3))[0]
        semi_axis_m[launch] = np.sqrt(WITHIN_PLACE * np.linalg.eigvalsh(covariance[:3, :3])[-1])
    return np.isin(numbers, owners.target[np.isin(owners.track, now.track)]), held, error_m, semi_axis_m, energy_m


def labels(evidence: RunEvidence) -> tuple[int, int]:
    """Return how many detections of the second half of a burn are on another launch's track, and how many there are."""
    targets, owners = evidence.plan.targets, ownership(evidence)
    target = evidence.target
    half_s = 0.5 * (targets.ignition_s + targets.burnout_s)
    late = (target >= 0) & (evidence.track >= 0) & (evidence.time_s > half_s[np.maximum(target, 0)])
    owner = owners.target[np.searchsorted(owners.track, evidence.track[late])]
    return int(np.count_nonzero(owner != target[late])), int(np.count_nonzero(late))


def rows_of(spacings_km: Sequence[float], runs: int) -> Iterator[dict[str, str]]:
    """Yield a row of figures for each spacing."""
    for spacing_km in spacings_km:
        found = [salvo(spacing_km, FIRST_SEED + run) for run in range(runs)]
        row = {"spacing_km": f"{spacing_km:g}", "launches": str(LAUNCHES * runs)}
        shares = {
            "tracked": np.concatenate([each.is_tracked for each in found]),
            "held": np.concatenate([each.is_held for each in found]),
        }
        for name, values in shares.items():
            figures = proportion(int(np.count_nonzero(values)), len(values))
            row |= {f"{name}{end}": f"{100.0 * figure:.0f}" for end, figure in zip(ENDS, figures, strict=True)}
        for name, values in (
            ("median_error_m", np.concatenate([each.error_m for each in found])),
            ("median_semi_axis_m", np.concatenate([each.semi_axis_m for each in found])),
        ):
            row[name] = f"{np.nanmedian(values):.0f}" if np.isfinite(values).any() else ""
        row["mean_energy_m"] = f"{np.nanmean(np.concatenate([each.energy_m for each in found])):.0f}"
        row["wrong_labels"] = (
            f"{100.0 * sum(each.wrong for each in found) / max(sum(each.labels for each in found), 1):.1f}"
        )
        print(row, flush=True)
        yield row


def page(rows: Sequence[dict[str, str]]) -> str:
    """Return the page."""
    near, far = rows[0], next((row for row in rows if number(row["spacing_km"]) >= FAR_KM), rows[-1])
    least, most = (extreme((row["held"] for row in rows), key=number) for extreme in (min, max))
    return f"""# Salvos

How far apart must launches be for `imm` to separate them, and do its covariances show when it cannot? {LAUNCHES}
launches of one class within ten seconds, on a hexagonal grid, seen by two SBIRS-GEO at default settings.

![Share of launches whose track holds the true state, and wrong labels, against spacing](salvos.svg)

From {far["spacing_km"]} km on tracks are as of single launches: median error of position {far["median_error_m"]} m,
{far["wrong_labels"]} % of the detections on a track of another launch. At {near["spacing_km"]} km these are
{near["median_error_m"]} m and {near["wrong_labels"]} %; {least} to {most} % of the 95 % ellipsoids still contain the
state, at every spacing. The mean energy score of position is {near["mean_energy_m"]} and {far["mean_energy_m"]} m.

From 37 000 km, 20 µrad of noise is 0.7 km. Closer than some 5 km, detections are assigned to the wrong launch, and
lines of sight of different targets nearly meet (ghosts). Such tracks are off by a kilometre or more, but
[their ellipsoids are wide](../explanation/association.md#neighbours), until the targets move apart.

At {MARK:.0%} of the first burn, {rows[0]["launches"]} launches a spacing; states are those of the tracks assigned to
the launches, one to one, by least distance. All figures with intervals: [salvos.csv](salvos.csv).
"""


def plot(rows: Sequence[dict[str, str]], path: Path) -> None:
    """Draw the shares against the spacing."""
    with svg_plot(path, figsize=(6.4, 3.6)) as (_, axes):
        spacing = [number(row["spacing_km"]) for row in rows]
        for name, colour, label in (
            ("held", BLUE, "state in its 95 % ellipsoid"),
            ("wrong_labels", ORANGE, "wrong labels"),
        ):
            axes.plot(spacing, [number(row[name]) for row in rows], "o-", color=colour, label=label)
        low, high = ([number(row[f"held_{edge}95"]) for row in rows] for edge in ("low", "high"))
        axes.fill_between(spacing, low, high, color=BLUE, alpha=0.2, linewidth=0)
        axes.set(xscale="log", xlabel="spacing, km", ylabel="share, %", ylim=(0, 100))
        axes.legend()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--spacings", type=float, nargs="+", default=SPACINGS_KM)
    parser.add_argument("--write", type=Path, help="folder for the page, the plot and the data")
    parser.add_argument("--from-csv", type=Path, help="folder with the data of an earlier run")
    arguments = parser.parse_args()
    folder = arguments.from_csv or arguments.write
    rows = read_csv(folder / "salvos.csv") if arguments.from_csv else list(rows_of(arguments.spacings, arguments.runs))
    if folder is not None:
        write_csv(folder / "salvos.csv", rows)
        (folder / "salvos.md").write_text(page(rows), encoding="utf-8")
        plot(rows, folder / "salvos.svg")


if __name__ == "__main__":
    main()
