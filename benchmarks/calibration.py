"""Are reported probabilities right, and does "none of these" rise for what is unknown?

Six parts, each with data of its own; `--only` runs some, `--scale` changes the numbers of
launches.

- `reports`: launches of every type, hot sources and noise are simulated and classified; the prior
  of the classifier is that of the simulation. Of detections reported with confidence p, is a share
  p right? A report of a type is right if it is the target's, UNKNOWN if the source is no missile.
- `looks`: one look at each object by every sensor (`calibration_looks`).
- `classes`: launches of all classes and sources, once for each class, and for the sources on the
  ground, left out of the classifier's prior and training, and once with nothing left out. An event
  counts for each hypothesis with its probability; events of the omitted class are of "none of
  these".
- `tracks`: launches of all classes before two SBIRS-GEO, once for each class omitted from the
  target classes that the plan's host offers: `imm` and scores have one hypothesis fewer. Sensors
  report no types: the tracker knows motion alone.
- `ranks`: ranks of the truth in the reports of `imm` on flights of its own prior
  (`calibration_ranks`).
- `foreign`: P(missile), P(comes down), P(orbit) and P(burn over) of `imm` on launches that share no
  code with it (`calibration_foreign`).
"""

import os
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from calibration_foreign import DOWN, MISSILE, draw_foreign, foreign_rows, foreign_text
from calibration_looks import area, area_rows, confusion_rows, looks_at, population, simulated
from calibration_ranks import ORBIT, OVER, rank_rows
from calibration_scenes import (
    PRIOR_SOURCES,
    launched,
    launches,
    prior,
    slot_scene,
    source_blocks,
)
from opir_scoring import evidence_of_run, open_set_rate, ownership
from opir_scoring.proper_scores import share_above
from pages import GREY, Row, Table, options_of, printed, read_csv, svg_plot, write_csv

import opir_core as opir
from opir_core.plugin import Host, TargetClass
from opir_core.scene import core_hypotheses
from opir_core.scene.scene import TARGET_TYPES, UNKNOWN_TYPE

NAMES = [hypothesis.name for hypothesis in core_hypotheses()]
CLASSES = [
    core_hypothese.name
    for core_hypothese in core_hypotheses()
    if core_hypothese.target_class is not None
]
NONE = "none of these"
GROUND = "ground source"
#: Omitted from the classifier, one after the other.
NOTHING = "nothing"
OMITTED = (NOTHING, *CLASSES, GROUND)
SENSORS: dict[str, dict[str, Any]] = {
    "DSP": {"model": "DSP"},
    "SBIRS-GEO": {"model": "SBIRS-GEO"},
    "NEXTGEN-GEO": {"model": "NEXTGEN-GEO"},
}
UNCONFIRMED = {"DSP-unconfirmed": {"model": "DSP", "confirmation_detections": 1}}
TENTHS = np.linspace(0.0, 1.0, 11)
#: Edges of the bins of hypotheses: near 0 and 1 finer.
EDGES = np.array([0.0, 0.02, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.98, 1.0])
#: Events of a bin, and how far from the diagonal its share may be.
ENOUGH = 200
WITHIN = 0.05
#: AUROC from which "none of these" separates a class left out from known ones.
BAR = 0.9
#: p above which ranks count as uniform.
LEAST_P = 0.01
#: Marks of the tracker: s since the first detection, or s after burnout.
MARKS = {
    "30 s after detection": (30.0, None),
    "60 s after detection": (60.0, None),
    "burnout": (None, 5.0),
}

PAGE = """# Calibration

*Are reported probabilities right, does "none of these" rise for what is unknown, and how well are
plumes and types separated?* {answer}

![Reliability, right types, AUROC of "none of these", p of rank tests](calibration.svg)

**Confidence of a detection.** Within 5 points of the diagonal lie {reports} bins of at least
{enough} events. The farthest: {farthest}. Launches, fires, gas flares and noise, with the prior of
the simulation, `confidence: posterior`; `DSP-unconfirmed` has `confirmation_detections: 1`.
[Data](calibration.csv).

**Every hypothesis of the classifier.** With every class known, probabilities hold within 5 points
in {known} bins; with one class left out in {omitted}: its events fall to the class that looks like
it. [Data](left_out_bins.csv).

**None of these, by light.** P(none of these) separates a class left out from known ones with an
AUROC of {bar} or more for {classes}. Classes that cover one another cannot raise it: an MRBM is
one of the two boosts of the class IRBM, HGV lies between IRBM and SLBM, SLBM between IRBM and
ICBM, ICBM between SLBM and SLV; their colours are alike. Also OSCR (area under correct
classification against false positives): [data](left_out_classes.csv).

**None of these, by motion.** In `imm` after burnout it does so for {tracks}. The tracker knows
missiles by one law of vehicles and the ranges of classes, so a class that covers a range takes
what is left out there. Few launches: an AUROC has the interval of a share of as many trials.
`classification: none`. [Data](left_out_hypotheses.csv).

**Plumes, other sources, types.** The area under the ROC curve of plumes against fires, flares and
glints, where an unreported object scores below all, is {areas}; the types of {types} of the
launches are reported right. The difference of frames takes away most of what stands still, before
any classifier. One look at each object at a random moment, all settings default.
[AUCs](discrimination.csv), [confusion of types](classification.csv), with 95 % intervals (DeLong;
Clopper and Pearson).

**`imm` on its own prior.** {ranks} tests of ranks of the truth have p above {least_p:g}; the
others: {failed}. The truth is drawn from the tracker's prior and observed, so its rank in the
report is uniform if the tracker computes with that prior ([Talts et al.,
2018](https://arxiv.org/abs/1804.06788)). Ranks of the state are containments: many near 0 say that
the covariance is too wide. The launch time of a launch seen at once is a mixture with some 95 %
within a tenth of a second of the first detection, the rest seconds earlier, for clouds may have
hidden it: its standard deviation is no interval; the mean of error² / variance is {square:.2f} (1
is consistent, above 1 is overconfident). For other flights there are [regions on foreign
flights](tracker_honesty.md). [Data](simulation_calibration.csv).

{foreign}

**Method.** Places, headings, ranges, brightnesses and propellants are those that the classifier
assumes; `midlat_summer` air over the Earth by day, no cloud. In `reports` and `classes` all
sensors look every 2 and 4 s (default: 10, 0.1 and 0.05 s); else their settings are default: focal
planes, DSP with its preset `heritage`. Events of one launch share its brightness, so a bin of many
events may hold few launches; intervals are over launches and sources. By `--write
docs/benchmarks`; a part alone by `--only`.
"""


def bin_numbers(probability, edges):
    """Return the bins of probabilities between edges (k + 1,)."""
    return np.clip(np.searchsorted(edges, probability, side="right") - 1, 0, len(edges) - 2)


def report_row(confidence, right, emitter):
    """Return a bin of events (n,). Those of one emitter are dependent: the interval is over
    emitters.
    """
    error = right - confidence
    _, row = np.unique(emitter, return_inverse=True)
    residual = np.bincount(row, error) - error.mean() * np.bincount(row)
    return {
        "events": len(error),
        "confidence": float(confidence.mean()),
        "right": float(right.mean()),
        "emitters": len(residual),
        "half_95": 1.96 * float(np.sqrt(np.sum(np.square(residual)))) / len(error),
    }


def report_run(count, sources, seed):
    """Return confidence, whether the type is right, the type and the emitter of each report (n,),
    by sensor.
    """
    sensors = {**SENSORS, **UNCONFIRMED}
    rng = np.random.default_rng([seed, 29])
    targets = launches(rng, TARGET_TYPES, count)
    classifier = prior(TARGET_TYPES, count, PRIOR_SOURCES, sources, 256.0)
    mapping = slot_scene(
        {name: {**sensor, "scan_period_ms": 2000.0} for name, sensor in sensors.items()},
        256.0,
        seed,
        targets=targets,
        sources=source_blocks(rng, PRIOR_SOURCES, sources),
        classification=classifier,
        confidence="posterior",
    )
    run = opir.simulate(opir.scene_from_mapping(mapping))
    kinds = [TARGET_TYPES.index(target["type"]) for target in targets]
    truth = np.append(kinds, np.full(2 * sources + 1, UNKNOWN_TYPE))[run.truth.target]
    # Each false alarm is an emitter by itself.
    alarms = -1.0 - np.arange(len(truth))
    emitter = np.where(run.truth.target < 0, alarms, run.truth.target) + 1j * seed
    reported = run.detections.reported_type
    events = np.array([run.detections.confidence, reported == truth, reported, emitter])
    return {name: events[:, run.detections.sensor == number] for number, name in enumerate(sensors)}


def report_rows(count, sources, seeds=(2, 4)):
    """Yield the bins of reports of each sensor."""
    runs = [report_run(count, sources, seed) for seed in seeds]
    for name in runs[0]:
        events = np.concatenate([run[name] for run in runs], axis=1)
        confidence, right, reported, emitter = events
        number = bin_numbers(confidence.real, TENTHS)
        for kind in ("missile", "UNKNOWN"):
            for place, lower in enumerate(TENTHS[:-1].tolist()):
                rows = ((reported != UNKNOWN_TYPE) == (kind == "missile")) & (number == place)
                if rows.any():
                    row = {"sensor": name, "what": kind, "lower": lower}
                    yield row | report_row(confidence.real[rows], right.real[rows], emitter[rows])


def look_tables(count, sources):
    """Return the areas and the confusion of types of single looks."""
    people = population(count, sources, seed=1)
    looks = looks_at(people, *simulated(people))
    return list(area_rows(people, looks)), list(confusion_rows(people, looks))


def class_run(count, sources, omitted):
    """Return a run without a class in the classifier, and the true hypotheses of the events."""
    duration_s = 512.0
    rng = np.random.default_rng([2, 31])
    targets = launches(rng, CLASSES, count)
    classes = [name for name in CLASSES if name != omitted]
    kinds = {} if omitted == GROUND else PRIOR_SOURCES
    unknown = {NOTHING: 1e-3, GROUND: 2.0 * sources}.get(omitted, float(count))
    classifier = prior(classes, count, kinds, sources, duration_s)
    classifier |= {"bolides_per_day": 0.0, "unknown_per_day": 86_400.0 / duration_s * unknown}
    mapping = slot_scene(
        {name: {**sensor, "scan_period_ms": 4000.0} for name, sensor in SENSORS.items()},
        duration_s,
        2,
        targets=targets,
        sources=source_blocks(rng, PRIOR_SOURCES, sources),
        classification=classifier,
    )
    run = opir.simulate(opir.scene_from_mapping(mapping))
    emitters = [target["type"] for target in targets] + [GROUND] * (2 * sources)
    numbers = [NAMES.index(NONE if name == omitted else name) for name in (*emitters, "noise")]
    return run, np.array(numbers)[run.truth.target]


def bin_rows(probability, truth):
    """Yield the bins of events (n, hypotheses)."""
    is_true = np.arange(probability.shape[1]) == truth[:, None]
    number = bin_numbers(probability, EDGES)
    for place, lower in enumerate(EDGES[:-1].tolist()):
        rows = number == place
        if rows.any():
            yield {
                "lower": lower,
                "events": int(rows.any(axis=1).sum()),
                "probability": float(probability[rows].mean()),
                "right": float(is_true[rows].mean()),
            }


def rise(probability, truth):
    """Return how "none of these" rises for events of an omitted class, against known launches.

    `oscr` is the area under correct classification against false positives (Dhamija, Günther and
    Boult, Reducing network agnostophobia, 2018); `alike` the class that takes most events.
    """
    none = NAMES.index(NONE)
    unknown = truth == none
    known = ~unknown & (truth > NAMES.index(GROUND))
    score = probability[:, none]
    classes = probability.copy()
    classes[:, none] = 0.0
    best = classes.max(axis=1)
    right = (classes.argmax(axis=1) == truth)[known]
    means = classes[unknown].mean(axis=0)
    return {
        "auroc": area(score[unknown], score[known])[0],
        "known": float(score[known].mean()),
        "known_95": float(np.quantile(score[known], 0.95)),
        "unknown": float(score[unknown].mean()),
        "oscr": open_set_rate(best[known], right, best[unknown]),
        "alike": NAMES[int(means.argmax())],
        "as_alike": float(means.max()),
    }


def class_tables(count, sources):
    """Return the rises of "none of these" and the bins, with each class left out in turn."""
    rises = []
    bins = []
    for omitted in OMITTED:
        run, truth = class_run(count, sources, omitted)
        probability = np.exp(run.detections.hypothesis_log_probability)
        for number, sensor in enumerate(SENSORS):
            rows = run.detections.sensor == number
            name = {"sensor": sensor, "left_out": omitted}
            bins += [name | row for row in bin_rows(probability[rows], truth[rows])]
            if np.any(truth[rows] == NAMES.index(NONE)):
                rises.append(name | rise(probability[rows], truth[rows]))
    return rises, bins


class WithoutClass(Host):
    """A host that does not offer one target class among the names, though a scene may launch it."""

    omitted = ""

    def names(self, hook):
        """Return the names offered under a hook, sorted."""
        names = super().names(hook)
        return [name for name in names if hook is not TargetClass or name != self.omitted]


class Record(NamedTuple):
    """Report of a launch's track at a mark: P by the names of hypotheses."""

    kind: str
    mark: str
    probability: dict[str, float]

    def best(self):
        """Return the most probable hypothesis other than "none of these"."""
        return best_class(self.probability)


def best_class(probability):
    """Return the most probable hypothesis other than "none of these", and its probability."""
    name = max((name for name in probability if name != NONE), key=probability.__getitem__)
    return name, float(probability[name])


def track_scene(count):
    """Return a scene of launches of every class, in random order, three degrees apart."""
    rng = np.random.default_rng([12, 37])
    kinds = [kind for kind in CLASSES for _ in range(count)]
    side = int(np.ceil(np.sqrt(len(kinds))))
    targets = []
    for number, (kind, cell) in enumerate(zip(kinds, rng.permutation(side**2), strict=False)):
        shift = np.array(divmod(int(cell), side)) - 0.5 * side + rng.uniform(-0.2, 0.2, 2)
        place = np.radians(3.0 * shift + [20.0, 0.0]).tolist()
        target = launched(rng, kind, number, tuple(place), has_light=False)
        target["launch"]["time_s"] = float(rng.uniform(1.0, 30.0))
        targets.append(target)
    return {
        "scene": "left out of the tracker",
        "epoch": "2026-04-01T18:00:00Z",
        "duration_s": 330.0,
        "seed": 12,
        "sensors": [
            {"model": "SBIRS-GEO", "id": f"S{slot_deg}", "orbital_slot_deg": slot_deg}
            for slot_deg in (-35, 30)
        ],
        "targets": targets,
        "classification": "none",
        "tracker": "imm",
        "outputs": [],
    }


def records_of(mapping, omitted):
    """Yield the reports of tracks of launches at the marks, with a class left out."""
    host = WithoutClass.discover()
    host.omitted = omitted
    plan = opir.compile_plan(opir.scene_from_mapping(mapping), host)
    run = opir.run_of_plan(plan)
    evidence = evidence_of_run(run, plan)
    owners = ownership(evidence)
    names = [hypothesis.name for hypothesis in plan.hypotheses]
    tracks = run.tracks
    owner = owners.target[np.searchsorted(owners.track, tracks.track)]
    for number, target in enumerate(mapping["targets"]):
        seen_s = evidence.time_s[evidence.target == number]
        burnout_s = float(plan.targets.burnout_s[number])
        for mark, (since_s, after_s) in MARKS.items() if len(seen_s) else ():
            time_s = burnout_s + after_s if since_s is None else seen_s[0] + since_s
            rows = np.flatnonzero((owner == number) & (tracks.tick_s <= time_s))
            if len(rows) and (since_s is None or time_s <= burnout_s):
                probability = tracks.hypothesis_probability[rows[-1]].tolist()
                yield Record(target["type"], mark, dict(zip(names, probability, strict=True)))


def track_row(omitted, mark, records):
    """Return how "none of these" rises at a mark, with one class left out."""
    unknown = [record for record in records if record.kind == omitted]
    known = [record for record in records if record.kind != omitted]
    none_unknown, none_known = (
        np.array([record.probability[NONE] for record in part]) for part in (unknown, known)
    )
    best = [record.best() for record in known]
    right = [name == record.kind for (name, _), record in zip(best, known, strict=True)]
    confidence = np.array([p for _, p in best])
    rival = np.array([record.best()[1] for record in unknown])
    top = [max(one.probability, key=one.probability.__getitem__) == one.kind for one in known]
    means = {
        name: float(np.mean([record.probability[name] for record in unknown]))
        for name in (unknown[0].probability if unknown else ())
    }
    alike, as_alike = best_class(means) if means else ("", np.nan)
    return {
        "left_out": omitted or NOTHING,
        "mark": mark,
        "unknown_tracks": len(unknown),
        "known_tracks": len(known),
        "auroc": share_above(none_unknown, none_known),
        "unknown": float(none_unknown.mean()) if unknown else np.nan,
        "known": float(none_known.mean()),
        "oscr": open_set_rate(confidence, np.array(right), rival),
        "right": float(np.mean(top)),
        "alike": alike,
        "as_alike": as_alike,
    }


def track_rows(count):
    """Yield the rows of the tracker with each class left out in turn."""
    mapping = track_scene(count)
    for omitted in ("", *CLASSES):
        records = list(records_of(mapping, omitted))
        for mark in MARKS:
            part = [record for record in records if record.mark == mark]
            if part:
                yield track_row(omitted, mark, part)


class Part(NamedTuple):
    """A part: names of its tables, and their rows by a scale of the numbers of launches."""

    tables: tuple[str, ...]
    rows: Callable[[Callable[[int], int]], Iterable[Iterable[Row]]]


PARTS = {
    "reports": Part(("calibration",), lambda size: [report_rows(size(600), size(600))]),
    "looks": Part(
        ("discrimination", "classification"), lambda size: look_tables(size(150), size(300))
    ),
    "classes": Part(
        ("left_out_classes", "left_out_bins"), lambda size: class_tables(size(100), size(150))
    ),
    "tracks": Part(("left_out_hypotheses",), lambda size: [track_rows(max(1, size(2) // 2))]),
    "ranks": Part(("simulation_calibration",), lambda size: [rank_rows(size(150), 1)]),
    "foreign": Part(("foreign_calibration",), lambda size: [foreign_rows(size(500))]),
}
TABLES = [name for part in PARTS.values() for name in part.tables]


def bins_text(table, stated):
    """Return how many bins of enough events are near the diagonal."""
    large = [row for row in table if row["events"] >= ENOUGH]
    close_bins = [row for row in large if abs(row[stated] - row["right"]) <= WITHIN]
    return f"{len(close_bins)} of {len(large)}"


def separated(rows):
    """Return the classes left out that "none of these" separates, and their AUROCs."""
    words = [
        f"{row['left_out']} ({row.get('sensor', 'imm')} {row['auroc']:.2f})"
        for row in rows
        if row["auroc"] != "" and row["auroc"] >= BAR
    ]
    return ", ".join(words) or "none"


def page(tables):
    """Return the page."""
    reports = tables["calibration"]
    bins = tables["left_out_bins"]
    known = bins.where(left_out=NOTHING)
    omitted = Table(row for row in bins if row["left_out"] in CLASSES)
    farthest = sorted(
        (row for row in reports if row["events"] >= ENOUGH),
        key=lambda row: -abs(row["confidence"] - row["right"]),
    )
    burnout = tables["left_out_hypotheses"].where(mark="burnout")
    looks = tables["discrimination"].where(of="looks", against="all")
    tests = [row for row in tables["simulation_calibration"] if row["p"] != ""]
    failed = [row for row in tests if row["p"] <= LEAST_P]
    square = next(row for row in tables["simulation_calibration"] if row["p"] == "")
    ranks = f"{len(tests) - len(failed)} of {len(tests)}"
    return PAGE.format(
        answer=f"Confidences hold within 5 points in {bins_text(reports, 'confidence')} bins,"
        f" probabilities of all classes in {bins_text(known, 'probability')}; where no other class"
        ' looks or flies alike, "none of these" rises, elsewhere it cannot.',
        reports=bins_text(reports, "confidence"),
        enough=ENOUGH,
        farthest="; ".join(
            f"{row['sensor']} {row['what']} at {row['confidence']:.2f}: {row['right']:.2f} ±"
            f" {row['half_95']:.2f}"
            for row in farthest[:3]
        ),
        known=bins_text(known, "probability"),
        omitted=bins_text(omitted, "probability"),
        bar=BAR,
        classes=separated(tables["left_out_classes"]),
        tracks=separated(burnout),
        areas=", ".join(f"{row['auc']:.3f} ({row['sensor']})" for row in looks),
        types=", ".join(f"{share:.0%} ({sensor})" for sensor, share in right_types(tables).items()),
        ranks=ranks,
        least_p=LEAST_P,
        failed=", ".join(
            f"{row['quantity']} at {row['since_first_detection_s']:g} s" for row in failed
        )
        or "none",
        square=square["chi2"] / square["degrees_of_freedom"],
        foreign=foreign_text(tables["foreign_calibration"]),
    )


def right_types(tables):
    """Return the share of launches reported with their type, by sensor."""
    table = tables["classification"]
    right = [row for row in table if row["true_type"] == row["reported"]]
    return {
        sensor: float(np.mean([row["share"] for row in right if row["sensor"] == sensor]))
        for sensor in table.names("sensor")
    }


def draw(path, tables):
    """Draw all parts."""
    with svg_plot(path, 2, 4, figsize=(17.0, 7.5)) as (_, axes):
        bins = tables["left_out_bins"]
        draw_reliability(axes[0, 0], tables["calibration"], "confidence")
        draw_reliability(axes[0, 1], bins.where(left_out=NOTHING), "probability")
        draw_reliability(axes[0, 2], bins.where(left_out="SLBM"), "probability")
        titles = (
            "reports, by sensor",
            "hypotheses, every class known",
            "hypotheses, SLBM left out",
        )
        for panel, title in zip(axes[0, :3], titles, strict=True):
            panel.set_title(title)
        draw_types(axes[1, 0], tables["classification"])
        draw_rises(axes[1, 1], tables)
        draw_ranks(axes[1, 2], tables["simulation_calibration"])
        draw_foreign(axes[0, 3], tables["foreign_calibration"], (MISSILE, DOWN))
        draw_foreign(axes[1, 3], tables["foreign_calibration"], (ORBIT, OVER))


def draw_types(axes, table):
    """Draw the shares reported with their type, by sensor."""
    for sensor in table.names("sensor"):
        rows = table.where(sensor=sensor)
        right = Table(row for row in rows if row["true_type"] == row["reported"])
        axes.plot(right.column("true_type"), right.column("share"), "o", label=sensor)
    axes.set(ylabel="share reported with its type", ylim=(0.0, 1.0))


def draw_rises(axes, tables):
    """Draw how well "none of these" tells what is left out."""
    rises = tables["left_out_classes"]
    burnout = tables["left_out_hypotheses"].where(mark="burnout")
    series = {sensor: rises.where(sensor=sensor) for sensor in rises.names("sensor")}
    series["imm, after burnout"] = Table(row for row in burnout if row["auroc"] != "")
    for name, rows in series.items():
        axes.plot(rows.column("left_out"), rows.column("auroc"), "o", label=name)
    axes.axhline(0.5, color=GREY, linewidth=0.8)
    axes.set(ylabel='AUROC of "none of these"')
    axes.tick_params(axis="x", rotation=40)


def draw_ranks(axes, table):
    """Draw the p of the tests of ranks, by time."""
    ranks = Table(row for row in table if row["p"] != "")
    for since_s in sorted(set(ranks.column("since_first_detection_s"))):
        rows = ranks.where(since_first_detection_s=since_s)
        axes.plot(rows.column("quantity"), rows.column("p"), "o", label=f"{since_s:g} s")
    axes.axhline(LEAST_P, color=GREY, linewidth=0.8)
    axes.set(yscale="log", ylabel="p of the ranks of imm")
    axes.tick_params(axis="x", rotation=40)


def draw_reliability(axes, table, stated):
    """Draw shares that are right against stated probabilities, by sensor."""
    axes.plot([0.0, 1.0], [0.0, 1.0], color=GREY, linewidth=0.8)
    for sensor in table.names("sensor"):
        rows = Table(row for row in table.where(sensor=sensor) if row["events"] >= ENOUGH)
        axes.plot(rows.column(stated), rows.column("right"), "o", markersize=3, label=sensor)
    axes.set(xlabel=stated, ylabel="share that is right")


def measure(options):
    """Run the parts, and write their tables into the folder."""
    for name in options.only:
        selected = PARTS[name]
        tables = selected.rows(lambda count: max(4, round(options.scale * count)))
        for title, rows in zip(selected.tables, tables, strict=True):
            table = [printed(row) for row in rows]
            if options.write:
                write_csv(options.write / f"{title}.csv", table)


def main():
    """Measure and write; the page if the data of all parts are there."""
    options = options_of(__doc__, only=tuple(PARTS), scale=1.0)
    if not options.from_csv:
        measure(options)
    folder = options.from_csv or options.write
    if folder and all((folder / f"{name}.csv").exists() for name in TABLES):
        tables = {name: read_csv(folder / f"{name}.csv") for name in TABLES}
        (folder / "calibration.md").write_text(page(tables), encoding="utf-8")
        draw(folder / "calibration.svg", tables)


if __name__ == "__main__":
    main()
