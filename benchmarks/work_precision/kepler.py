"""Two-body propagation: time per state and largest error by class of arc, beside the libraries that
are installed.

    python benchmarks/work_precision/kepler.py [--states 100000] [--checked 60] [--repeat 9]
        [--write FOLDER] [--libraries opir heyoka pykep boinor]

Every library gets the same states, in a process of its own, one thread; medians of the CPU time of
interleaved runs. Errors are against mpmath with 50 digits; the floor is the effect of rounding the
inputs to the nearest double (condition number × 1.1e-16 × distance). Peers are optional: heyoka,
pykep, boinor with numba. `--write` puts the tables into FOLDER/kepler.md.
"""

import argparse
import os
import platform
import statistics
from collections.abc import Collection
from pathlib import Path

import mpmath
import numpy as np
from kepler_arcs import CLASSES, States
from kepler_exact import distance, references
from kepler_peers import NAMES, Library, installed_libraries


def worst_error(library: Library, states: States, ends: list[list[mpmath.mpf]]) -> str:
    """Return the largest error, m, one state per call, and how many states failed."""
    worst = 0.0
    lost = 0
    for index, end in enumerate(ends):
        found, _ = library(tuple(column[index : index + 1] for column in states))
        if found is None or not np.isfinite(found).all():
            lost += 1
        else:
            worst = max(worst, float(distance([mpmath.mpf(float(x)) for x in found[0]], end)))
    figure = f"{worst:.0e}" if lost < len(ends) else "–"
    return f"{figure} ({lost} of {len(ends)} fail)" if lost else figure


def nanoseconds(libraries: dict[str, Library], states: States, repeat: int) -> dict[str, float]:
    """Return the median time per state of each, in interleaved rounds, so that the machine's load
    affects all alike.
    """
    taken: dict[str, list[float]] = {name: [] for name in libraries}
    for turn in range(repeat + 1):
        for name, library in libraries.items():
            end, seconds = library(states)
            if turn or end is None:
                taken[name].append(np.nan if end is None else seconds / states[2].size * 1e9)
    return {name: statistics.median(values) for name, values in taken.items()}


def table(rows: list[list[str]]) -> str:
    """Return rows as a Markdown table, the first its head."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(rows[0]), *lines[1:]])


def spread(nanoseconds: list[float]) -> str:
    """Return the range of times over the classes that a library can propagate."""
    known = [value for value in nanoseconds if not np.isnan(value)]
    return f"{min(known):.0f} to {max(known):.0f}" if known else "–"


def measured(states: int, checked: int, repeat: int, chosen: Collection[str]) -> str:
    """Return the page."""
    libraries = installed_libraries(chosen)
    names = [kind.__name__.replace("_", " ") for kind in CLASSES]
    error = [["largest error, m", *names]]
    times = {}
    errors = {}
    floors = []
    for kind in CLASSES:
        times[kind] = nanoseconds(libraries, kind(np.random.default_rng(1), states), repeat)
        few = kind(np.random.default_rng(2), checked)
        ends, floor = references(few)
        floors.append(f"{floor.max():.0e}")
        errors[kind] = {
            name: worst_error(library, few, ends) for name, library in libraries.items()
        }
    error.append(["*floor: rounding of the inputs*", *floors])
    error += [[name, *(errors[kind][name] for kind in CLASSES)] for name in libraries]
    for library in libraries.values():
        library.close()
    return PAGE_TEXT.format(
        speed="; ".join(
            f"{name} {spread([times[kind][name] for kind in CLASSES])}" for name in libraries
        ),
        error=table(error),
        states=states,
        checked=checked,
        repeat=repeat,
        machine=f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}",
    )


PAGE_TEXT = """# Two-body propagation: speed and error

*How fast and how exact is two-body propagation?* opir returns a result for every class of arc, with errors near the
floor: the error from rounding the inputs to doubles.

Largest error of {checked} states against mpmath with 50 digits, one state per call:

{error}

Nanoseconds per state, over the classes: {speed}. Median processor time of {repeat} interleaved runs of {states} states
in one call (a loop for libraries without such a call), one thread; {machine}. "–": the library raised an error.

*Ballistic*, *near rectilinear* (1e-7 to 1e-12 rad from the vertical) and *vertical* are free flights from 100–300 km;
*near circular* has e from 1e-16 to 1e-3, *near parabolic* |e − 1| from 1e-15 to 1e-3, *hyperbolic* e from 1.01 to 10.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=int, default=100_000)
    parser.add_argument("--checked", type=int, default=60)
    parser.add_argument("--repeat", type=int, default=9)
    parser.add_argument("--libraries", nargs="+", choices=NAMES, default=NAMES)
    parser.add_argument(
        "--write", type=Path, metavar="FOLDER", help="write the page to FOLDER/kepler.md"
    )
    given = parser.parse_args()
    mpmath.mp.dps = 60
    page = measured(given.states, given.checked, given.repeat, given.libraries)
    print(page)
    if given.write:
        (given.write / "kepler.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
