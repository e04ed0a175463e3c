"""Does `imm` separate the launches of a salvo? Twenty launches from a small field, two or three
sensors.

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

import os
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from opir_scoring import evidence_of_run, ownership
from opir_scoring.containments import proportion
from opir_scoring.evidence import true_states_ecef
from pages import COLOURS, markdown_table, options_of, publish, svg_plot
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2

import opir_core as opir

LAUNCHES = 20
#: Positions of sensors, relative to the launches, degrees of longitude.
SLOTS_DEG = (-35.0, 30.0, -5.0)
#: The share of a burn at which tracks are compared with the truth.
MARK = 0.95
#: The time before the mark over which pairings are judged, s.
PAIRED_S = 20.0

PAGE = """# Salvos

Does `imm` separate the launches of a salvo, and do its covariances show when it cannot? {launches}
launches of one class within ten seconds, aims that fan out by ± 8°, {sensors} SBIRS-GEO at default
settings.

![Share of held states, and wrong labels, by size of the field](salvos.svg)

{table}

At {mark:.0%} of the burn, {count} launches a row. *Paired right*: most detections in the last
{paired:.0f} s are of the same launch in every sensor. *Wrong labels*: of the second half of
burns; the last column is what remains if each scan is assigned with the true directions: targets
closer than the error of a look, 0.7 km for 20 µrad from 37 000 km, cannot be resolved. [How
detections become tracks](../explanation/association.md). All figures with intervals:
[salvos.csv](salvos.csv).
"""
HEAD = (
    "field",
    "median error",
    "state held",
    "paired right",
    "wrong labels",
    "with true directions",
)


class Salvo(NamedTuple):
    """Results of one run: errors (launches,), m, held and correctly paired ones; counts of labels
    in the second half of burns, and of wrong ones; the share that true directions leave wrong;
    tracks at the first mark.
    """

    error_m: np.ndarray
    held: np.ndarray
    paired: np.ndarray
    tracks: int
    wrong: int
    labels: int
    oracle: float


def scene_of(half_km, seed, sensors, fan_deg):
    """Return a scene with a salvo."""
    rng = np.random.default_rng([seed, round(1e3 * half_km)])
    lat_deg = rng.uniform(20.0, 50.0)
    lon_deg = rng.uniform(-150.0, 150.0)
    launch_deg = rng.uniform(-half_km, half_km, (LAUNCHES, 2)) / 111.2
    times_s = rng.uniform(10.0, 20.0, LAUNCHES).tolist()
    aim_deg = launch_deg + rng.uniform(-fan_deg, fan_deg, (LAUNCHES, 2))

    def place(lat, lon, shift):
        east, north = shift.tolist()
        return {"lat_deg": lat + north, "lon_deg": lon + east / np.cos(np.radians(lat))}

    targets = [
        {
            "id": f"T{row}",
            "model": "gravity-turn",
            "type": "IRBM",
            "launch": {**place(lat_deg, lon_deg, launch_deg[row]), "time_s": times_s[row]},
            "aim": place(lat_deg - 15.0, lon_deg + 15.0, aim_deg[row]),
        }
        for row in range(LAUNCHES)
    ]
    slots_deg = [(lon_deg + slot_deg + 540.0) % 360.0 - 180.0 for slot_deg in SLOTS_DEG[:sensors]]
    return opir.scene_from_mapping(
        {
            "scene": "salvo",
            "epoch": "2026-04-01T18:00:00Z",
            "duration_s": 125.0,
            "seed": seed,
            "sensors": [
                {"model": "SBIRS-GEO", "id": f"S{row}", "orbital_slot_deg": slot_deg}
                for row, slot_deg in enumerate(slots_deg)
            ],
            "targets": targets,
            "tracker": {"model": "imm", "forecast": "none"},
        }
    )


def salvo(half_km, seed, sensors, fan_deg):
    """Return the results of a salvo."""
    run = opir.simulate(scene_of(half_km, seed, sensors, fan_deg))
    evidence = evidence_of_run(run, run.plan)
    sensor = run.detections.sensor
    states = states_at_marks(evidence, sensor)
    return Salvo(*states, *labels(evidence), oracle(evidence, run.detections))


def states_at_marks(evidence, sensor):
    """Return errors, m, which launches are held, which are paired right, and the number of tracks
    at the first mark.
    """
    targets = evidence.plan.targets
    mark_s = np.rint(targets.ignition_s + MARK * (targets.burnout_s - targets.ignition_s))
    error_m = np.full(LAUNCHES, np.nan)
    held = np.zeros(LAUNCHES, bool)
    paired = np.zeros(LAUNCHES, bool)
    for tick_s in np.unique(mark_s):
        tracks = evidence.tracks.take(np.flatnonzero(evidence.tracks.tick_s == tick_s))
        is_burning = (targets.ignition_s < tick_s - 5.0) & (targets.burnout_s > tick_s - PAIRED_S)
        burning = np.flatnonzero(is_burning).astype(np.int32)
        truth = true_states_ecef(evidence.plan, burning, np.full(len(burning), tick_s))
        distance_m = np.linalg.norm(truth[:, None, :3] - tracks.state[None, :, :3], axis=2)
        pairs = linear_sum_assignment(np.nan_to_num(distance_m, nan=1e9))
        for number, row in zip(*pairs, strict=True):
            launch = burning[number]
            if mark_s[launch] == tick_s:
                error = tracks.state[row] - truth[number]
                nees = error @ np.linalg.solve(tracks.state_covariance[row], error)
                error_m[launch] = distance_m[number, row]
                held[launch] = nees <= chi2.ppf(0.95, 6)
                paired[launch] = is_paired(evidence, sensor, int(tracks.track[row]), tick_s)
    first = evidence.tracks.tick_s == mark_s.min()
    return error_m, held, paired, int(np.count_nonzero(first))


def is_paired(evidence, sensor, track, tick_s):
    """Whether most of a track's recent detections are of one launch in every sensor."""
    age_s = tick_s - evidence.time_s
    recent = (evidence.track == track) & (age_s >= 0.0) & (age_s < PAIRED_S)
    recent &= evidence.target >= 0
    launches = [evidence.target[recent & (sensor == number)] for number in np.unique(sensor)]
    if not all(len(numbers) for numbers in launches):
        return False
    return len({int(np.bincount(numbers).argmax()) for numbers in launches}) == 1


def oracle(evidence, detections):
    """Return the share of wrong labels in the second half of burns where scans are assigned by the
    true directions.
    """
    targets = evidence.plan.targets
    half_s = 0.5 * (targets.ignition_s + targets.burnout_s)
    wrong = 0
    total = 0
    for sensor in np.unique(detections.sensor):
        rows_seen = np.flatnonzero((detections.sensor == sensor) & (evidence.target >= 0))
        for scan in np.unique(detections.scan[rows_seen])[::7]:
            rows = rows_seen[detections.scan[rows_seen] == scan]
            # Light takes about 0.125 s from a launch to a sensor.
            time_s = float(detections.time_s[rows[0]]) - 0.125
            lit = np.flatnonzero(targets.ignition_s < time_s).astype(np.int32)
            line = targets.position_ecef_m(lit, np.full(len(lit), time_s))
            line -= detections.sensor_ecef_m[rows[0]]
            line /= np.linalg.norm(line, axis=1)[:, None]
            square = np.sum((detections.line_of_sight_ecef[rows][:, None] - line) ** 2, axis=2)
            look, number = linear_sum_assignment(np.nan_to_num(square, nan=1.0))
            truth = evidence.target[rows[look]]
            counted = time_s > half_s[truth]
            wrong += np.count_nonzero((lit[number] != truth) & counted)
            total += np.count_nonzero(counted)
    return wrong / max(total, 1)


def labels(evidence):
    """Return the numbers of detections of the second half of a burn on another launch's track, and
    of all.
    """
    targets = evidence.plan.targets
    owners = ownership(evidence)
    target = evidence.target
    half_s = 0.5 * (targets.ignition_s + targets.burnout_s)[np.maximum(target, 0)]
    counted = (target >= 0) & (evidence.track >= 0) & (evidence.time_s > half_s)
    owner = owners.target[np.searchsorted(owners.track, evidence.track[counted])]
    return int(np.count_nonzero(owner != target[counted])), int(np.count_nonzero(counted))


def rows_of(options):
    """Yield a row of figures for each size of the field."""
    fan_deg = 0.0 if options.parallel else 8.0
    for half_km in options.halves:
        runs = [
            salvo(half_km, 24_000 + 2 * run, options.sensors, fan_deg)
            for run in range(options.runs)
        ]
        error_m, held, paired = (
            np.concatenate(column) for column in [*zip(*runs, strict=True)][:3]
        )
        row = {
            "half_km": half_km,
            "sensors": options.sensors,
            "launches": len(held),
        }
        for name, values in (("held", held), ("paired", paired)):
            shares = proportion(int(np.count_nonzero(values)), len(values))
            names = (name, f"{name}_low95", f"{name}_high95")
            row |= dict(zip(names, (round(100.0 * share) for share in shares), strict=True))
        wrong = sum(run.wrong for run in runs) / max(sum(run.labels for run in runs), 1)
        yield row | {
            "median_error_m": round(float(np.nanmedian(error_m))),
            "wrong_labels": round(100.0 * wrong, 1),
            "oracle": round(100.0 * float(np.mean([run.oracle for run in runs])), 1),
            "tracks": float(np.mean([run.tracks for run in runs])),
        }


def page(table):
    """Return the page."""
    columns = ("held", "paired", "wrong_labels", "oracle")
    lines = [
        (
            f"± {row['half_km']} km",
            f"{row['median_error_m']} m",
            *(f"{row[name]} %" for name in columns),
        )
        for row in table
    ]
    return PAGE.format(
        launches=LAUNCHES,
        sensors=table[0]["sensors"],
        table=markdown_table(HEAD, lines),
        mark=MARK,
        count=table[0]["launches"],
        paired=PAIRED_S,
    )


def draw(path, table):
    """Draw the shares against the size of the field."""
    with svg_plot(path, figsize=(6.4, 3.6)) as (_, axes):
        half_km = table.column("half_km")
        series = {"held": "state in its 95 % ellipsoid", "wrong_labels": "wrong labels"}
        for colour, (name, label) in zip(COLOURS, series.items(), strict=False):
            axes.plot(half_km, table.column(name), "o-", color=colour, label=label)
        low = table.column("held_low95")
        axes.fill_between(half_km, low, table.column("held_high95"), alpha=0.2, linewidth=0)
        axes.set(xscale="log", xlabel="half the side of the field, km", ylabel="share, %")
        axes.set_ylim(0, 100)


def main():
    """Measure and write."""
    options = options_of(__doc__, runs=10, halves=(0.5, 1.5, 5.0), sensors=2, parallel=False)
    publish(options, page, draw, salvos=rows_of(options))


if __name__ == "__main__":
    main()
