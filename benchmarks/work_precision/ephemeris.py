"""Ephemerides of flights: build time, memory, evaluation time and error against the tolerance.

    python benchmarks/work_precision/ephemeris.py [--targets 1000] [--points 1000000] [--repeat 7]
        [--write docs/benchmarks] [--from-csv docs/benchmarks]

Flights of all five classes, from ignition to burnout and on to impact. Errors are the largest over
a million random points, against the boost's own series and two-body propagation. Positions are
evaluated for targets x 1000 times in one call, in order (as a grid) and shuffled (each point
another target and time). Times are processor time of one core, medians. `--write` puts the page,
its data as a CSV file and, where matplotlib is installed, a plot into a folder; `--from-csv` draws
page and plot again from the CSV file in a folder.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from results_csv import read_csv, write_csv
from timing import median_s, multiply_ns

from opir_core.flight import (
    Aim,
    Ephemeris,
    aim,
    boost_ephemeris,
    boost_profiles,
    coast_ephemeris,
    propagate_kepler,
)
from opir_core.geometry import Geodetic, eci_to_ecef, geodesic_direct

TOLERANCES_M = (10.0, 1.0, 0.1, 0.01, 1e-3, 1e-4, 1e-5)
SHOWN_M = (1.0, 0.01, 1e-4)
TIMES = 1000

PAGE = """# Ephemerides: accuracy against run time

*What does a tolerance on the position of targets cost in time and memory?* An ephemeris stores a flight as piecewise
polynomials that are fitted to a tolerance. {answer}

![Build time, memory and evaluation time against tolerance](ephemeris.svg)

*Boost*: from ignition to burnout; *flight*: to impact. Errors are the largest over a million random points of {targets}
flights of all classes; times those of all targets at 1000 times in one call. Times of shuffled positions, and with
velocity: [ephemeris.csv](ephemeris.csv).
"""


class Row(NamedTuple):
    """One line of the table."""

    span: str
    tolerance_m: float
    error_m: float
    pieces: float
    kilobytes: float
    build_us: float
    ordered_ns: float
    shuffled_ns: float
    state_ns: float


def flights(count: int) -> Aim:
    """Return flights of all classes over random ranges in random directions."""
    rng = np.random.default_rng(1)
    classes = list(boost_profiles().values())
    profiles = [classes[row % len(classes)] for row in range(count)]
    range_m = np.array(
        [rng.uniform(1.001 * p.minimum_range_m, 0.999 * p.maximum_range_m) for p in profiles]
    )
    latitude = np.arcsin(rng.uniform(-1, 1, count))
    longitude = rng.uniform(-np.pi, np.pi, count)
    there = geodesic_direct(latitude, longitude, rng.uniform(0, 2 * np.pi, count), range_m)
    return aim(
        Geodetic(latitude, longitude, 0.0),
        Geodetic(*there, 0.0),
        rng.uniform(0.0, 600.0, count),
        profiles,
    )


def exact_m(flight: Aim, target: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Return positions without an ephemeris."""
    boost, _ = flight.path.state(target, time_s)
    free_s = np.maximum(time_s - flight.burnout_s[target], 0.0)
    coast, _ = propagate_kepler(
        flight.burnout_position_eci_m[target], flight.burnout_velocity_eci_m_s[target], free_s
    )
    return np.where(
        (time_s <= flight.burnout_s[target])[:, None], boost, eci_to_ecef(coast, time_s)
    )


def largest_error_m(ephemeris: Ephemeris, flight: Aim, points: int) -> float:
    """Return the largest error over random points, half of them crowded towards the start."""
    rng = np.random.default_rng(2)
    worst = 0.0
    for _ in range(10):
        target = rng.integers(0, len(ephemeris), points // 10)
        share = rng.random(points // 10)
        share = np.where(rng.random(len(share)) < 0.5, share, share**4)
        times = ephemeris.start_s[target] + share * (ephemeris.end_s - ephemeris.start_s)[target]
        error = np.linalg.norm(
            ephemeris.position_m(target, times) - exact_m(flight, target, times), axis=1
        )
        worst = max(worst, float(error.max()))
    return worst


def kilobytes(ephemeris: Ephemeris) -> float:
    """Return the memory of all the arrays of an ephemeris."""
    arrays = [
        value
        for holder in (ephemeris, ephemeris.segments)
        for value in vars_of(holder)
        if isinstance(value, np.ndarray)
    ]
    return sum(array.nbytes for array in arrays) / 1024


def vars_of(holder: object) -> list[object]:
    """Return the attributes of a slotted record."""
    return [getattr(holder, name) for name in type(holder).__slots__ if name != "__weakref__"]


def measured(
    span: str,
    build: Callable[[Aim, float], Ephemeris],
    flight: Aim,
    tolerance_m: float,
    options: argparse.Namespace,
) -> Row:
    """Return the table's line for one span and tolerance."""
    ephemeris = build(flight, tolerance_m)
    repeat = options.repeat
    count = len(ephemeris)
    rng = np.random.default_rng(3)
    target = np.repeat(np.arange(count), TIMES)
    share = np.tile(np.linspace(0.0, 1.0, TIMES), count)
    times = np.minimum(
        ephemeris.start_s[target] + share * (ephemeris.end_s - ephemeris.start_s)[target],
        ephemeris.end_s[target],
    )
    order = rng.permutation(len(target))
    mixed = target[order]
    mixed_times = times[order]
    points = len(target)
    return Row(
        span,
        tolerance_m,
        largest_error_m(ephemeris, flight, options.points),
        len(ephemeris.segments) / count,
        kilobytes(ephemeris) / count,
        1e6 * median_s(lambda: build(flight, tolerance_m), min(repeat, 3)) / count,
        1e9 * median_s(lambda: ephemeris.position_m(target, times), repeat) / points,
        1e9 * median_s(lambda: ephemeris.position_m(mixed, mixed_times), repeat) / points,
        1e9 * median_s(lambda: ephemeris.state(target, times), repeat) / points,
    )


def table(rows: list[Row]) -> str:
    """Return the rows as a Markdown table."""
    head = (
        "| span | tolerance, m | largest error, m | kB per target | build, µs per target | in"
        " order, ns per point"
        " | shuffled, ns |\n|---|---|---|---|---|---|---|"
    )
    lines = [
        f"| {r.span} | {r.tolerance_m:g} | {r.error_m:.2g} | {r.kilobytes:.1f} | {r.build_us:.0f}"
        f" | {r.ordered_ns:.0f} | {r.shuffled_ns:.0f} |"
        for r in rows
        if r.tolerance_m in SHOWN_M
    ]
    return "\n".join([head, *lines])


def answer(rows: list[Row]) -> str:
    """Return how errors compare with tolerances, and the cost of the default tolerance of 1 cm."""
    share = max(row.error_m / row.tolerance_m for row in rows)
    row = next(row for row in rows if (row.span, row.tolerance_m) == ("flight", 0.01))
    return (
        f"Its error is at most {share:.2f} times the tolerance. At the default of 1 cm a whole"
        f" flight takes"
        f" {row.build_us:.0f} µs and {row.kilobytes:.0f} kB to build, and {row.ordered_ns:.0f} ns"
        f" per position."
    )


def write_plot(rows: list[Row], path: Path) -> None:
    """Write build time, memory and evaluation time against tolerance."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
    from matplotlib import pyplot as plt

    panels = {
        "build_us": "build, µs per target",
        "kilobytes": "memory, kB per target",
        "ordered_ns": "position, ns per point",
    }
    figure, axes = plt.subplots(1, len(panels), figsize=(11, 3.4), constrained_layout=True)
    for axis, (column, label) in zip(axes, panels.items(), strict=True):
        for span, marker in (("boost", "o-"), ("flight", "s-")):
            of_span = [row for row in rows if row.span == span]
            axis.plot(
                [row.tolerance_m for row in of_span],
                [getattr(row, column) for row in of_span],
                marker,
                label=span,
            )
        axis.set(xscale="log", xlabel="tolerance, m", ylabel=label, ylim=(0, None))
        axis.invert_xaxis()
        axis.legend()
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Measure and print; write where asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--targets", type=int, default=1000)
    parser.add_argument("--points", type=int, default=1_000_000, help="random points of the errors")
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--from-csv", type=Path)
    options = parser.parse_args()
    if options.from_csv:
        redraw(options.from_csv)
        return
    flight = flights(options.targets)
    spans = {
        "boost": lambda f, tolerance: boost_ephemeris(f.path, tolerance),
        "flight": lambda f, tolerance: Ephemeris.joined(
            [boost_ephemeris(f.path, tolerance), coast_ephemeris(f, tolerance)]
        ),
    }
    rows = [
        measured(span, build, flight, tolerance, options)
        for span, build in spans.items()
        for tolerance in TOLERANCES_M
    ]
    print(table(rows))
    if options.write:
        facts = {"targets": options.targets, "multiply_ns": f"{multiply_ns():.2f}"}
        write_csv(options.write / "ephemeris.csv", rows, facts)
        redraw(options.write)


def redraw(folder: Path) -> None:
    """Write the page and the plot from the CSV file of a folder."""
    rows, facts = read_csv(folder / "ephemeris.csv", Row)
    text = PAGE.format(answer=answer(rows), **facts)
    (folder / "ephemeris.md").write_text(text, encoding="utf-8")
    write_plot(rows, folder / "ephemeris.svg")


if __name__ == "__main__":
    main()
