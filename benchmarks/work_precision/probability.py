"""Probabilities of detection between knots: run time against error, beside every look evaluated and beside a constant.

    python benchmarks/work_precision/probability.py [--every 20] [--looks 20000] [--repeat 3] [--write docs/benchmarks]

The launches of examples/raid_100.yaml, all three constellations. The table of tolerances has some of the launches;
errors are those of random looks against the exact ones. Detections are those of one seed: with the same dice a look
changes only where its number lies between both probabilities. The table of ratios has all hundred launches, at the
default tolerance, and medians; times are processor time of one core: of the engine, of `simulate`, and of the whole
process `opir run`.
`--write` puts the tables, and, where matplotlib is installed, a plot into a folder.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

import opir_core as opir
from opir_core.planning.looks import Looks, blocks, exposures
from opir_core.planning.plan import Plan
from opir_core.planning.sensor_states import SensorStates
from opir_core.simulation.engine import Engine
from opir_core.simulation.run import plan_windows

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "raid_100.yaml"
AIR = {"atmosphere": {"model": "lowtran", "climate": "midlat_summer"}, "background": "earth"}
CHAINS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "empty space": ({}, {}),
    "air, before the Earth": ({}, AIR),
    "calibrated, empty space": ({"calibrate": "paper"}, {}),
    "calibrated, air, before the Earth": ({"calibrate": "paper"}, AIR),
}
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8)

#: Runs of the engine, and of `simulate`, to each whole process: they are short, and machines are noisy.
_COLUMNS, _RUNS = 5, 3

#: How many times what a constant takes the chain may cost.
_BAR = 1.5

_WAYS = ("the engine alone", "`simulate`", "`opir run`")

PAGE = """# Probability of detection: work and precision

Made by `python benchmarks/work_precision/probability.py --write docs/benchmarks`. The launches of
[the raid](../../examples/raid_100.yaml), seen by all three constellations; processor time of one core.

## At the default tolerance, beside a constant

All hundred launches, {looks} looks, each chain in turn. "Engine" is from a compiled plan to windows of columns,
medians of {columns}; `simulate` is what a Python program calls, from the scene to the run with its summary, medians of
{runs}; `opir run` the whole process from the scene's file to one of JSON lines, with imports, encoding and writing,
medians of {repeat}. Chains without calibration report one event in six more than `constant` does, and exceedances of
noise.

{ratios}

The bar is 1.5 times `constant`. {verdict}

## Tolerances

Every {every}th launch. Errors are differences of P_d at {sample} random looks from what `exact: true` evaluates;
"changed" are looks that detect with one and not with the other, by the same dice. A look with `constant` took
{constant_ns:.0f} ns. In the time of the others are the sensors' exceedances of noise, as many as before a hundred
launches.

{table}

![Error against time](probability.svg)
"""


class Row(NamedTuple):
    """One line of the table of tolerances."""

    chain: str
    tolerance: float
    knots: int
    most: float
    mean: float
    detections: int
    changed: int
    nanoseconds: float


def raid(every: int, detection: Any, sky: dict[str, Any], path: Path | None = None) -> dict[str, Any]:
    """Return the scene with every so many of its launches, as plain values."""
    scene = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8"))
    outputs = [] if path is None else [{"jsonl": {"path": str(path)}}]
    return {**scene, "targets": scene["targets"][::every], "detection": detection, "outputs": outputs, **sky}


def planned(every: int, detection: Any, sky: dict[str, Any]) -> Plan:
    """Return the plan of such a scene."""
    return opir.compile_plan(opir.scene_from_mapping(raid(every, detection, sky)))


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
    sites, parts = SensorStates.of(plan.sensors), []
    for block in blocks(len(rows)):
        row = rows[block]
        parts.append(
            plan.detection.probability(exposures(plan, sites, looks.pair[row], looks.scan[row], geometry=True))
        )
    return np.concatenate(parts)


def measured(chain: str, options: argparse.Namespace) -> list[Row]:
    """Return the lines of one chain: all tolerances, and exact."""
    settings, sky = CHAINS[chain]
    exact = planned(options.every, {"model": "snr", "exact": True, **settings}, sky)
    looks = Looks.between(exact.pairs, 0, exact.end_ns)
    rows = np.sort(np.random.default_rng(1).choice(len(looks.pair), min(options.looks, len(looks.pair)), replace=False))
    true, known = exact_probability(exact, looks, rows), found(exact)
    lines = []
    for tolerance in TOLERANCES:
        plan = planned(options.every, {"model": "snr", "probability_tolerance": tolerance, **settings}, sky)
        knots = Engine(plan)._knots
        assert knots is not None
        off = np.abs(knots.over(looks).probability()[rows] - true)
        own = found(plan)
        changed = len(np.setxor1d(own, known, assume_unique=True))
        spent_s = median_s(lambda plan=plan: drained(plan), options.repeat)
        nanoseconds = 1e9 * spent_s / len(looks.pair)
        lines.append(
            Row(
                chain, tolerance, knots.at.shape[1], float(off.max()), float(off.mean()), len(own), changed, nanoseconds
            )
        )
    spent_s = median_s(lambda: drained(exact), 1)
    return [*lines, Row(chain, 0.0, len(looks.pair), 0.0, 0.0, len(known), 0, 1e9 * spent_s / len(looks.pair))]


def median_s(action: Callable[[], object], repeat: int) -> float:
    """Return the median processor time of an action, after one call that is not counted unless it is the only one."""
    times = []
    for _ in range(repeat + (repeat > 1)):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return statistics.median(times[repeat > 1 :])


def ratios(repeat: int) -> tuple[str, list[float], int]:
    """Return the table of all hundred launches, the largest ratio of each way to run them, and how many looks."""
    chains = {"constant": ("constant", {}), **{k: ({"model": "snr", **s}, sky) for k, (s, sky) in CHAINS.items()}}
    plans = {name: planned(1, *parts) for name, parts in chains.items()}
    scenes = {name: opir.scene_from_mapping(raid(1, *parts)) for name, parts in chains.items()}
    files = {name: raid(1, *parts, Path("events.jsonl")) for name, parts in chains.items()}
    ways: list[tuple[int, Callable[[str], float]]] = [
        (_COLUMNS * repeat, lambda name: median_s(lambda: drained(plans[name]), 1)),
        (_RUNS * repeat, lambda name: median_s(lambda: opir.simulate(scenes[name]), 1)),
        (repeat, lambda name: process_s(files[name])),
    ]
    for plan in plans.values():
        drained(plan)
    # Chains take turns, so that a machine's moods are shared.
    rounds = [[{name: way(name) for name in chains} for _ in range(times)] for times, way in ways]
    of = {name: [statistics.median(turn[name] for turn in turns) for turns in rounds] for name in chains}
    base = of["constant"]
    lines = [
        f"| {name} | " + " | ".join(f"{s:.2f} | {s / b:.2f}" for s, b in zip(own, base, strict=True)) + " |"
        for name, own in of.items()
    ]
    head = (
        "| chain | engine, s | times `constant` | `simulate`, s | times | `opir run`, s | times |\n" + "|---" * 7 + "|"
    )
    worst = [max(own[way] for own in of.values()) / base[way] for way in range(len(ways))]
    return "\n".join([head, *lines]), worst, int(plans["constant"].pairs.looks.sum())


def verdict(worst: Sequence[float]) -> str:
    """Return what the largest ratio of each way to run makes of the bar."""
    told = ", ".join(f"{way} {times:.2f}" for way, times in zip(_WAYS, worst, strict=True))
    over = [way for way, times in zip(_WAYS, worst, strict=True) if times > _BAR]
    return f"Of the dearest chain it is: {told}. " + (
        f"It is not held by {', '.join(over)}." if over else "All hold it."
    )


def process_s(scene: dict[str, Any]) -> float:
    """Return the processor time of a whole process that runs a scene."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        path.write_text(yaml.safe_dump(scene), encoding="utf-8")
        before = os.times()
        command = [sys.executable, "-m", "opir_core", "run", str(path)]
        subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        after = os.times()
        return after.children_user + after.children_system - before.children_user - before.children_system


def table(rows: list[Row]) -> str:
    """Return the lines as a Markdown table."""
    head = (
        "| chain | tolerance | knots | largest error | mean error | detections | changed | ns a look |\n"
        "|---|---|---|---|---|---|---|---|"
    )
    lines = [
        f"| {r.chain} | {f'{r.tolerance:.0e}' if r.tolerance else 'exact'} | {r.knots} | {r.most:.1e} | {r.mean:.1e}"
        f" | {r.detections} | {r.changed} | {r.nanoseconds:.0f} |"
        for r in rows
    ]
    return "\n".join([head, *lines])


def write_plot(rows: list[Row], constant_ns: float, path: Path) -> None:
    """Write error against time."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(7, 4), constrained_layout=True)
    for chain in CHAINS:
        own = [r for r in rows if r.chain == chain and r.tolerance]
        line = axis.plot([r.nanoseconds for r in own], [r.most for r in own], "o-", label=chain)[0]
        exact_ns = next(r.nanoseconds for r in rows if r.chain == chain and not r.tolerance)
        axis.axvline(exact_ns, color=line.get_color(), linestyle=":", linewidth=1)
    axis.axvline(constant_ns, color="black", linestyle="--", linewidth=1, label="constant")
    axis.set(
        xscale="log", yscale="log", xlabel="ns a look (dotted: every look evaluated)", ylabel="largest error of P_d"
    )
    axis.legend(fontsize=8)
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Measure and print; write where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--every", type=int, default=20)
    parser.add_argument("--looks", type=int, default=20_000)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--write", type=Path)
    options = parser.parse_args()
    shown, worst, looks = ratios(options.repeat)
    print(shown, verdict(worst), sep="\n\n")
    constant = planned(options.every, "constant", {})
    constant_ns = 1e9 * median_s(lambda: drained(constant), options.repeat) / int(constant.pairs.looks.sum())
    rows = [row for chain in CHAINS for row in measured(chain, options)]
    text = table(rows)
    print(text)
    if options.write:
        values = {"ratios": shown, "verdict": verdict(worst), "table": text, "looks": looks, "constant_ns": constant_ns}
        page = PAGE.format(
            every=options.every,
            repeat=options.repeat,
            columns=_COLUMNS * options.repeat,
            runs=_RUNS * options.repeat,
            sample=options.looks,
            **values,
        )
        (options.write / "probability.md").write_text(page, encoding="utf-8")
        write_plot(rows, constant_ns, options.write / "probability.svg")


if __name__ == "__main__":
    main()
