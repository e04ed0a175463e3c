"""Calibration of every hypothesis, and whether "none of these" rises for a class left out of the
training.

    python benchmarks/left_out_classes.py [--launches 100] [--sources 150] [--seed 2] [--write
    docs/benchmarks]

Launches of all seven classes, fires, gas flares and false alarms are simulated once for each class,
and for the sources on the ground, left out of the classifier's prior and training, and once with
nothing left out. The prior is that of the simulation. An event counts for each hypothesis with the
probability that the classifier gives it, in bins of probability; those of what is left out are of
"none of these".
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from calibration import (
    ENOUGH,
    SENSORS as OBSERVERS,
    SHINING_S,
    SOURCES,
    WITHIN,
    bin_numbers,
    seen_scene,
    sourced,
)
from discrimination_objects import BRIGHTNESS, COLOUR, PROPELLANTS, moved, place, seen_from
from discrimination_statistics import area
from numpy.typing import NDArray
from work_precision.results_csv import write_csv

import opir_core as opir
from opir_core.arrays import FloatArray, IntArray
from opir_core.scene import core_hypotheses
from opir_core.scene.target_classes import OrbitInsertion, TargetClass

HYPOTHESES = core_hypotheses()
NAMES = [each.name for each in HYPOTHESES]
CLASSES = [each.target_class for each in HYPOTHESES if each.target_class is not None]
NOISE = NAMES.index("noise")
GROUND = NAMES.index("ground source")
NONE = NAMES.index("none of these")
EVERY = "nothing"
SOURCES_LEFT = "ground source"
LEFT_OUT = (EVERY, *(kind.name for kind in CLASSES), SOURCES_LEFT)
PERIOD_S = 4.0
DURATION_S = 512.0
SENSORS = {name: settings for name, settings in OBSERVERS.items() if name != "DSP-unconfirmed"}
#: Edges of the bins: near 0 and 1 finer.
EDGES = np.array([0.0, 0.02, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.98, 1.0])
#: Share of false alarms at which the share of correct answers is printed.
FALSE_SHARE = 0.1


PAGE = """# Classes left out

*Are the probabilities of the classifier right, and does "none of these" rise for what it does not know?* With every
class known, probabilities hold within {within:.0f} points in {good} of {bins} bins. Without one, "none of these" rises
where no other class looks like it, and cannot where one does.

**Every class known.** By bins of the probability of any hypothesis: mean probability, share of the events for which the
hypothesis is right, and events. Bold: more than {within:.0f} points off, of bins of at least {enough} events.

{whole}

**One class left out, each in turn.** The same; events of the class left out are right as "none of these". They fall to
the class that looks like them, so no classifier of a detection's light is calibrated here.

{partial}

**How "none of these" rises.** AUROC over events of what is left out against those of known launches; means of
P(none of these); OSCR, the area under correct classification against false positives, and its height at 10 % of false
positives; and what the left-out is taken for, with its mean probability. Classes with DSP, one band, are in the file.

{rises}

Classes that cover one another cannot raise "none of these" by light: an MRBM is one of the two boosts of the class
IRBM, HGV lies between IRBM and SLBM, SLBM between IRBM and ICBM, ICBM between SLBM and SLV; their colours are alike.
SRBM and SLV are the ends of the range. Motion separates them, in [the trackers](../explanation/imm.md).

**Method.** {launches} launches of each of seven classes, {sources} fires and gas flares each, and noise, seed {seed};
{duration:g} s with a look every {period:g} s (default: 10, 0.1 and 0.05 s) by day in clear air; all else of the
sensors is default: focal planes, DSP with its preset `heritage`. Places, headings, ranges and brightnesses are from the
distributions that the classifier assumes, its prior is that of the simulation, `unknown_per_day` the rate of the class
left out. Events of one launch share its brightness, so a bin of {enough} events may hold few launches. All bins:
[left_out_bins.csv](left_out_bins.csv), all classes: [left_out_classes.csv](left_out_classes.csv).
"""


class Bin(NamedTuple):
    """Events of a sensor for which some hypothesis has a probability in a bin: their number, its
    mean, and the share for which it is right.
    """

    sensor: str
    left_out: str
    lower: float
    events: int
    probability: float
    right: float


class Rise(NamedTuple):
    """How "none of these" rises for a class left out, by sensor: AUROC over events, its means, and
    OSCR.

    `known` and `unknown` are the mean probabilities of "none of these", `known_95` the 95th
    percentile for the known; `oscr` is the area under the curve of correct classification against
    false positives, `correct` its height at `FALSE_SHARE`. `alike` is the class that the left-out
    one is taken for most, with the mean probability.
    """

    sensor: str
    left_out: str
    auroc: float
    known: float
    known_95: float
    unknown: float
    oscr: float
    correct: float
    alike: str
    as_alike: float


def launched(rng: np.random.Generator, kind: TargetClass, number: int) -> dict[str, Any]:
    """Return a launch of a class: place, direction, range and brightness drawn as the classifier
    assumes.
    """
    profile = kind.profiles[int(rng.integers(len(kind.profiles)))]
    latitude, longitude = seen_from(np.arcsin(rng.uniform(0.03, 1.0)), 2.0 * np.pi * rng.random())
    limits = np.log(
        [1.02 * max(profile.minimum_range_m, 5e4), min(profile.maximum_range_m, 1.5e7) / 1.02]
    )
    range_km = float(np.exp(rng.uniform(*limits))) / 1e3
    heading = 2.0 * np.pi * rng.random()
    spread = BRIGHTNESS * rng.standard_normal() + COLOUR * rng.standard_normal(3)
    peaks = kind.plume(profile.name).peak_w_sr
    target = {
        "id": f"{kind.name}-{number}",
        "type": kind.name,
        "launch": place(latitude, longitude),
        "signature": {
            "model": "plume",
            "propellant": str(rng.choice(PROPELLANTS)),
            "peak_w_sr": {
                band: float(peak * np.exp(more))
                for (band, peak), more in zip(peaks.items(), spread, strict=True)
            },
        },
    }
    if isinstance(kind.after_burnout, OrbitInsertion):
        return {**target, "azimuth_deg": float(np.degrees(heading) % 360.0)}
    own = {"profile": profile.name} if len(kind.profiles) > 1 else {}
    return {**target, **own, "aim": place(*moved(latitude, longitude, range_km / 6371.0, heading))}


def scene(launches: int, sources: int, seed: int, left_out: str) -> dict[str, Any]:
    """Return a scene with launches of every class and sources, and a prior that says so, without a
    class.
    """
    rng = np.random.default_rng([seed, 31])
    targets = [launched(rng, kind, number) for kind in CLASSES for number in range(launches)]
    known = [kind.name for kind in CLASSES if kind.name != left_out]
    per_day = 86_400.0 / DURATION_S
    in_view = (
        {}
        if left_out == SOURCES_LEFT
        else {kind: sources * SHINING_S[kind] / DURATION_S for kind in SOURCES}
    )
    classification = {
        "model": "spectral",
        "launches_per_day": per_day * launches * len(known),
        "prior": dict.fromkeys(known, 1.0 / len(known)),
        "sources_in_view": in_view,
        "bolides_per_day": 0.0,
        "unknown_per_day": per_day
        * {EVERY: 1e-3, SOURCES_LEFT: 2.0 * sources}.get(left_out, float(launches)),
    }
    found = seen_scene(
        SENSORS,
        PERIOD_S,
        DURATION_S,
        seed,
        targets,
        [sourced(rng, kind, sources) for kind in SOURCES],
    )
    return {**found, "classification": classification}


def truths(mapping: Mapping[str, Any], sources: int, left_out: str) -> IntArray:
    """Return the numbers of the true hypotheses of the emitters, and last that of false alarms."""
    kinds = [
        NONE if target["type"] == left_out else NAMES.index(target["type"])
        for target in mapping["targets"]
    ]
    ground = NONE if left_out == SOURCES_LEFT else GROUND
    return np.array([*kinds, *[ground] * (sources * len(SOURCES)), NOISE])


def bins(sensor: str, left_out: str, probability: FloatArray, true: IntArray) -> list[Bin]:
    """Return the bins of events (n, hypotheses)."""
    is_true = np.arange(probability.shape[1]) == true[:, None]
    number = bin_numbers(probability, EDGES)
    rows = []
    for place_ in range(len(EDGES) - 1):
        here = number == place_
        if here.any():
            means = float(probability[here].mean()), float(is_true[here].mean())
            rows.append(
                Bin(sensor, left_out, float(EDGES[place_]), int(here.any(axis=1).sum()), *means)
            )
    return rows


def oscr(
    known: FloatArray, is_right: NDArray[np.bool_], unknown: FloatArray
) -> tuple[float, float]:
    """Return the area under the curve of correct classification against false positives, and its
    height.

    Scores of known events (n,), whether their class is right, and scores of unknown ones: the
    largest probability of a known hypothesis (Dhamija, Günther and Boult, Reducing network
    agnostophobia, 2018).
    """
    levels = np.sort(np.concatenate([known, unknown]))[::-1]
    correct = np.searchsorted(np.sort(known[is_right]), levels, side="left")
    correct_share = (is_right.sum() - correct) / len(known)
    false_share = 1.0 - np.searchsorted(np.sort(unknown), levels, side="left") / len(unknown)
    height = float(np.interp(FALSE_SHARE, false_share, correct_share))
    return float(np.trapezoid(correct_share, false_share)), height


def rise(sensor: str, left_out: str, probability: FloatArray, true: IntArray) -> Rise:
    """Return how "none of these" rises for events of a class left out, against those of launches
    that are known.
    """
    unknown = true == NONE
    known = ~unknown & (true > GROUND)
    none = probability[:, NONE]
    best = probability.copy()
    best[:, NONE] = 0.0
    score = best.max(axis=1)
    choice = best.argmax(axis=1)
    means = best[unknown].mean(axis=0)
    return Rise(
        sensor,
        left_out,
        area(none[unknown], none[known])[0],
        float(none[known].mean()),
        float(np.quantile(none[known], 0.95)),
        float(none[unknown].mean()),
        *oscr(score[known], (choice == true)[known], score[unknown]),
        NAMES[int(means.argmax())],
        float(means.max()),
    )


def measured(launches: int, sources: int, seed: int) -> tuple[list[Bin], list[Rise]]:
    """Return the bins and rises with each class left out in turn."""
    found = list[Bin]()
    rises = list[Rise]()
    for left_out in LEFT_OUT:
        mapping = scene(launches, sources, seed, left_out)
        run = opir.simulate(opir.scene_from_mapping(mapping))
        true = truths(mapping, sources, left_out)[run.truth.target]
        probability = np.exp(run.detections.hypothesis_log_probability)
        for number, sensor in enumerate(SENSORS):
            own = run.detections.sensor == number
            found += bins(sensor, left_out, probability[own], true[own])
            if np.any(true[own] == NONE):
                rises.append(rise(sensor, left_out, probability[own], true[own]))
    return found, rises


def pooled(found: Sequence[Bin]) -> list[Bin]:
    """Return the bins of each sensor over all classes left out."""
    rows = []
    for sensor in SENSORS:
        for lower in EDGES[:-1].tolist():
            own = [row for row in found if row.sensor == sensor and row.lower == lower]
            events = sum(row.events for row in own)
            if events:
                means = (
                    sum(getattr(row, name) * row.events for row in own) / events
                    for name in ("probability", "right")
                )
                rows.append(Bin(sensor, "each", lower, events, *means))
    return rows


def bins_table(rows: Sequence[Bin]) -> str:
    """Return a line for each bin, with probability, share that is right and events of each
    sensor.
    """
    lines = [f"| P from | {' | '.join(SENSORS)} |", "|---" * (1 + len(SENSORS)) + "|"]
    for lower in EDGES[:-1].tolist():
        own = {row.sensor: row for row in rows if row.lower == lower}
        cells = [_bin_cell(own[sensor]) if sensor in own else "" for sensor in SENSORS]
        lines.append(f"| {lower:g} | {' | '.join(cells)} |")
    return "\n".join(lines)


def is_off(row: Bin) -> bool:
    """Return whether a bin of many events is far from the diagonal."""
    return row.events >= ENOUGH and abs(row.probability - row.right) > WITHIN


def _bin_cell(row: Bin) -> str:
    text = f"{row.probability:.2f}: {row.right:.2f} of {row.events}"
    return f"**{text}**" if is_off(row) else text


def rises_table(rises: Sequence[Rise]) -> str:
    """Return a line for each class left out and sensor."""
    lines = [
        (
            "| left out | sensor | AUROC | mean P(none): left out | known | OSCR | correct at 10 %"
            " false | taken for |"
        ),
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.left_out} | {row.sensor} | {row.auroc:.2f} | {row.unknown:.3f} | {row.known:.4f} |"
        f" {row.oscr:.2f} |"
        f" {row.correct:.2f} | {row.alike} {row.as_alike:.2f} |"
        for row in sorted(rises, key=lambda row: LEFT_OUT.index(row.left_out))
        if row.sensor != "DSP" or row.left_out == SOURCES_LEFT
    ]
    return "\n".join(lines)


def main() -> None:
    """Simulate, print and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--launches", type=int, default=100)
    parser.add_argument("--sources", type=int, default=150)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    found, rises = measured(arguments.launches, arguments.sources, arguments.seed)
    whole = [row for row in found if row.left_out == EVERY]
    large = [row for row in whole if row.events >= ENOUGH]
    text = PAGE.format(
        whole=bins_table(whole),
        good=sum(not is_off(row) for row in large),
        bins=len(large),
        partial=bins_table(
            pooled([row for row in found if row.left_out not in (EVERY, SOURCES_LEFT)])
        ),
        rises=rises_table(rises),
        launches=arguments.launches,
        sources=arguments.sources,
        seed=arguments.seed,
        period=PERIOD_S,
        duration=DURATION_S,
        enough=ENOUGH,
        within=100.0 * WITHIN,
    )
    print(text)
    if arguments.write:
        (arguments.write / "left_out_classes.md").write_text(text, encoding="utf-8")
        write_csv(arguments.write / "left_out_classes.csv", rises)
        write_csv(arguments.write / "left_out_bins.csv", found)


if __name__ == "__main__":
    main()
