"""Interpolated probabilities of detection: run time against error, beside every look evaluated and
beside a constant.

The launches of examples/raid_100.yaml, all three constellations. The table of tolerances has every
`--every`-th of the launches; errors are those of random looks against the exact ones. Detections
are those of one seed: with the same random numbers a look changes only where its number lies
between both probabilities. The table of chains has all hundred launches (`--thin N`: every N-th of
them) at the default tolerance, and medians; times are processor time of one core: of the engine, of
`simulate`, and of the whole process `opir run`.
"""

import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pages import Table, draw_lines, markdown_table, median_s, options_of, publish, svg_plot
from startup import process_s

import opir_core as opir
from opir_core.planning.looks import Looks, blocks
from opir_core.simulation.probability import interpolant_of

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "raid_100.yaml"
SCENE: dict[str, Any] = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8"))
AIR = {"atmosphere": {"model": "lowtran", "climate": "midlat_summer"}, "background": "earth"}
#: The same looks with and without light: DSP has one preset in both.
SENSORS = [
    {"constellation": "DSP", "preset": "heritage"},
    {"constellation": "SBIRS-GEO"},
    {"constellation": "NEXTGEN-GEO"},
]
#: Settings of `detection: snr`, and of atmosphere and background, by chain.
CHAINS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "empty space": ({}, {}),
    "atmosphere and Earth": ({}, AIR),
    "calibrated, empty space": ({"calibrate": "paper"}, {}),
    "calibrated, atmosphere and Earth": ({"calibrate": "paper"}, AIR),
}
DEFAULT_TOLERANCE = 1e-4
#: Ways to run by their column: the name, and the number of runs to one whole process, for they are
#: short, and machines are noisy.
WAYS = {
    "engine": ("the engine alone", 5),
    "simulate": ("`simulate`", 3),
    "opir_run": ("`opir run`", 1),
}
#: The largest ratio to `detection: constant` that a chain should have.
BAR = 1.5

PAGE = """# Interpolated probability of detection: error and run time

*What does `detection: snr` cost, and how exact are its probabilities?* With the default
classifier, `spectral`, a look through atmosphere and Earth takes {default_ns} ns, nearly all for
types, which are computed where something reads them, as here. `classification: paper` knows the
true types and costs next to nothing: it shows P_d alone, in the plot and in all rows but the last.
At the default `probability_tolerance` of 1e-4:

{headline}

*Changed*: looks that detect with interpolation and not without it, or the reverse. *Every look*:
`exact: true`, which evaluates all {exact_looks} looks. *Atmosphere and Earth*: `lowtran`,
`midlat_summer`, background `earth`.

![Largest error of P_d against time per look, by chain and tolerance](probability.svg)

Errors are differences of P_d from `exact: true` at {sample} random looks, for every {every}th
launch of [the raid](../../examples/raid_100.yaml), seen by all three constellations, DSP with its
preset `heritage`. A look with `detection: constant` and `classification: paper` takes
{constant_ns} ns; with the default `spectral`, a look through atmosphere and Earth takes
{default_ratio:.0f} times as long.

With `classification: paper` on both sides, the goal is at most 1.5 times the run time of
`detection: constant`. {verdict} They are over all hundred launches, {looks} looks, with medians of
{columns}, {runs} and {repeat} runs. All data:
[probability.csv](probability.csv), [probability_chains.csv](probability_chains.csv).
"""
HEAD = (
    "chain",
    "classification",
    "largest error",
    "detections",
    "changed",
    "ns per look",
    "every look, ns",
)


def raid(every, detection, sky, path=None):
    """Return the scene with every n-th of its launches; its types cost nothing."""
    return {
        **SCENE,
        "sensors": SENSORS,
        "targets": SCENE["targets"][::every],
        "detection": detection,
        "classification": "paper",
        "outputs": [] if path is None else [{"jsonl": {"path": str(path)}}],
        **sky,
    }


def raid_plan(every, chain, *overrides, **detection):
    """Return the plan of the scene; the chain `constant` has no light."""
    settings, sky = CHAINS.get(chain, ({}, {}))
    model = "constant" if chain == "constant" else {"model": "snr", **settings, **detection}
    scene = opir.scene_from_mapping(raid(every, model, sky), overrides=overrides)
    return opir.compile_plan(scene)


def drained(plan):
    """Run a plan and read its types, without which they are not computed."""
    for window in opir.plan_windows(plan):
        assert window.detections.reported_type is not None


def look_ns(plan, repeat):
    """Return the processor time of a look of a plan, ns."""
    taken_s = median_s(lambda: drained(plan), repeat, warm=repeat > 1)
    return 1e9 * taken_s / int(plan.pairs.looks.sum())


def detection_ids(plan):
    """Return the ids of all detections of targets, as bytes."""
    windows = list(opir.plan_windows(plan))
    ids = [window.detections.detection_id[window.truth.target >= 0] for window in windows]
    return np.unique(np.concatenate(ids).view("V16").ravel())


def exact_probability(plan, looks, rows):
    """Return P_d of some of the looks."""
    geometry = plan.look_geometry()
    parts = []
    for block in blocks(len(rows)):
        exposed = geometry.exposures(looks.pair[rows[block]], looks.scan[rows[block]])
        parts.append(plan.detection.probability(exposed))
    return np.concatenate(parts)


def chain_rows(chain, options):
    """Yield the rows of one chain: all tolerances, and every look evaluated (0)."""
    exact = raid_plan(options.every, chain, exact=True)
    looks = Looks.between(exact.pairs, 0, exact.end_ns)
    count = len(looks.pair)
    rng = np.random.default_rng(1)
    rows = np.sort(rng.choice(count, min(options.looks, count), replace=False))
    probability = exact_probability(exact, looks, rows)
    exact_ids = detection_ids(exact)
    for tolerance in options.tolerances:
        plan = raid_plan(options.every, chain, probability_tolerance=tolerance)
        knots = interpolant_of(plan, plan.look_geometry())
        assert knots is not None
        error = np.abs(knots.over(looks).probability()[rows] - probability)
        ids = detection_ids(plan)
        yield {
            "chain": chain,
            "tolerance": tolerance,
            "points": knots.at.shape[1],
            "most": float(error.max()),
            "mean": float(error.mean()),
            "detections": len(ids),
            "changed": len(np.setxor1d(ids, exact_ids, assume_unique=True)),
            "nanoseconds": look_ns(plan, options.repeat),
        }
    yield {
        "chain": chain,
        "tolerance": 0,
        "points": count,
        "most": 0.0,
        "mean": 0.0,
        "detections": len(exact_ids),
        "changed": 0,
        "nanoseconds": look_ns(exact, 1),
    }


def rows_of(options, facts):
    """Yield the rows of all chains."""
    constant = raid_plan(options.every, "constant")
    spectral = raid_plan(options.every, "atmosphere and Earth", "classification=spectral")
    facts |= {"every": options.every, "sample": options.looks}
    facts["constant_ns"] = round(look_ns(constant, options.repeat))
    facts["default_ns"] = round(look_ns(spectral, options.repeat))
    facts["looks"] = int(raid_plan(options.thin, "constant").pairs.looks.sum())
    counts = [runs * options.repeat for _, runs in WAYS.values()]
    facts |= dict(zip(("columns", "runs", "repeat"), counts, strict=True))
    for chain in options.chains:
        yield from chain_rows(chain, options)


def scene_s(scene):
    """Return the processor time of a whole process that runs a scene."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        path.write_text(yaml.safe_dump(scene), encoding="utf-8")
        return process_s([sys.executable, "-m", "opir_core", "run", str(path), "--quiet"], folder)


def time_rows(repeat, every, names):
    """Yield the run times of every n-th of the hundred launches by chain, and ratios to those
    without light.

    Chains are run in turn, so that changes of the machine's load affect all of them.
    """
    chains = ["constant", *names]
    plans = {name: raid_plan(every, name) for name in chains}

    def scene(name, path=None):
        settings, sky = CHAINS.get(name, ({}, {}))
        model = "constant" if name == "constant" else {"model": "snr", **settings}
        return raid(every, model, sky, path)

    scenes = {name: opir.scene_from_mapping(scene(name)) for name in chains}
    actions = {
        "engine": lambda name: median_s(lambda: drained(plans[name]), 1, warm=False),
        "simulate": lambda name: median_s(lambda: opir.simulate(scenes[name]), 1, warm=False),
        "opir_run": lambda name: scene_s(scene(name, Path("events.jsonl"))),
    }
    for plan in plans.values():
        drained(plan)
    times = {name: {} for name in chains}
    for way, action in actions.items():
        turns = [[action(name) for name in chains] for _ in range(WAYS[way][1] * repeat)]
        for name, taken in zip(chains, zip(*turns, strict=True), strict=True):
            times[name][way] = statistics.median(taken)
    for name, ways in times.items():
        row = {"chain": name}
        for way, taken_s in ways.items():
            ratio = taken_s / times["constant"][way]
            row |= {f"{way}_s": taken_s, f"{way}_ratio": ratio}
        yield row


def verdict(chains):
    """Return the largest ratio of each way to run, and which ways miss the goal."""
    worst = {name: max(chains.column(f"{way}_ratio")) for way, (name, _) in WAYS.items()}
    listed = ", ".join(f"{name} {ratio:.2f}" for name, ratio in worst.items())
    over = [name for name, ratio in worst.items() if ratio > BAR]
    end = f"Over the goal: {', '.join(over)}." if over else "All meet it."
    return f"The largest ratios: {listed}. {end}"


def page(table, chains):
    """Return the page."""
    lines = []
    for row in table.where(tolerance=DEFAULT_TOLERANCE):
        exact = table.row(chain=row["chain"], tolerance=0)
        times = (f"{row['nanoseconds']:.0f}", f"{exact['nanoseconds']:.0f}")
        counts = (row["detections"], row["changed"])
        chain = row["chain"].replace("calibrated", "`calibrate: paper`")
        lines.append((chain, "`paper`", f"{row['most']:.1e}", *counts, *times))
    default_ns = table.facts["default_ns"]
    lines.append(("atmosphere and Earth", "`spectral`, the default", *"–––", default_ns, "–"))
    return PAGE.format(
        headline=markdown_table(HEAD, lines),
        verdict=verdict(chains),
        default_ratio=default_ns / table.facts["constant_ns"],
        exact_looks=table.row(tolerance=0)["points"],
        **table.facts,
    )


def draw(path, table):
    """Draw error against time."""
    with svg_plot(path, figsize=(7, 4)) as (_, axes):
        draw_lines(
            axes, Table(row for row in table if row["tolerance"]), "chain", "nanoseconds", "most"
        )
        for line, exact in zip(axes.get_lines(), table.where(tolerance=0), strict=False):
            axes.axvline(exact["nanoseconds"], color=line.get_color(), linestyle=":", linewidth=1)
        axes.axvline(table.facts["constant_ns"], color="black", linestyle="--", label="constant")
        axes.set(xscale="log", yscale="log", ylabel="largest error of P_d")
        axes.set_xlabel("time per look, ns (dotted: every look evaluated)")


def main():
    """Measure and write."""
    options = options_of(
        __doc__,
        every=20,
        looks=20_000,
        repeat=3,
        thin=1,
        tolerances=(1e-2, 1e-3, 1e-4, 1e-6, 1e-8),
        chains=tuple(CHAINS),
    )
    facts = {}
    publish(
        options,
        page,
        draw,
        facts,
        probability=rows_of(options, facts),
        probability_chains=time_rows(options.repeat, options.thin, options.chains),
    )


if __name__ == "__main__":
    main()
