"""Does "none of these" rise in the tracker for a class that it does not know? By motion alone, each
left out in turn.

    python benchmarks/left_out_hypotheses.py [--launches 2] [--seed 12] [--write docs/benchmarks]

Launches of all seven classes before two SBIRS-GEO, once with every class known to `imm` and once
for each class left out: the plan then has a host that does not offer that class, so tracker and
scores have one hypothesis fewer, while the scene launches it all the same. Sensors report no types
(`classification: none`): the tracker knows motion alone.
"""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from calibration import bin_numbers
from discrimination_objects import moved, place
from left_out_classes import CLASSES, EDGES, EVERY, NAMES
from opir_scoring import evidence_of_run, open_set_rate, ownership
from opir_scoring.containments import proportion
from opir_scoring.proper_scores import share_above
from work_precision.results_csv import write_csv

import opir_core as opir
from opir_core.plugin import Host, TargetClass
from opir_core.scene.target_classes import OrbitInsertion

#: Marks: s since the first detection, s after burnout, and the last record of a track.
MARKS = (
    ("30 s after detection", 30.0, None),
    ("60 s after detection", 60.0, None),
    ("burnout", None, 5.0),
)
#: Distance of launches, degrees, and the time, s, within which all are; time, s, from the longest
#: boost's end to the scene's.
APART_DEG = 3.0
WITHIN_S = 30.0
AFTER_S = 10.0
#: AUROC from which "none of these" separates a class left out from known ones.
BAR = 0.95

PAGE = """# Classes left out of the tracker

*Does "none of these" rise in `imm` for a target class that it does not know?* Where no other class flies alike, after
burnout: {rises}. Where another covers its boosts and ranges it cannot.

| left out, at burnout | AUROC | mean P(none): left out | known | OSCR | right, known | taken for |
|---|---|---|---|---|---|---|
{table}

AUROC: of P(none of these), tracks of the class left out against those of known classes. OSCR: area under correct
classification against false positives. *Right*: share of tracks of known classes whose most probable hypothesis is
true; *taken for*: the most probable known hypothesis of the class left out, with its mean probability.

An MRBM lies within the ranges of the class IRBM, an SLBM within those of IRBM and ICBM. The tracker knows missiles by
one law of vehicles and the ranges of classes, so a class that covers a range takes what is left out there.

**Calibration.** P of target classes after burnout, by bins: mean, share that is right, and number (each track counts
once for each class). Classes count with the tracker's own prior, which has them unequally often.

| P from | every class known | one left out |
|---|---|---|
{bins}

**Method.** {launches} launches of each of seven classes, seed {seed}, two SBIRS-GEO, `classification: none`: motion
alone. Intervals of an AUROC are 95 % (Wilson), with the largest variance that it can have: of a share of as many trials
as the class has launches (Birnbaum and Klose, 1957). Bins of fewer than 200 say little. What light adds:
[classes left out of the classifier](left_out_classes.md). Earlier marks and data:
[left_out_hypotheses.csv](left_out_hypotheses.csv).
"""


class WithoutClass(Host):
    """A host that does not offer one target class among the names, though a scene may launch it."""

    left_out = ""

    def names(self, hook: Any) -> list[str]:
        """Return the names offered under a hook, sorted."""
        return [
            name for name in super().names(hook) if hook is not TargetClass or name != self.left_out
        ]


class Record(NamedTuple):
    """What the track of a launch says at a mark: P by the names of hypotheses."""

    left_out: str
    kind: str
    mark: str
    probability: dict[str, float]


class Row(NamedTuple):
    """How "none of these" rises at a mark for a class left out; nan for nothing left out."""

    left_out: str
    mark: str
    unknown_tracks: int
    known_tracks: int
    auroc: float
    unknown: float
    known: float
    oscr: float
    right: float
    alike: str
    as_alike: float


def scene(launches: int, seed: int) -> dict[str, Any]:
    """Return a scene of launches of every class, in random order, apart from each other."""
    rng = np.random.default_rng([seed, 37])
    kinds = [kind for kind in CLASSES for _ in range(launches)]
    side = int(np.ceil(np.sqrt(len(kinds))))
    cells = rng.permutation(side * side)[: len(kinds)]
    targets = []
    for number, (kind, cell) in enumerate(zip(kinds, cells.tolist(), strict=True)):
        profile = kind.profiles[int(rng.integers(len(kind.profiles)))]
        latitude = np.radians(
            APART_DEG * (cell // side - 0.5 * side + rng.uniform(-0.2, 0.2)) + 20.0
        )
        longitude = np.radians(APART_DEG * (cell % side - 0.5 * side + rng.uniform(-0.2, 0.2)))
        limits = np.log(
            [1.02 * max(profile.minimum_range_m, 5e4), min(profile.maximum_range_m, 1.5e7) / 1.02]
        )
        range_m = float(np.exp(rng.uniform(*limits)))
        heading = 2.0 * np.pi * rng.random()
        start_s = float(rng.uniform(1.0, WITHIN_S))
        target = {
            "id": f"{kind.name}-{number}",
            "type": kind.name,
            "launch": {**place(latitude, longitude), "time_s": start_s},
        }
        if isinstance(kind.after_burnout, OrbitInsertion):
            targets.append({**target, "azimuth_deg": float(np.degrees(heading) % 360.0)})
            continue
        own = {"profile": profile.name} if len(kind.profiles) > 1 else {}
        targets.append(
            {**target, **own, "aim": place(*moved(latitude, longitude, range_m / 6.371e6, heading))}
        )
    longest_s = max(profile.burn_time_s for kind in CLASSES for profile in kind.profiles)
    return {
        "scene": "left out of the tracker",
        "epoch": "2026-04-01T18:00:00Z",
        "duration_s": float(np.ceil(WITHIN_S + longest_s + AFTER_S)),
        "seed": seed,
        "sensors": [
            {"model": "SBIRS-GEO", "id": f"S{slot % 360:.0f}", "orbital_slot_deg": slot}
            for slot in (-35.0, 30.0)
        ],
        "targets": targets,
        "classification": "none",
        "tracker": "imm",
        "outputs": [],
    }


def records_of(mapping: dict[str, Any], left_out: str) -> list[Record]:
    """Return what tracks of launches say at the marks, with a class left out."""
    host = WithoutClass.discover()
    host.left_out = left_out
    run = opir.run_of_plan(opir.compile_plan(opir.scene_from_mapping(mapping), host))
    evidence = evidence_of_run(run, run.plan)
    owners = ownership(evidence)
    names = [each.name for each in run.plan.hypotheses]
    tracks = run.tracks
    found = list[Record]()
    owner = owners.target[np.searchsorted(owners.track, tracks.track)]
    for target, plain in enumerate(mapping["targets"]):
        rows = np.flatnonzero(owner == target)
        seen_s = evidence.time_s[evidence.target == target]
        if not len(rows) or not len(seen_s):
            continue
        burnout_s = run.plan.targets.burnout_s[target]
        for mark, since_s, after_s in (*MARKS, ("first", 0.0, None)):
            when_s = burnout_s + after_s if since_s is None else seen_s[0] + since_s
            late = (
                rows[tracks.tick_s[rows] >= when_s]
                if mark == "first"
                else rows[tracks.tick_s[rows] <= when_s]
            )
            if not len(late) or (since_s is not None and when_s > burnout_s):
                continue
            row = late[0] if mark == "first" else late[-1]
            probability = dict(zip(names, tracks.hypothesis_probability[row].tolist(), strict=True))
            found.append(Record(left_out, plain["type"], mark, probability))
    return found


def row_of(records: Sequence[Record], mark: str) -> Row:
    """Return how "none of these" rises at a mark, of the records with one class left out."""
    here = [each for each in records if each.mark == mark]
    left_out = here[0].left_out
    unknown, known = (
        [each for each in here if (each.kind == left_out) == is_out] for is_out in (True, False)
    )
    none_out, none_in = (
        np.array([each.probability["none of these"] for each in part]) for part in (unknown, known)
    )
    best = [_best(each.probability) for each in known]
    right = np.array([name == each.kind for (name, _), each in zip(best, known, strict=True)])
    score = np.array([p for _, p in best])
    other = np.array([_best(each.probability)[1] for each in unknown])
    means = (
        {
            name: np.mean([each.probability[name] for each in unknown])
            for name in known[0].probability
        }
        if unknown
        else {}
    )
    alike, as_alike = _best(means) if means else ("", np.nan)
    return Row(
        left_out or EVERY,
        mark,
        len(unknown),
        len(known),
        share_above(none_out, none_in),
        float(none_out.mean()) if unknown else np.nan,
        float(none_in.mean()),
        open_set_rate(score, right, other),
        float(
            np.mean(
                [
                    max(each.probability, key=each.probability.__getitem__) == each.kind
                    for each in known
                ]
            )
        ),
        alike,
        float(as_alike),
    )


def _best(probability: dict[str, float]) -> tuple[str, float]:
    """Return the most probable hypothesis other than "none of these"."""
    name = max(
        (name for name in probability if name != "none of these"), key=probability.__getitem__
    )
    return name, probability[name]


def calibration(records: Sequence[Record]) -> list[str]:
    """Return a cell for each bin of P of target classes after burnout: mean, share that is right,
    and number.

    Each record is weighted by the tracker's prior of its class (the first records of all), over the
    class's number.
    """
    marked = [each for each in records if each.mark == MARKS[-1][0]]
    stated = list[float]()
    true = list[bool]()
    weight = list[float]()
    for each in marked:
        truth = each.kind if each.kind != each.left_out else "none of these"
        firsts = [
            other.probability
            for other in records
            if other.mark == "first" and other.left_out == each.left_out
        ]
        prior = float(np.mean([first[truth] for first in firsts]))
        alike = sum(other.kind == each.kind and other.left_out == each.left_out for other in marked)
        launched = [name for name in each.probability if name in NAMES[3:]]
        stated += [each.probability[name] for name in launched]
        true += [name == truth for name in launched]
        weight += [prior / alike] * len(launched)
    p = np.array(stated)
    is_true = np.array(true)
    w = np.array(weight)
    number = bin_numbers(p, EDGES)
    cells = list[str]()
    for place_ in range(len(EDGES) - 1):
        own = number == place_
        if not own.any():
            cells.append("")
            continue
        mean, right = (
            float(np.sum(w[own] * column[own]) / w[own].sum()) for column in (p, is_true)
        )
        cells.append(f"{mean:.2f}: {right:.2f} of {own.sum()}")
    return cells


def auroc_text(row: Row) -> str:
    """Return an AUROC with its interval; nan if nothing is left out."""
    least = min(row.unknown_tracks, row.known_tracks)
    if not least:
        return "nan"
    _, low, high = proportion(row.auroc * least, least)
    return f"{row.auroc:.2f} [{low:.2f}, {high:.2f}]"


def page(rows: Sequence[Row], records: Sequence[Record], launches: int, seed: int) -> str:
    """Return the page."""
    known, partial = (
        [each for each in records if bool(each.left_out) == is_out] for is_out in (False, True)
    )
    last = [row for row in rows if row.mark == MARKS[-1][0] and row.unknown_tracks]
    rises = (
        ", ".join(f"{row.left_out} (AUROC {auroc_text(row)})" for row in last if row.auroc >= BAR)
        or "for none"
    )
    lines = [
        f"| {row.left_out} | {auroc_text(row)} | {row.unknown:.3f} | {row.known:.3f} |"
        f" {row.oscr:.2f} |"
        f" {row.right:.2f} of {row.known_tracks} | {row.alike} {row.as_alike:.2f} |"
        for row in rows
        if row.mark == MARKS[-1][0]
    ]
    cells = zip(EDGES[:-1].tolist(), calibration(known), calibration(partial), strict=True)
    bins = [f"| {lower:g} | {whole} | {part} |" for lower, whole, part in cells]
    text = PAGE.format(
        rises=rises, table="\n".join(lines), bins="\n".join(bins), launches=launches, seed=seed
    )
    return text.replace("nan", "–")


def main() -> None:
    """Simulate, print and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--launches", type=int, default=2)
    parser.add_argument("--seed", type=int, default=12)
    parser.add_argument(
        "--only", nargs="+", default=["", *(kind.name for kind in CLASSES)], help="classes left out"
    )
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    mapping = scene(arguments.launches, arguments.seed)
    records = list[Record]()
    rows = list[Row]()
    for left_out in arguments.only:
        own = records_of(mapping, left_out)
        records += own
        rows += [row_of(own, mark) for mark, _, _ in MARKS]
        print(*rows[-len(MARKS) :], sep="\n", flush=True)
    text = page(rows, records, arguments.launches, arguments.seed)
    print(text)
    if arguments.write:
        (arguments.write / "left_out_hypotheses.md").write_text(text, encoding="utf-8")
        write_csv(arguments.write / "left_out_hypotheses.csv", rows)


if __name__ == "__main__":
    main()
