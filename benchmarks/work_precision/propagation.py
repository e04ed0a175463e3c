"""Numerical propagation: error at impact against time an arc, for opir, SciPy's DOP853 and LSODA,
and heyoka.

    python benchmarks/work_precision/propagation.py [--arcs 1000] [--repeat 7] [--write
        docs/benchmarks] [--from-csv docs/benchmarks]

Ballistic arcs of about half an hour, all over the Earth, from above the atmosphere to the ground.
Two problems: the point mass with J2, and the same with drag in an exponential atmosphere that
rotates with the Earth. The error is the largest distance from the reference at the time of impact,
over all arcs propagated. Tolerances are in metres at impact for opir, relative per step for the
others, scaled by 7000 km and 7 km/s. All tools integrate the same forces; SciPy and heyoka choose
their own steps and, with drag, also run with a largest step. The reference is heyoka at its
tightest tolerance with a largest step, or, where heyoka is not installed, opir at 1e-8 m. Times are
processor time of one core, medians. `--write` puts the page, its data as a CSV file and, where
matplotlib is installed, a plot into a folder; `--from-csv` draws page and plot again from the CSV
file in a folder.
"""

import argparse
import statistics
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from propagation_peers import (
    SCALE_HEIGHT_M,
    SEA_LEVEL_KG_M3,
    Problem,
    heyoka_batch,
    heyoka_single,
    solved,
)
from results_csv import read_csv, write_csv

from opir_core.flight import Drag, Forces, impact, propagate
from opir_core.flight.forces import ExponentialAtmosphere

TOLERANCES_M = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
RELATIVE = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)

AIR = ExponentialAtmosphere(SEA_LEVEL_KG_M3, SCALE_HEIGHT_M)

#: How many arcs a tool that takes one at a time is given, and the longest step with drag where
#: steps are bounded, s.
SINGLES = 12
BOUND_S = 2.0

#: How names of tools begin that are in the data and the plot, not in the table.
UNSHOWN = ("opir, one arc", "heyoka, one arc", "SciPy LSODA", "SciPy DOP853, largest step")

#: The error, m, for which the page compares run times.
COMPARED_M = 1e-3

PAGE = """# Numerical propagation: accuracy against run time

*Which accuracy does a tolerance give, and what does an arc cost?*

{findings}

![Largest error at impact against processor time per arc](propagation.svg)

The fastest run of a tool with an error of at most 1 mm ("–": none is that accurate):

{headline}

*Largest step*: steps are at most {bound} s on the whole arc. opir needs no such limit: its steps end at the boundaries
of the atmosphere's layers and are limited inside.

{arcs} ballistic arcs of {shortest} to {longest} minutes to the ground; {singles} of them for tools that propagate one
arc per call. *Drag*: in an exponential atmosphere that rotates with the Earth. Error: the largest distance from the
reference ({reference}) at its time of impact. Tolerances: metres at impact for opir; relative per step for the others.
All runs: [propagation.csv](propagation.csv).
"""


class Row(NamedTuple):
    """One run of a tool: the tolerance it was given, its largest error and its time."""

    tool: str
    problem: str
    asked: str
    error_m: float
    us_an_arc: float


def shots(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return states shortly after burnout whose flights take about half an hour."""
    random = np.random.default_rng(1)
    up = random.normal(size=(count, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    along = np.cross(up, random.normal(size=(count, 3)))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    angle = np.radians(random.uniform(24.0, 36.0, (count, 1)))
    speed = random.uniform(6700.0, 7000.0, (count, 1))
    height = random.uniform(180e3, 250e3, (count, 1))
    return up * (6371e3 + height), speed * (np.sin(angle) * up + np.cos(angle) * along)


def problems(count: int) -> list[Problem]:
    """Return the two problems; durations are to impact, at a tight tolerance."""
    position, velocity = shots(count)
    beta = np.random.default_rng(2).uniform(1000.0, 8000.0, count)
    found = []
    for name, forces, coefficient in (
        ("J2", Forces(), None),
        ("J2 and drag", Forces(drag=Drag(beta, AIR)), beta),
    ):
        duration, _ = impact(position, velocity, 0.0, forces, tolerance_m=1e-7)
        found.append(Problem(name, forces, coefficient, position, velocity, duration))
    return found


def some(problem: Problem, part: slice) -> Problem:
    """Return the problem with only some of its arcs."""
    beta = None if problem.beta is None else problem.beta[part]
    forces = problem.forces if beta is None else Forces(drag=Drag(beta, AIR))
    return Problem(problem.name, forces, beta, *(column[part] for column in problem[3:]))


def seconds(actions: Sequence[Callable[[], Any]], repeat: int) -> list[float]:
    """Return the median processor times of actions, done in turn, so that a slow spell meets all
    alike.
    """
    times: list[list[float]] = [[] for _ in actions]
    for _ in range(repeat):
        for action, taken in zip(actions, times, strict=True):
            start = time.process_time()
            action()
            taken.append(time.process_time() - start)
    return [statistics.median(taken) for taken in times]


class Run(NamedTuple):
    """Something to measure: it returns positions at impact of the first `count` arcs."""

    tool: str
    asked: str
    action: Callable[[], np.ndarray]


def measured(runs: list[Run], problem: Problem, reference: np.ndarray, repeat: int) -> list[Row]:
    """Return the rows of runs: each is done once for its error, and then in turn for its time."""
    ends = [run.action() for run in runs]
    times = seconds([run.action for run in runs], repeat)
    return [
        Row(run.tool, problem.name, run.asked, worst_m(end, reference), taken / len(end) * 1e6)
        for run, end, taken in zip(runs, ends, times, strict=True)
    ]


def worst_m(found: np.ndarray, reference: np.ndarray) -> float:
    """Return the largest distance."""
    return float(np.linalg.norm(found - reference[: len(found)], axis=1).max())


def ours(problem: Problem, reference: np.ndarray, repeat: int) -> list[Row]:
    """Measure opir: all arcs in one call, and one arc a call."""
    singles = [some(problem, slice(index, index + 1)) for index in range(SINGLES)]
    rows = []
    for tool, parts in (
        (f"opir, batch of {len(problem.duration)}", [problem]),
        ("opir, one arc", singles),
    ):
        runs = [
            Run(tool, f"{asked:g} m", partial(propagated, parts, asked)) for asked in TOLERANCES_M
        ]
        rows += measured(runs, problem, reference, repeat)
    return rows


def propagated(parts: list[Problem], tolerance_m: float) -> np.ndarray:
    """Return positions at impact by opir, one call a part."""
    return np.concatenate(
        [
            propagate(p.position, p.velocity, p.duration, p.forces, tolerance_m=tolerance_m)[0]
            for p in parts
        ]
    )


def scipys(problem: Problem, reference: np.ndarray, repeat: int) -> list[Row]:
    """Measure SciPy's DOP853 and LSODA, one arc a call."""
    part = some(problem, slice(SINGLES))
    rows = []
    for method in ("DOP853", "LSODA"):
        for bound in bounds(problem):
            asked = RELATIVE[2::3] if np.isfinite(bound) else RELATIVE
            runs = [
                Run(
                    f"SciPy {method}{bounded(bound)}",
                    f"{each:g}",
                    partial(solved, part, method, bound, each),
                )
                for each in asked
            ]
            rows += measured(runs, problem, reference, repeat if np.isinf(bound) else 1)
    return rows


def bounds(problem: Problem) -> list[float]:
    """Return the bounds on steps, s, that others are run with."""
    return [np.inf] if problem.beta is None else [np.inf, BOUND_S]


def bounded(bound: float) -> str:
    """Return the part of a tool's name that gives its largest step."""
    return f", largest step {bound:g} s" if np.isfinite(bound) else ""


def heyokas(heyoka: Any, problem: Problem, reference: np.ndarray, repeat: int) -> list[Row]:
    """Measure heyoka, batch and single; compiling is not counted."""
    rows = []
    part = some(problem, slice(SINGLES))
    for tool, maker, arcs in (
        ("heyoka, batch of 8", heyoka_batch, problem),
        ("heyoka, one arc", heyoka_single, part),
    ):
        for bound in bounds(problem):
            asked = (*RELATIVE[::2], 1e-15) if np.isinf(bound) else (*RELATIVE[2::3], 1e-15)
            runs = [
                Run(tool + bounded(bound), f"{each:g}", maker(heyoka, arcs, each, bound))
                for each in asked
            ]
            rows += measured(runs, problem, reference, repeat if np.isinf(bound) else 1)
    return rows


def reference_of(heyoka: Any, problem: Problem) -> np.ndarray:
    """Return positions at impact as exact as can be had."""
    if heyoka is None:
        return propagate(
            problem.position, problem.velocity, problem.duration, problem.forces, tolerance_m=1e-8
        )[0]
    bound = np.inf if problem.beta is None else BOUND_S
    return heyoka_batch(heyoka, problem, 1e-18, bound)()


def imported(name: str) -> Any:
    """Return a module, or None where it is not installed."""
    try:
        return __import__(name)
    except ImportError:
        return None


def multiply_ns() -> float:
    """Return the time a plain numpy multiplication takes an element, as a measure of how busy the
    machine is.
    """
    a = np.ones(32768)

    def many() -> None:
        for _ in range(1000):
            np.multiply(a, a, out=a)

    return 1e9 * seconds([many], 7)[0] / (1000 * len(a))


def headline(rows: list[Row]) -> str:
    """Return for each tool the fastest run of each problem that is accurate enough."""
    names = list(dict.fromkeys(row.problem for row in rows))
    columns = [f"{name}: tolerance | µs per arc" for name in names]
    lines = [f"| tool | {' | '.join(columns)} |", "|---" * (1 + 2 * len(names)) + "|"]
    for tool in dict.fromkeys(row.tool for row in rows):
        if tool.startswith(UNSHOWN):
            continue
        cells = [best(rows, tool, name) for name in names]
        lines.append(f"| {tool} | {' | '.join(cells)} |")
    return "\n".join(lines)


def best(rows: list[Row], tool: str, problem: str) -> str:
    """Return the cells of a tool's fastest run that is accurate enough."""
    own = [r for r in rows if (r.tool, r.problem) == (tool, problem) and r.error_m <= COMPARED_M]
    if not own:
        return "– | –"
    fastest = min(own, key=lambda row: row.us_an_arc)
    return f"{fastest.asked} | {micro(fastest.us_an_arc)}"


def micro(value: float) -> str:
    """Return a time with three digits, without an exponent."""
    return f"{value:.3g}" if value < 1e3 else f"{float(f'{value:.3g}'):,.0f}".replace(",", " ")


def findings(rows: list[Row]) -> str:
    """Return the main results as a list."""
    own = [row for row in rows if row.tool.startswith("opir")]
    share = max(
        row.error_m / float(row.asked.split()[0])
        for row in own
        if not row.asked.startswith("1e-07")
    )
    batch = [row for row in own if "batch" in row.tool and row.asked == "0.0001 m"]
    times = " and ".join(f"{micro(row.us_an_arc)} µs per arc with {row.problem}" for row in batch)
    lines = [
        (
            f"- opir's error at impact is at most {share:.1f} times its tolerance, for tolerances down"
            f" to 1e-6 m."
        ),
        f"- A batch at a tolerance of 1e-4 m takes {times}.",
    ]
    fastest = [
        min(
            (r for r in rows if r.problem == name and r.error_m <= COMPARED_M),
            key=lambda row: row.us_an_arc,
        )
        for name in dict.fromkeys(row.problem for row in rows)
    ]
    winners = " and ".join(f"{r.tool} with {r.problem} ({micro(r.us_an_arc)} µs)" for r in fastest)
    lines.append(f"- The fastest for an error of at most 1 mm: {winners}.")
    unbounded = [
        row for row in rows if row.tool.startswith("heyoka, batch") and row.problem == "J2 and drag"
    ]
    blind = min((row.error_m for row in unbounded if "largest step" not in row.tool), default=None)
    if blind is not None:
        lines.append(
            "- A Taylor integrator needs a largest step with drag: without one it steps over the"
            " atmosphere. At every"
            f" tolerance it is {blind / 1e3:.0f} km off or more, and reports success."
        )
    return "\n".join(lines)


def write_plot(rows: list[Row], path: Path) -> None:
    """Write error against time, one panel a problem."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
    from matplotlib import pyplot as plt

    names = list(dict.fromkeys(row.problem for row in rows))
    figure, axes = plt.subplots(
        1, len(names), figsize=(11, 5.6), constrained_layout=True, sharey=True
    )
    for axis, name in zip(np.atleast_1d(axes), names, strict=True):
        for tool in dict.fromkeys(row.tool for row in rows if row.problem == name):
            points = [
                (row.us_an_arc, row.error_m)
                for row in rows
                if row.problem == name and row.tool == tool
            ]
            style = "o-" if tool.startswith("opir") else ("s:" if "largest step" in tool else "^--")
            axis.plot(*zip(*points, strict=True), style, markersize=4, label=tool)
        axis.set(xscale="log", yscale="log", title=name, xlabel="processor time per arc, µs")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)
    np.atleast_1d(axes)[0].set_ylabel("largest error at impact, m")
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Measure and print; write where asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--arcs", type=int, default=1000)
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--from-csv", type=Path)
    options = parser.parse_args()
    if options.from_csv:
        redraw(options.from_csv)
        return
    heyoka = imported("heyoka")
    scipy = imported("scipy")
    chosen = problems(options.arcs)
    rows = []
    for problem in chosen:
        reference = reference_of(heyoka, problem)
        rows += ours(problem, reference, options.repeat)
        rows += scipys(problem, reference, options.repeat) if scipy else []
        rows += heyokas(heyoka, problem, reference, options.repeat) if heyoka else []
    print(findings(rows), headline(rows), sep="\n\n")
    if options.write:
        minutes = chosen[0].duration / 60.0
        facts = {
            "arcs": options.arcs,
            "shortest": f"{minutes.min():.0f}",
            "longest": f"{minutes.max():.0f}",
            "singles": SINGLES,
            "bound": f"{BOUND_S:g}",
            "reference": f"heyoka at 1e-18, with drag steps of at most {BOUND_S:g} s"
            if heyoka
            else "opir at 1e-8 m",
            "multiply_ns": f"{multiply_ns():.2f}",
        }
        write_csv(options.write / "propagation.csv", rows, facts)
        redraw(options.write)


def redraw(folder: Path) -> None:
    """Write the page and the plot from the CSV file of a folder."""
    rows, facts = read_csv(folder / "propagation.csv", Row)
    text = PAGE.format(findings=findings(rows), headline=headline(rows), **facts)
    (folder / "propagation.md").write_text(text, encoding="utf-8")
    write_plot(rows, folder / "propagation.svg")


if __name__ == "__main__":
    main()
