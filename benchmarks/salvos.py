"""Does `imm` separate the launches of a salvo? Twenty launches from a small field, two or three
sensors.

    python benchmarks/salvos.py [--runs 10] [--halves 0.5 1.5 5] [--sensors 2] [--parallel] [--write
    docs/benchmarks]

Twenty staged gravity turns of one class rise within ten seconds from a square of ± `half` km,
towards aims that fan out by ± 8°, or with `--parallel` lie as the launch points do. When a launch
is at 95 % of the time from ignition to the last burnout, tracks are assigned to the launches that
burn, one to one, with the least sum of distances: how far off is its track, and does the 95 %
ellipsoid hold its state? It is paired right if most detections of its track in the 20 s before are
of the same launch in every sensor. Labels are the tracks of detections in the second half of a
burn: wrong where most detections of the track are of another launch. `oracle` is the share that is
wrong where each scan is assigned with the true directions, one to one: targets closer than the
error of a look cannot be resolved. Nothing was tuned on these seeds.
"""

import argparse
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from opir_scoring import RunEvidence, evidence_of_run, ownership
from opir_scoring.containments import proportion
from opir_scoring.evidence import true_states_ecef
from result_files import BLUE, ORANGE, number, read_csv, svg_plot, write_csv
from scipy.optimize import linear_sum_assignment

import opir_core as opir
from opir_core.interfaces.records import Detections

LAUNCHES = 20
HALVES_KM = (0.5, 1.5, 5.0)
SECONDS = 10.0
FAN_DEG = 8.0
#: Where sensors are, relative to the launches, degrees of longitude.
SLOTS_DEG = (-35.0, 30.0, -5.0)
#: The share of a burn at which tracks are compared with the truth, and the 95 % quantile of
#: chi-squared with 6 degrees.
MARK = 0.95
WITHIN = 12.592
#: The time before the mark over which pairings are judged, s.
LATELY_S = 20.0
FIRST_SEED = 24_000
KM_PER_DEGREE = 111.2
#: Time that light takes from a launch to a sensor, s, about.
LIGHT_S = 0.125
#: Ends of the names of a share and of its interval.
ENDS = ("", "_low95", "_high95")


class Salvo(NamedTuple):
    """What became of the launches of one run: errors, m, which are held and paired right, and
    labels.

    `wrong` and `labels` count detections of the second half of burns; `oracle` is the share that
    true directions leave wrong; `tracks` are those at the first mark.
    """

    error_m: np.ndarray
    is_held: np.ndarray
    is_paired: np.ndarray
    wrong: int
    labels: int
    oracle: float
    tracks: int


def scene_of(half_km: float, seed: int, sensors: int, fan_deg: float) -> opir.Scene:
    """Return a scene with a salvo."""
    rng = np.random.default_rng([seed, round(1e3 * half_km)])
    lat_deg = rng.uniform(20.0, 50.0)
    lon_deg = rng.uniform(-150.0, 150.0)
    shift = rng.uniform(-half_km, half_km, (LAUNCHES, 2)) / KM_PER_DEGREE
    times_s = 10.0 + rng.uniform(0.0, SECONDS, LAUNCHES)
    aims = shift + rng.uniform(-fan_deg, fan_deg, (LAUNCHES, 2))
    targets = [
        {
            "id": f"T{row}",
            "model": "gravity-turn",
            "type": "IRBM",
            "launch": {
                "lat_deg": float(lat_deg + shift[row, 1]),
                "lon_deg": float(lon_deg + shift[row, 0] / np.cos(np.radians(lat_deg))),
                "time_s": float(times_s[row]),
            },
            "aim": {
                "lat_deg": float(lat_deg - 15.0 + aims[row, 1]),
                "lon_deg": float(
                    lon_deg + 15.0 + aims[row, 0] / np.cos(np.radians(lat_deg - 15.0))
                ),
            },
        }
        for row in range(LAUNCHES)
    ]
    slots = [(lon_deg + away + 540.0) % 360.0 - 180.0 for away in SLOTS_DEG[:sensors]]
    return opir.scene_from_mapping(
        {
            "scene": "salvo",
            "epoch": "2026-04-01T18:00:00Z",
            "duration_s": 125.0,
            "seed": seed,
            "sensors": [
                {"model": "SBIRS-GEO", "id": f"S{row}", "orbital_slot_deg": slot}
                for row, slot in enumerate(slots)
            ],
            "targets": targets,
            "tracker": {"model": "imm", "regions_every_s": 600.0},
        }
    )


def salvo(half_km: float, seed: int, sensors: int, fan_deg: float) -> Salvo:
    """Return what became of a salvo."""
    evidence = evidence_of_run(
        run := opir.simulate(scene_of(half_km, seed, sensors, fan_deg)), run.plan
    )
    states = at_marks(evidence, run.detections.sensor, sensors)
    return Salvo(*states[:3], *labels(evidence), oracle(evidence, run.detections), states[3])


def at_marks(
    evidence: RunEvidence, sensor: np.ndarray, sensors: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Return errors, m, which launches are held, which are paired right, and the number of tracks
    at the first mark.
    """
    targets = evidence.plan.targets
    tracks = evidence.tracks
    mark_s = np.rint(targets.ignition_s + MARK * (targets.burnout_s - targets.ignition_s))
    error_m = np.full(LAUNCHES, np.nan)
    held = np.zeros(LAUNCHES, bool)
    paired = np.zeros(LAUNCHES, bool)
    for tick_s in np.unique(mark_s):
        now = tracks.take(np.flatnonzero(tracks.tick_s == tick_s))
        burning = np.flatnonzero(
            (targets.ignition_s < tick_s - 5.0) & (targets.burnout_s > tick_s - LATELY_S)
        )
        truth = true_states_ecef(
            evidence.plan, burning.astype(np.int32), np.full(len(burning), tick_s)
        )
        distance_m = np.nan_to_num(
            np.linalg.norm(truth[:, None, :3] - now.state[None, :, :3], axis=2), nan=1e9
        )
        for place, row in zip(*linear_sum_assignment(distance_m), strict=True):
            launch = burning[place]
            if mark_s[launch] == tick_s:
                away = now.state[row] - truth[place]
                error_m[launch] = distance_m[place, row]
                held[launch] = away @ np.linalg.solve(now.state_covariance[row], away) <= WITHIN
                paired[launch] = is_paired(evidence, sensor, sensors, int(now.track[row]), tick_s)
    return error_m, held, paired, int(np.count_nonzero(tracks.tick_s == mark_s.min()))


def is_paired(
    evidence: RunEvidence, sensor: np.ndarray, sensors: int, track: int, tick_s: float
) -> bool:
    """Return whether most of a track's recent detections are of one launch in every sensor."""
    lately = (
        (evidence.track == track)
        & (evidence.time_s > tick_s - LATELY_S)
        & (evidence.time_s <= tick_s)
    )
    lately &= evidence.target >= 0
    seen = [evidence.target[lately & (sensor == one)] for one in range(sensors)]
    return (
        all(len(each) for each in seen)
        and len({int(np.bincount(each).argmax()) for each in seen}) == 1
    )


def oracle(evidence: RunEvidence, detections: Detections) -> float:
    """Return the share of wrong labels in the second half of burns where scans are assigned by the
    true directions.
    """
    targets = evidence.plan.targets
    wrong = 0
    total = 0
    half_s = 0.5 * (targets.ignition_s + targets.burnout_s)
    for sensor in np.unique(detections.sensor):
        mine = np.flatnonzero((detections.sensor == sensor) & (evidence.target >= 0))
        for scan in np.unique(detections.scan[mine])[::7]:
            rows = mine[detections.scan[mine] == scan]
            time_s = float(detections.time_s[rows[0]]) - LIGHT_S
            there = np.flatnonzero(targets.ignition_s < time_s).astype(np.int32)
            off = (
                targets.position_ecef_m(there, np.full(len(there), time_s))
                - detections.sensor_ecef_m[rows[0]]
            )
            off /= np.linalg.norm(off, axis=1)[:, None]
            apart = np.sum((detections.line_of_sight_ecef[rows][:, None] - off) ** 2, axis=2)
            look, place = linear_sum_assignment(np.nan_to_num(apart, nan=1.0))
            truth = evidence.target[rows[look]]
            late = time_s > half_s[truth]
            wrong = wrong + np.count_nonzero((there[place] != truth) & late)
            total = total + np.count_nonzero(late)
    return wrong / max(total, 1)


def labels(evidence: RunEvidence) -> tuple[int, int]:
    """Return how many detections of the second half of a burn are on another launch's track, and
    how many there are.
    """
    targets = evidence.plan.targets
    owners = ownership(evidence)
    target = evidence.target
    half_s = 0.5 * (targets.ignition_s + targets.burnout_s)
    late = (target >= 0) & (evidence.track >= 0) & (evidence.time_s > half_s[np.maximum(target, 0)])
    owner = owners.target[np.searchsorted(owners.track, evidence.track[late])]
    return int(np.count_nonzero(owner != target[late])), int(np.count_nonzero(late))


def rows_of(
    halves_km: Sequence[float], runs: int, sensors: int, fan_deg: float
) -> Iterator[dict[str, str]]:
    """Yield a row of figures for each size of the field."""
    for half_km in halves_km:
        found = [salvo(half_km, FIRST_SEED + 2 * run, sensors, fan_deg) for run in range(runs)]
        row = {"half_km": f"{half_km:g}", "sensors": str(sensors), "launches": str(LAUNCHES * runs)}
        for name, values in (
            ("held", np.concatenate([each.is_held for each in found])),
            ("paired", np.concatenate([each.is_paired for each in found])),
        ):
            figures = proportion(int(np.count_nonzero(values)), len(values))
            row |= {
                f"{name}{end}": f"{100.0 * figure:.0f}"
                for end, figure in zip(ENDS, figures, strict=True)
            }
        row["median_error_m"] = (
            f"{np.nanmedian(np.concatenate([each.error_m for each in found])):.0f}"
        )
        row["wrong_labels"] = (
            f"{100.0 * sum(each.wrong for each in found) / max(sum(each.labels for each in found), 1):.1f}"
        )
        row["oracle"] = f"{100.0 * np.mean([each.oracle for each in found]):.1f}"
        row["tracks"] = f"{np.mean([each.tracks for each in found]):.1f}"
        print(row, flush=True)
        yield row


def page(rows: Sequence[dict[str, str]]) -> str:
    """Return the page."""
    lines = "\n".join(
        f"| ± {row['half_km']} km | {row['median_error_m']} m | {row['held']} % | {row['paired']} %"
        f" |"
        f" {row['wrong_labels']} % | {row['oracle']} % |"
        for row in rows
    )
    return f"""# Salvos

Does `imm` separate the launches of a salvo, and do its covariances show when it cannot? {LAUNCHES} launches of one
class within ten seconds, aims that fan out by ± 8°, {rows[0]["sensors"]} SBIRS-GEO at default settings.

![Share of launches whose track holds the true state, and wrong labels, by size of the field](salvos.svg)

| field | median error | state held | paired right | wrong labels | with true directions |
|---|---|---|---|---|---|
{lines}

At {MARK:.0%} of the burn, {rows[0]["launches"]} launches a row. *Paired right*: most detections in the last
{LATELY_S:.0f} s are of the same launch in every sensor. *Wrong labels*: of the second half of burns; the last column is
what remains if each scan is assigned with the true directions: targets closer than the error of a look, 0.7 km for
20 µrad from 37 000 km, cannot be resolved.
[How detections become tracks](../explanation/association.md). All figures with intervals: [salvos.csv](salvos.csv).
"""


def plot(rows: Sequence[dict[str, str]], path: Path) -> None:
    """Draw the shares against the size of the field."""
    with svg_plot(path, figsize=(6.4, 3.6)) as (_, axes):
        half = [number(row["half_km"]) for row in rows]
        for name, colour, label in (
            ("held", BLUE, "state in its 95 % ellipsoid"),
            ("wrong_labels", ORANGE, "wrong labels"),
        ):
            axes.plot(half, [number(row[name]) for row in rows], "o-", color=colour, label=label)
        low, high = ([number(row[f"held_{edge}95"]) for row in rows] for edge in ("low", "high"))
        axes.fill_between(half, low, high, color=BLUE, alpha=0.2, linewidth=0)
        axes.set(
            xscale="log", xlabel="half the side of the field, km", ylabel="share, %", ylim=(0, 100)
        )
        axes.legend()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--halves", type=float, nargs="+", default=HALVES_KM)
    parser.add_argument("--sensors", type=int, default=2, choices=(2, 3))
    parser.add_argument(
        "--parallel", action="store_true", help="aims that lie as the launch points do"
    )
    parser.add_argument("--write", type=Path, help="folder for the page, the plot and the data")
    parser.add_argument("--from-csv", type=Path, help="folder with the data of an earlier run")
    arguments = parser.parse_args()
    folder = arguments.from_csv or arguments.write
    fan_deg = 0.0 if arguments.parallel else FAN_DEG
    fresh = rows_of(arguments.halves, arguments.runs, arguments.sensors, fan_deg)
    rows = read_csv(folder / "salvos.csv") if arguments.from_csv else list(fresh)
    if folder is not None:
        write_csv(folder / "salvos.csv", rows)
        (folder / "salvos.md").write_text(page(rows), encoding="utf-8")
        plot(rows, folder / "salvos.svg")


if __name__ == "__main__":
    main()
