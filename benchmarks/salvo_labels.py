"""What does association cost in a salvo of short-range missiles? `imm` beside the same tracker with
the true association of lines.

Launches of the class SRBM within 38 s from a square of ± `half` km, towards aims in a square of
± 1°, two SBIRS-GEO at 10 Hz. Purity is the share of labelled detections on a track of which most
detections are of the same launch. GOSPA (cut-off 5 km) is of position, over the root of the number
of launches, mean over runs and the ticks from 10 s after the last ignition to the first burnout.
With the true association the associator alone is another: each launch's lines are its track's,
which is the one within whose gates they were first.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from attrs import define, evolve
from opir_scoring import evidence_of_run, gospa, ownership, true_states_ecef
from opir_trackers import Association, Associator
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.tracker import imm_tracker
from pages import markdown_table, options_of, publish

import opir_core as opir
from opir_core.interfaces import PartMaker
from opir_core.simulation.run import run_of_plan

SLOTS_DEG = (-35.0, 30.0)
#: The middle of the aims, north and east of that of the launches, degrees.
AIM_DEG = np.array([-2.5, 3.0])

PAGE = """# Salvos of short-range missiles

What does association cost? GOSPA of `imm` at default settings is {least:.1f} to {most:.1f} times that of
the same tracker with the true association of lines. {fields} within 38 s, two SBIRS-GEO at 10 Hz,
associators `jpda` (the default) and `gnn`, {runs} runs a row.

{table}

*Purity*: of the launches' detections with a track (at least {labelled:.1f} %), the share whose track is
of the same launch. *GOSPA* is of position, per launch, with a cut-off of 5 km, while all launches
burn; *ratio* is that over GOSPA with true association. Targets closer than the error of a look,
0.7 km for 20 µrad from 37 000 km, cannot be resolved: [salvos](salvos.md) has what true directions
would give. Data: [salvo_labels.csv](salvo_labels.csv).
"""
HEAD = ("launches", "field", "associator", "purity", "GOSPA", "with true association", "ratio")


def scene_of(launches, half_km, seed, association):
    """Return a scene with a salvo and an associator."""
    rng = np.random.default_rng([seed, launches, round(1e3 * half_km)])
    lat_deg = rng.uniform(20.0, 50.0)
    lon_deg = rng.uniform(-150.0, 150.0)
    shifts_deg = rng.uniform(-half_km, half_km, (launches, 2)) / 111.2
    aims_deg = rng.uniform(-1.0, 1.0, (launches, 2))
    ignitions_s = np.sort(rng.uniform(5.0, 43.0, launches))

    def place(north_deg, east_deg):
        return {"lat_deg": lat_deg + north_deg, "lon_deg": lon_deg + east_deg}

    targets = [
        {
            "id": f"T{row}",
            "type": "SRBM",
            "launch": {**place(*shifts_deg[row].tolist()), "time_s": float(ignitions_s[row])},
            "aim": place(*(AIM_DEG + aims_deg[row]).tolist()),
        }
        for row in range(launches)
    ]
    slots_deg = [(lon_deg + slot_deg + 540.0) % 360.0 - 180.0 for slot_deg in SLOTS_DEG]
    return opir.scene_from_mapping(
        {
            "scene": "salvo-labels",
            "epoch": "2026-04-01T18:00:00Z",
            "duration_s": 100.0,
            "seed": seed,
            "sensors": [
                {"model": "SBIRS-GEO", "id": f"S{row}", "orbital_slot_deg": slot_deg}
                for row, slot_deg in enumerate(slots_deg)
            ],
            "targets": targets,
            "tracker": {"model": "imm", "forecast": "none", "association": association},
        }
    )


@define
class TrueAssociator(Associator):
    """Gives each line to the track of its launch; `time_s` and `target` (n,) are of all detections
    in order of time.

    Its memory is the launch of each track number, of which a launch has one.
    """

    time_s: np.ndarray
    target: np.ndarray

    def associate(self, problem):
        """Return the association of a slice's lines with the predicted tracks."""
        lines = problem.lines
        pairs = problem.pairs
        target = self._targets(lines.time_s)
        known = dict(problem.memory or {})
        known = {number: known[number] for number in problem.number.tolist() if number in known}
        for place in np.argsort(pairs.distance, kind="stable").tolist():
            number = int(problem.number[pairs.track[place]])
            launch = int(target[pairs.line[place]])
            if launch >= 0 and number not in known and launch not in known.values():
                known[number] = launch
        numbers = enumerate(problem.number.tolist())
        rows = {known[number]: row for row, number in numbers if number in known}
        owner = np.array([rows.get(launch, -1) for launch in target.tolist()], dtype=np.int64)
        chosen = pairs.take(np.flatnonzero(owner[pairs.line] == pairs.track))
        return Association(lines=lines, owner=owner, pairs=chosen, memory=known)

    def _targets(self, time_s):
        """Return the launches (m,) of the lines of a slice, which follow each other in time."""
        if not len(time_s):
            return np.empty(0, dtype=np.int64)
        first = int(np.searchsorted(self.time_s, time_s[0], side="left"))
        rows = slice(first, first + len(time_s))
        if not np.array_equal(self.time_s[rows], time_s):
            raise ValueError("lines of a slice are not all detections of its time")
        return self.target[rows]


def with_true_association(run):
    """Return the run of the same plan, tracked with the true association."""
    context = run.plan.make_tracker.args[-1]
    time_s = run.detections.time_s
    maker = PartMaker(
        owner="the truth", config=None, build=lambda *_: TrueAssociator(time_s, run.truth.target)
    )
    context = evolve(context, parts={**context.parts, "association": maker})
    return run_of_plan(evolve(run.plan, make_tracker=lambda: imm_tracker(ImmConfig(), context)))


def gospa_m(evidence):
    """Return the mean GOSPA of position, per launch, m, over the ticks at which all launches are
    known and burn.
    """
    targets = evidence.plan.targets
    tracks = evidence.tracks
    ticks_s = np.unique(tracks.tick_s)
    is_counted = (ticks_s > targets.ignition_s.max() + 10.0) & (ticks_s < targets.burnout_s.min())
    launches = np.arange(len(targets.ignition_s), dtype=np.int32)
    distances_m = []
    for tick_s in ticks_s[is_counted]:
        times_s = np.full(len(launches), tick_s)
        truth_m = true_states_ecef(evidence.plan, launches, times_s)[:, :3]
        place_m = tracks.state[tracks.tick_s == tick_s, :3]
        distances_m.append(gospa(place_m, truth_m, cutoff=5e3).distance)
    return float(np.mean(distances_m) / np.sqrt(len(launches)))


def label_shares(evidence):
    """Return the share of the launches' detections that have a track, and of these the share whose
    track is of the same launch.
    """
    owners = ownership(evidence)
    counted = evidence.target >= 0
    labelled = counted & (evidence.track >= 0)
    owner = owners.target[np.searchsorted(owners.track, evidence.track[labelled])]
    pure = np.mean(owner == evidence.target[labelled])
    return np.count_nonzero(labelled) / np.count_nonzero(counted), pure


def rows_of(options):
    """Yield a row of figures for each number of launches, size of the field and associator."""
    for launches in options.launches:
        for half_km in options.halves:
            figures = [
                figures_of(launches, half_km, 52_100 + number, options.associations)
                for number in range(options.runs)
            ]
            means = np.mean(figures, axis=0).tolist()
            for association, row in zip(options.associations, means, strict=True):
                labelled, purity, found_m, true_m = row
                yield {
                    "launches": launches,
                    "half_km": half_km,
                    "association": association,
                    "runs": options.runs,
                    "labelled": round(labelled, 3),
                    "purity": round(purity, 3),
                    "gospa_m": round(found_m),
                    "true_gospa_m": round(true_m),
                    "ratio": round(found_m / true_m, 2),
                }


def figures_of(launches, half_km, seed, associations):
    """Return, of each associator, the shares of labels and GOSPA, m, with it and with the truth."""
    scenes = [scene_of(launches, half_km, seed, association) for association in associations]
    runs = [opir.simulate(scene) for scene in scenes]
    associated = with_true_association(runs[0])
    true_m = gospa_m(evidence_of_run(associated, associated.plan))
    evidence = [evidence_of_run(run, run.plan) for run in runs]
    return [(*label_shares(each), gospa_m(each), true_m) for each in evidence]


def page(table):
    """Return the page."""
    lines = [
        (
            row["launches"],
            f"± {row['half_km']} km",
            f"`{row['association']}`",
            f"{row['purity']:.2f}",
            f"{row['gospa_m']} m",
            f"{row['true_gospa_m']} m",
            f"{row['ratio']:.1f}",
        )
        for row in table
    ]
    counts = sorted({row["launches"] for row in table})
    fields = " and ".join(str(count) for count in counts)
    ratios = [row["ratio"] for row in table if row["association"] == "jpda"]
    return PAGE.format(
        fields=f"{fields} launches",
        runs=table[0]["runs"],
        least=min(ratios),
        most=max(ratios),
        table=markdown_table(HEAD, lines),
        labelled=100.0 * min(table.column("labelled")),
    )


def main():
    """Measure and write."""
    options = options_of(
        __doc__,
        runs=3,
        launches=(12, 20),
        halves=(0.5, 1.5, 5.0),
        associations=("jpda", "gnn"),
    )
    publish(options, page, salvo_labels=rows_of(options))


if __name__ == "__main__":
    main()
