"""Two-body propagation: time per state and largest error by class of arc, beside the libraries that
are installed.

Every library gets the same states, in a process of its own, one thread; medians of the CPU time of
interleaved runs. Errors are against mpmath with 50 digits; the floor is the effect of rounding the
inputs to the nearest double (condition number × 1.1e-16 × distance). Peers are optional: heyoka,
pykep, boinor with numba.
"""

import os
import platform
import statistics
import sys
from pathlib import Path

import mpmath
import numpy as np
from kepler_arcs import CLASSES
from kepler_peers import NAMES, installed_libraries
from pages import markdown_table, options_of

from opir_core.constants import EARTH_MU_M3_S2 as MU

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
from exact_cases.measure import less, norm
from exact_cases.two_body import exact_end

PAGE = """# Two-body propagation: speed and error

*How fast and how exact is two-body propagation?* opir returns a result for every class of arc,
with errors near the floor: the error from rounding the inputs to doubles.

Largest error of {checked} states against mpmath with 50 digits, one state per call:

{table}

Nanoseconds per state, over the classes: {speed}. Median processor time of {repeat} interleaved
runs of {states} states in one call (a loop for libraries without such a call), one thread;
{machine}. "–": the library raised an error.

*Ballistic*, *near rectilinear* (1e-7 to 1e-12 rad from the vertical) and *vertical* are free
flights from 100–300 km; *near circular* has e from 1e-16 to 1e-3, *near parabolic* |e − 1| from
1e-15 to 1e-3, *hyperbolic* e from 1.01 to 10.
"""

Ends = list[list[mpmath.mpf]]


def references(states):
    """Return the exact end positions, and the largest error, m, of rounding the inputs alone."""
    ends = []
    floors = []
    nudge = mpmath.mpf(10) ** -20
    for position, velocity, duration in zip(*states, strict=True):
        state = [mpmath.mpf(float(value)) for value in (*position, *velocity, duration, MU)]
        end, _ = exact_end(state)
        floor = 0.0
        for index, value in enumerate(state):
            nudged, _ = exact_end([*state[:index], value * (1 + nudge), *state[index + 1 :]])
            floor += float(norm(less(nudged, end)) / nudge) * 1.1e-16
        ends.append(end)
        floors.append(floor)
    return ends, max(floors)


def worst_error(library, states, ends):
    """Return the largest error, m, one state per call, and how many states failed."""
    errors = []
    for index, end in enumerate(ends):
        position, _ = library(tuple(column[index : index + 1] for column in states))
        if position is not None and np.isfinite(position).all():
            exact = [mpmath.mpf(float(value)) for value in position[0]]
            errors.append(float(norm(less(exact, end))))
    failed = len(ends) - len(errors)
    figure = f"{max(errors):.0e}" if errors else "–"
    return f"{figure} ({failed} of {len(ends)} fail)" if failed else figure


def nanoseconds(libraries, states, repeat):
    """Return the median time per state of each, in interleaved rounds, so that the machine's load
    affects all alike.
    """
    times = {name: [] for name in libraries}
    for turn in range(repeat + 1):
        for name, library in libraries.items():
            end, seconds = library(states)
            if turn or end is None:
                times[name].append(np.nan if end is None else seconds / states[2].size * 1e9)
    return {name: statistics.median(values) for name, values in times.items()}


def spread(times):
    """Return the range of times over the classes that a library can propagate."""
    finite = [value for value in times if not np.isnan(value)]
    return f"{min(finite):.0f} to {max(finite):.0f}" if finite else "–"


def page(states, checked, repeat, names):
    """Return the page."""
    libraries = installed_libraries(names)
    times = {name: [] for name in libraries}
    floor_line = ["*floor: rounding of the inputs*"]
    lines = {name: [name] for name in libraries}
    for kind in CLASSES:
        many = kind(np.random.default_rng(1), states)
        few = kind(np.random.default_rng(2), checked)
        ends, floor = references(few)
        floor_line.append(f"{floor:.0e}")
        for name, value in nanoseconds(libraries, many, repeat).items():
            times[name].append(value)
            lines[name].append(worst_error(libraries[name], few, ends))
    for library in libraries.values():
        library.close()
    head = ["largest error, m", *(kind.__name__.replace("_", " ") for kind in CLASSES)]
    return PAGE.format(
        speed="; ".join(f"{name} {spread(values)}" for name, values in times.items()),
        table=markdown_table(head, [floor_line, *lines.values()]),
        states=states,
        checked=checked,
        repeat=repeat,
        machine=f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}",
    )


def main():
    """Measure and print; write the page where asked."""
    options = options_of(__doc__, states=100_000, checked=60, repeat=9, libraries=NAMES)
    mpmath.mp.dps = 60
    text = page(options.states, options.checked, options.repeat, options.libraries)
    print(text)
    if options.write:
        (options.write / "kepler.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
