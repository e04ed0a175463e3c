"""Numerical propagation: error at impact against time an arc, for opir, SciPy's DOP853 and LSODA,
and heyoka.

Ballistic arcs of about half an hour, all over the Earth, from above the atmosphere to the ground.
Two problems: the point mass with J2, and the same with drag in an exponential atmosphere that
rotates with the Earth. The error is the largest distance from the reference at the time of impact,
over all arcs propagated. Tolerances are in metres at impact for opir, relative per step for the
others, scaled by 7000 km and 7 km/s. All tools integrate the same forces; SciPy and heyoka choose
their own steps and, with drag, also run with a largest step. The reference is heyoka at its
tightest tolerance with a largest step, or, where heyoka is not installed, opir at 1e-8 m. Times are
processor time of one core, medians.
"""

from collections.abc import Callable
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np
from pages import markdown_table, options_of, publish, svg_plot, turns_s
from propagation_peers import (
    LANES,
    SCALE_HEIGHT_M,
    SEA_LEVEL_KG_M3,
    Problem,
    heyoka_run,
    solved,
)

from opir_core.flight import Drag, Forces, impact, propagate
from opir_core.flight.forces import ExponentialAtmosphere

TOLERANCES_M = 10.0 ** -np.arange(1, 8)
RELATIVE = 10.0 ** -np.arange(4, 13)
AIR = ExponentialAtmosphere(SEA_LEVEL_KG_M3, SCALE_HEIGHT_M)
#: How many arcs a tool that takes one at a time is given.
SINGLES = 12
#: The longest step with drag where steps are bounded, s.
BOUND_S = 2.0
#: Tools in the data and the plot, not in the table.
UNSHOWN = ("opir, one arc", "heyoka, one arc", "SciPy LSODA", "SciPy DOP853, largest step")

PAGE = """# Numerical propagation: accuracy against run time

*Which accuracy does a tolerance give, and what does an arc cost?*

{findings}

![Largest error at impact against processor time per arc](propagation.svg)

The fastest run of a tool with an error of at most 1 mm ("–": none is that accurate):

{headline}

*Largest step*: steps are at most {bound} s on the whole arc. opir needs no such limit: its steps
end at the boundaries of the atmosphere's layers and are limited inside.

{arcs} ballistic arcs of {shortest} to {longest} minutes to the ground; {singles} of them for
tools that propagate one arc per call. *Drag*: in an exponential atmosphere that rotates with the
Earth. Error: the largest distance from the reference ({reference}) at its time of impact.
Tolerances: metres at impact for opir; relative per step for the others. All runs:
[propagation.csv](propagation.csv).
"""


class Run(NamedTuple):
    """A tool at a tolerance: returns positions at impact of the first arcs."""

    tool: str
    asked: str
    action: Callable[[], np.ndarray]


def shots(count):
    """Return states shortly after burnout whose flights take about half an hour."""
    rng = np.random.default_rng(1)
    up = rng.normal(size=(count, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    along = np.cross(up, rng.normal(size=(count, 3)))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    angle = np.radians(rng.uniform(24.0, 36.0, (count, 1)))
    speed = rng.uniform(6700.0, 7000.0, (count, 1))
    radius = 6371e3 + rng.uniform(180e3, 250e3, (count, 1))
    return up * radius, speed * (np.sin(angle) * up + np.cos(angle) * along)


def problems(count):
    """Yield the two problems; durations are to impact, at a tight tolerance."""
    position, velocity = shots(count)
    beta = np.random.default_rng(2).uniform(1000.0, 8000.0, count)
    for name, coefficient in (("J2", None), ("J2 and drag", beta)):
        forces = forces_of(coefficient)
        duration, _ = impact(position, velocity, 0.0, forces, tolerance_m=1e-7)
        yield Problem(name, forces, coefficient, position, velocity, duration)


def forces_of(beta):
    """Return the forces, with drag if there are ballistic coefficients."""
    return Forces() if beta is None else Forces(drag=Drag(beta, AIR))


def arcs_of(problem, arcs):
    """Return the problem with only some of its arcs."""
    beta = None if problem.beta is None else problem.beta[arcs]
    return Problem(problem.name, forces_of(beta), beta, *(column[arcs] for column in problem[3:]))


def measured(runs, problem, reference, repeat):
    """Yield the rows of runs: each is done once for its error, and then in turn for its time."""
    ends = [run.action() for run in runs]
    times = turns_s(
        {str(number): run.action for number, run in enumerate(runs)}, repeat, warm=False
    )
    for run, end, taken_s in zip(runs, ends, times.values(), strict=True):
        error_m = float(np.linalg.norm(end - reference[: len(end)], axis=1).max())
        row = {"tool": run.tool, "problem": problem.name, "asked": run.asked}
        yield {**row, "error_m": error_m, "us_an_arc": taken_s / len(end) * 1e6}


def propagated(parts, tolerance_m):
    """Return positions at impact by opir, one call a part."""
    ends = [propagate(*arcs[3:], arcs.forces, tolerance_m=tolerance_m)[0] for arcs in parts]
    return np.concatenate(ends)


def opir_runs(problem):
    """Yield the runs of opir: all arcs in one call, and one arc a call."""
    singles = [arcs_of(problem, slice(index, index + 1)) for index in range(SINGLES)]
    tools = {f"opir, batch of {len(problem.duration)}": [problem], "opir, one arc": singles}
    for tool, parts in tools.items():
        for tolerance_m in TOLERANCES_M.tolist():
            yield Run(tool, f"{tolerance_m:g} m", partial(propagated, parts, tolerance_m))


def bounds(problem):
    """Return the bounds on steps, s, of other tools, and their part of the tool's name."""
    unbounded = {np.inf: ""}
    return (
        unbounded
        if problem.beta is None
        else {**unbounded, BOUND_S: f", largest step {BOUND_S:g} s"}
    )


def scipy_runs(problem, bound, name):
    """Yield the runs of SciPy's DOP853 and LSODA, one arc a call."""
    arcs = arcs_of(problem, slice(SINGLES))
    for method in ("DOP853", "LSODA"):
        for relative in (RELATIVE[2::3] if np.isfinite(bound) else RELATIVE).tolist():
            action = partial(solved, arcs, method, bound, relative)
            yield Run(f"SciPy {method}{name}", f"{relative:g}", action)


def heyoka_runs(heyoka, problem, bound, name):
    """Yield the runs of heyoka, batch and single; compiling is not counted."""
    singles = arcs_of(problem, slice(SINGLES))
    tolerances = (RELATIVE[2::3] if np.isfinite(bound) else RELATIVE[::2]).tolist()
    for tool, arcs, lanes in (("batch of 8", problem, LANES), ("one arc", singles, 1)):
        for relative in (*tolerances, 1e-15):
            action = heyoka_run(heyoka, arcs, relative, bound, lanes)
            yield Run(f"heyoka, {tool}{name}", f"{relative:g}", action)


def reference_of(heyoka, problem):
    """Return positions at impact as exact as can be had."""
    if heyoka is None:
        return propagated([problem], 1e-8)
    bound = np.inf if problem.beta is None else BOUND_S
    return heyoka_run(heyoka, problem, 1e-18, bound, LANES)()


def rows_of(arcs, repeat, facts):
    """Yield the rows of all tools and problems."""
    heyoka = import_module("heyoka") if find_spec("heyoka") else None
    bounded = f"heyoka at 1e-18, with drag steps of at most {BOUND_S:g} s"
    facts |= {"arcs": arcs, "singles": SINGLES, "bound": BOUND_S}
    facts["reference"] = bounded if heyoka else "opir at 1e-8 m"
    for problem in problems(arcs):
        minutes = np.round(problem.duration / 60.0)
        facts |= {"shortest": int(minutes.min()), "longest": int(minutes.max())}
        reference = reference_of(heyoka, problem)
        yield from measured(list(opir_runs(problem)), problem, reference, repeat)
        for bound, name in bounds(problem).items():
            runs = list(scipy_runs(problem, bound, name))
            runs += heyoka_runs(heyoka, problem, bound, name) if heyoka else []
            yield from measured(runs, problem, reference, 1 if name else repeat)


def fastest(rows):
    """Return the fastest run with an error of at most a millimetre, if any."""
    exact = [row for row in rows if row["error_m"] <= 1e-3]
    return min(exact, key=lambda row: row["us_an_arc"], default=None)


def micro(value):
    """Return a time with three digits, without an exponent."""
    return f"{value:.3g}" if value < 1e3 else f"{float(f'{value:.3g}'):,.0f}".replace(",", " ")


def headline(table):
    """Return for each tool the fastest run of each problem that is accurate enough."""
    lines = []
    problem_names = table.names("problem")
    for tool in table.names("tool"):
        if not tool.startswith(UNSHOWN):
            runs = [fastest(table.where(tool=tool, problem=name)) for name in problem_names]
            cells = [(run["asked"], micro(run["us_an_arc"])) if run else ("–", "–") for run in runs]
            lines.append([tool, *(cell for pair in cells for cell in pair)])
    head = [column for name in problem_names for column in (f"{name}: tolerance", "µs per arc")]
    return markdown_table(["tool", *head], lines)


def findings(table):
    """Return the main results as a list."""
    opir_rows = [row for row in table if row["tool"].startswith("opir")]
    tolerances = [(row, float(row["asked"].split()[0])) for row in opir_rows]
    share = max(row["error_m"] / asked_m for row, asked_m in tolerances if asked_m > 2e-7)
    batch = [row for row in opir_rows if "batch" in row["tool"] and row["asked"] == "0.0001 m"]
    times = [f"{micro(row['us_an_arc'])} µs per arc with {row['problem']}" for row in batch]
    winners = []
    for name in table.names("problem"):
        run = fastest(table.where(problem=name))
        if run:
            winners.append(f"{run['tool']} with {name} ({micro(run['us_an_arc'])} µs)")
    words = f"is at most {share:.1f} times its tolerance, for tolerances down to 1e-6 m"
    lines = [
        f"- opir's error at impact {words}.",
        f"- A batch at a tolerance of 1e-4 m takes {' and '.join(times)}.",
        f"- The fastest for an error of at most 1 mm: {' and '.join(winners)}.",
    ]
    blind = table.where(tool="heyoka, batch of 8", problem="J2 and drag").column("error_m")
    if blind:
        lines.append(
            "- A Taylor integrator needs a largest step with drag: without one it steps over the"
            f" atmosphere. At every tolerance it is {min(blind) / 1e3:.0f} km off or more, and"
            " reports success."
        )
    return "\n".join(lines)


def page(table):
    """Return the page."""
    return PAGE.format(findings=findings(table), headline=headline(table), **table.facts)


def draw(path, table):
    """Draw error against time, one panel a problem."""
    names = table.names("problem")
    shape = (1, len(names))
    with svg_plot(path, *shape, figsize=(11, 5.6), sharey=True, squeeze=False) as (_, axes):
        for panel, name in zip(axes.flat, names, strict=True):
            for tool in table.where(problem=name).names("tool"):
                rows = table.where(problem=name, tool=tool)
                style = "o-" if tool.startswith("opir") else "s:" if "step" in tool else "^--"
                points = (rows.column("us_an_arc"), rows.column("error_m"))
                panel.loglog(*points, style, markersize=4, label=tool)
            panel.set(title=name, xlabel="processor time per arc, µs")
        axes[0, 0].set_ylabel("largest error at impact, m")


def main():
    """Measure and write."""
    options = options_of(__doc__, arcs=1000, repeat=7)
    facts = {}
    rows = rows_of(options.arcs, options.repeat, facts)
    publish(options, page, draw, facts, propagation=rows)


if __name__ == "__main__":
    main()
