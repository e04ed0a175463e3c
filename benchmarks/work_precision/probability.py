"""Interpolated probabilities of detection: run time against error, beside every look evaluated and
beside a constant.

    python benchmarks/work_precision/probability.py [--every 20] [--looks 20000] [--repeat 3]
        [--thin 1] [--tolerances 1e-2 1e-3 1e-4 1e-6 1e-8] [--chains NAME ...] [--write FOLDER]
        [--from-csv FOLDER]

The launches of examples/raid_100.yaml, all three constellations. The table of tolerances has some
of the launches; errors are those of random looks against the exact ones. Detections are those of
one seed: with the same random numbers a look changes only where its number lies between both
probabilities. The table of chains has all hundred launches (`--thin N`: every N-th of them) at the
default tolerance, and medians; times are processor time of one core: of the engine, of `simulate`,
and of the whole process `opir run`. `--write` puts the page, its data as CSV files and, where
matplotlib is installed, a plot into a folder; `--from-csv` draws page and plot again from the CSV
files in a folder.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from results_csv import read_csv, write_csv

import opir_core as opir
from opir_core.planning.looks import Looks, blocks
from opir_core.planning.plan import Plan
from opir_core.simulation.probability import interpolant_of
from opir_core.simulation.run import plan_windows

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "raid_100.yaml"
AIR = {"atmosphere": {"model": "lowtran", "climate": "midlat_summer"}, "background": "earth"}
#: The same looks with and without light: DSP has one preset in both.
SENSORS = [
    {"constellation": "DSP", "preset": "heritage"},
    {"constellation": "SBIRS-GEO"},
    {"constellation": "NEXTGEN-GEO"},
]
CHAINS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "empty space": ({}, {}),
    "atmosphere and Earth": ({}, AIR),
    "calibrated, empty space": ({"calibrate": "paper"}, {}),
    "calibrated, atmosphere and Earth": ({"calibrate": "paper"}, AIR),
}
TOLERANCES = [1e-2, 1e-3, 1e-4, 1e-6, 1e-8]

#: Runs of the engine, and of `simulate`, to each whole process: they are short, and machines are
#: noisy.
_COLUMNS = 5
_RUNS = 3

#: The largest ratio to `detection: constant` that a chain should have.
_BAR = 1.5

_DEFAULT = 1e-4

_WAYS = ("engine", "simulate", "opir_run")

PAGE = """# Interpolated probability of detection: error and run time

*What does `detection: snr` cost, and how exact are its probabilities?* With the default classifier, `spectral`, a look
through atmosphere and Earth takes {default_ns} ns, nearly all for types. The rest of this page is of P_d alone, with
`classification: paper`, which knows the true types and costs next to nothing. At the default `probability_tolerance` of
1e-4:

{headline}

*Changed*: looks that detect with interpolation and not without it, or the reverse. *Every look*: `exact: true`, which
evaluates all {exact_looks} looks. *Atmosphere and Earth*: `lowtran`, `midlat_summer`, background `earth`; *calibrated*:
`calibrate: paper`.

![Largest error of P_d against time per look, by chain and tolerance](probability.svg)

Errors are differences of P_d from `exact: true` at {sample} random looks, for every {every}th launch of
[the raid](../../examples/raid_100.yaml), seen by all three constellations, DSP with its preset `heritage`. A look with
`detection: constant` takes {constant_ns} ns.

The goal is at most 1.5 times the run time of `detection: constant`. {verdict} They are over all hundred launches,
{looks} looks, with medians of {columns}, {runs} and {repeat} runs. All data: [probability.csv](probability.csv),
[probability_chains.csv](probability_chains.csv).
"""


class Chain(NamedTuple):
    """Run times of one chain, s, and their ratios to those of `constant`."""

    chain: str
    engine_s: float
    engine_ratio: float
    simulate_s: float
    simulate_ratio: float
    opir_run_s: float
    opir_run_ratio: float


class Row(NamedTuple):
    """One chain at one tolerance, 0 for every look: evaluated looks, errors of P_d, detections,
    time per look.
    """

    chain: str
    tolerance: float
    points: int
    most: float
    mean: float
    detections: int
    changed: int
    nanoseconds: float


@cache
def example() -> dict[str, Any]:
    """Return the example, as plain values."""
    found: dict[str, Any] = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8"))
    return found


def raid(
    every: int, detection: Any, sky: dict[str, Any], path: Path | None = None
) -> dict[str, Any]:
    """Return the scene with every n-th of its launches, as plain values; its types cost nothing."""
    scene = example()
    outputs = [] if path is None else [{"jsonl": {"path": str(path)}}]
    return {
        **scene,
        "sensors": SENSORS,
        "targets": scene["targets"][::every],
        "detection": detection,
        "classification": "paper",
        "outputs": outputs,
        **sky,
    }


def planned(every: int, detection: Any, sky: dict[str, Any], *overrides: str) -> Plan:
    """Return the plan of such a scene."""
    scene = opir.scene_from_mapping(raid(every, detection, sky), overrides=overrides)
    return opir.compile_plan(scene)


def nanoseconds_per_look(plan: Plan, repeat: int) -> float:
    """Return the processor time of a look of a plan, ns."""
    return 1e9 * median_s(lambda: drained(plan), repeat) / int(plan.pairs.looks.sum())


def drained(plan: Plan) -> None:
    """Run a plan, keeping nothing."""
    for _ in plan_windows(plan):
        pass


def found(plan: Plan) -> np.ndarray:
    """Return the ids of all detections of targets, as bytes."""
    windows = list(plan_windows(plan))
    ids = [window.detections.detection_id[window.truth.target >= 0] for window in windows]
    return np.unique(np.concatenate(ids).view("V16").ravel())


def exact_probability(plan: Plan, looks: Looks, rows: np.ndarray) -> np.ndarray:
    """Return P_d of some of the looks."""
    geometry = plan.look_geometry()
    parts = []
    for block in blocks(len(rows)):
        row = rows[block]
        parts.append(
            plan.detection.probability(geometry.exposures(looks.pair[row], looks.scan[row]))
        )
    return np.concatenate(parts)


def measured(chain: str, options: argparse.Namespace) -> list[Row]:
    """Return the lines of one chain: all tolerances, and exact."""
    settings, sky = CHAINS[chain]
    exact = planned(options.every, {"model": "snr", "exact": True, **settings}, sky)
    looks = Looks.between(exact.pairs, 0, exact.end_ns)
    rows = np.sort(
        np.random.default_rng(1).choice(
            len(looks.pair), min(options.looks, len(looks.pair)), replace=False
        )
    )
    true = exact_probability(exact, looks, rows)
    known = found(exact)
    lines = []
    for tolerance in options.tolerances:
        plan = planned(
            options.every, {"model": "snr", "probability_tolerance": tolerance, **settings}, sky
        )
        knots = interpolant_of(plan, plan.look_geometry())
        assert knots is not None
        off = np.abs(knots.over(looks).probability()[rows] - true)
        own = found(plan)
        changed = len(np.setxor1d(own, known, assume_unique=True))
        spent_s = median_s(lambda plan=plan: drained(plan), options.repeat)
        nanoseconds = 1e9 * spent_s / len(looks.pair)
        lines.append(
            Row(
                chain,
                tolerance,
                knots.at.shape[1],
                float(off.max()),
                float(off.mean()),
                len(own),
                changed,
                nanoseconds,
            )
        )
    spent_s = median_s(lambda: drained(exact), 1)
    return [
        *lines,
        Row(chain, 0.0, len(looks.pair), 0.0, 0.0, len(known), 0, 1e9 * spent_s / len(looks.pair)),
    ]


def median_s(action: Callable[[], object], repeat: int) -> float:
    """Return the median processor time of an action, after one call that is not counted unless it
    is the only one.
    """
    times = []
    for _ in range(repeat + (repeat > 1)):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return statistics.median(times[repeat > 1 :])


def scene_parts(chain: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return `detection` of a chain's scene, and its atmosphere and background."""
    settings, sky = CHAINS[chain]
    return {"model": "snr", **settings}, sky


def chain_times(repeat: int, every: int, names: Sequence[str]) -> tuple[list[Chain], int]:
    """Return the run times of every n-th of the hundred launches by chain, and the number of
    looks.
    """
    chains = {"constant": ("constant", {}), **{name: scene_parts(name) for name in names}}
    plans = {name: planned(every, *parts) for name, parts in chains.items()}
    scenes = {name: opir.scene_from_mapping(raid(every, *parts)) for name, parts in chains.items()}
    files = {name: raid(every, *parts, Path("events.jsonl")) for name, parts in chains.items()}
    ways: list[tuple[int, Callable[[str], float]]] = [
        (_COLUMNS * repeat, lambda name: median_s(lambda: drained(plans[name]), 1)),
        (_RUNS * repeat, lambda name: median_s(lambda: opir.simulate(scenes[name]), 1)),
        (repeat, lambda name: process_s(files[name])),
    ]
    for plan in plans.values():
        drained(plan)
    # Chains are run in turn, so that changes of the machine's load affect all of them.
    rounds = [[{name: way(name) for name in chains} for _ in range(times)] for times, way in ways]
    of = {
        name: [statistics.median(turn[name] for turn in turns) for turns in rounds]
        for name in chains
    }
    base = of["constant"]
    found = [
        Chain(name, *(value for s, b in zip(own, base, strict=True) for value in (s, s / b)))
        for name, own in of.items()
    ]
    return found, int(plans["constant"].pairs.looks.sum())


def chains_table(found: list[Chain]) -> str:
    """Return the run times and ratios by chain."""
    lines = [
        "| chain | engine, s | ratio | `simulate`, s | ratio | `opir run`, s | ratio |",
        "|---" * 7 + "|",
    ]
    lines += [
        f"| {row.chain} | " + " | ".join(f"{value:.2f}" for value in row[1:]) + " |"
        for row in found
    ]
    return "\n".join(lines)


def verdict(found: list[Chain]) -> str:
    """Return the largest ratio of each way to run, and which ways miss the goal."""
    worst = {way: max(getattr(row, f"{way}_ratio") for row in found) for way in _WAYS}
    names = {"engine": "the engine alone", "simulate": "`simulate`", "opir_run": "`opir run`"}
    listed = ", ".join(f"{names[way]} {ratio:.2f}" for way, ratio in worst.items())
    over = [names[way] for way, ratio in worst.items() if ratio > _BAR]
    return (
        f"The largest ratios: {listed}. "
        + (f"{', '.join(over)} misses it." if over else "All meet it.").capitalize()
    )


def process_s(scene: dict[str, Any]) -> float:
    """Return the processor time of a whole process that runs a scene."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        path.write_text(yaml.safe_dump(scene), encoding="utf-8")
        before = os.times()
        command = [sys.executable, "-m", "opir_core", "run", str(path)]
        subprocess.run(
            command, cwd=folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        after = os.times()
        return (
            after.children_user
            + after.children_system
            - before.children_user
            - before.children_system
        )


def headline(rows: list[Row]) -> str:
    """Return a line for each chain at the default tolerance."""
    lines = [
        "| chain | largest error | detections | changed | ns per look | every look, ns |",
        "|---" * 6 + "|",
    ]
    for row in rows:
        if row.tolerance == _DEFAULT:
            exact_ns = next(r.nanoseconds for r in rows if r.chain == row.chain and not r.tolerance)
            cells = f"{row.most:.1e} | {row.detections} | {row.changed}"
            lines.append(f"| {row.chain} | {cells} | {row.nanoseconds:.0f} | {exact_ns:.0f} |")
    return "\n".join(lines)


def write_plot(rows: list[Row], constant_ns: float, path: Path) -> None:
    """Write error against time."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(7, 4), constrained_layout=True)
    for chain in dict.fromkeys(row.chain for row in rows):
        own = [r for r in rows if r.chain == chain and r.tolerance]
        line = axis.plot([r.nanoseconds for r in own], [r.most for r in own], "o-", label=chain)[0]
        exact_ns = next(r.nanoseconds for r in rows if r.chain == chain and not r.tolerance)
        axis.axvline(exact_ns, color=line.get_color(), linestyle=":", linewidth=1)
    axis.axvline(constant_ns, color="black", linestyle="--", linewidth=1, label="constant")
    axis.set(
        xscale="log",
        yscale="log",
        xlabel="time per look, ns (dotted: every look evaluated)",
        ylabel="largest error of P_d",
    )
    axis.legend(fontsize=8)
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Measure and print; write where asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--every", type=int, default=20)
    parser.add_argument("--looks", type=int, default=20_000)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument(
        "--thin", type=int, default=1, help="every N-th of the launches for whole runs"
    )
    parser.add_argument("--tolerances", type=float, nargs="+", default=TOLERANCES)
    parser.add_argument("--chains", nargs="+", choices=tuple(CHAINS), default=tuple(CHAINS))
    parser.add_argument("--write", type=Path)
    parser.add_argument("--from-csv", type=Path)
    options = parser.parse_args()
    if options.from_csv:
        redraw(options.from_csv)
        return
    found, looks = chain_times(options.repeat, options.thin, options.chains)
    print(chains_table(found), verdict(found), sep="\n\n")
    constant_ns = nanoseconds_per_look(planned(options.every, "constant", {}), options.repeat)
    spectral = planned(
        options.every, *scene_parts("atmosphere and Earth"), "classification=spectral"
    )
    default_ns = nanoseconds_per_look(spectral, options.repeat)
    rows = [row for chain in options.chains for row in measured(chain, options)]
    print(headline(rows))
    if options.write:
        facts = {
            "every": options.every,
            "sample": options.looks,
            "constant_ns": f"{constant_ns:.0f}",
            "default_ns": f"{default_ns:.0f}",
            "looks": looks,
            "columns": _COLUMNS * options.repeat,
            "runs": _RUNS * options.repeat,
            "repeat": options.repeat,
        }
        write_csv(options.write / "probability.csv", rows, facts)
        write_csv(options.write / "probability_chains.csv", found)
        redraw(options.write)


def redraw(folder: Path) -> None:
    """Write the page and the plot from the CSV files of a folder."""
    rows, facts = read_csv(folder / "probability.csv", Row)
    found, _ = read_csv(folder / "probability_chains.csv", Chain)
    text = PAGE.format(
        headline=headline(rows),
        verdict=verdict(found),
        exact_looks=next(row.points for row in rows if not row.tolerance),
        **facts,
    )
    (folder / "probability.md").write_text(text, encoding="utf-8")
    write_plot(rows, float(facts["constant_ns"]), folder / "probability.svg")


if __name__ == "__main__":
    main()
