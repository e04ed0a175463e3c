"""Ephemerides of flights: build time, memory, evaluation time and error against the tolerance.

Flights of all five classes, from ignition to burnout and on to impact. Errors are the largest over
a million random points, against the boost's own series and two-body propagation. Positions are
evaluated for targets x 1000 times in one call, in order (as a grid) and shuffled (each point
another target and time). Times are processor time of one core, medians.
"""

import numpy as np
from pages import draw_lines, markdown_table, median_s, options_of, publish, svg_plot

from opir_core.flight.aiming import aim, boost_ephemeris, coast_ephemeris
from opir_core.flight.boost import boost_profiles
from opir_core.flight.ephemeris import Ephemeris
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import Geodetic, eci_to_ecef, geodesic_direct

TOLERANCES_M = (10.0, 1.0, 0.1, 0.01, 1e-3, 1e-4, 1e-5)
#: Tolerances in the table of the page.
SHOWN_M = (1.0, 0.01, 1e-4)

PAGE = """# Ephemerides: accuracy against run time

*What does a tolerance on the position of targets cost in time and memory?* An ephemeris stores a
flight as piecewise polynomials that are fitted to a tolerance. Its error is at most {share:.2f}
times the tolerance. At the default of 1 cm a whole flight takes {build:.0f} µs and {kilobytes:.0f}
kB to build, and {position:.0f} ns per position.

![Build time, memory and evaluation time against tolerance](ephemeris.svg)

{table}

*Boost*: from ignition to burnout; *flight*: to impact. Errors are the largest over a million
random points of {targets} flights of all classes; times those of all targets at 1000 times in one
call. Times of shuffled positions, and with velocity: [ephemeris.csv](ephemeris.csv).
"""
COLUMNS = {
    "span": "span",
    "tolerance_m": "tolerance, m",
    "error_m": "largest error, m",
    "kilobytes": "kB per target",
    "build_us": "build, µs per target",
    "ordered_ns": "in order, ns per point",
    "shuffled_ns": "shuffled, ns",
}


def flights(count):
    """Return flights of all classes over random ranges in random directions."""
    rng = np.random.default_rng(1)
    classes = list(boost_profiles().values())
    profiles = [classes[row % len(classes)] for row in range(count)]
    ranges = [
        rng.uniform(1.001 * profile.minimum_range_m, 0.999 * profile.maximum_range_m)
        for profile in profiles
    ]
    latitude = np.arcsin(rng.uniform(-1, 1, count))
    longitude = rng.uniform(-np.pi, np.pi, count)
    azimuth = rng.uniform(0, 2 * np.pi, count)
    end = geodesic_direct(latitude, longitude, azimuth, np.array(ranges))
    start = Geodetic(latitude, longitude, 0.0)
    return aim(start, Geodetic(*end, 0.0), rng.uniform(0.0, 600.0, count), profiles)


def exact_m(flight, target, time_s):
    """Return positions (n, 3) without an ephemeris."""
    burnout_s = flight.burnout_s[target]
    boost, _ = flight.path.state(target, time_s)
    coast, _ = propagate_kepler(
        flight.burnout_position_eci_m[target],
        flight.burnout_velocity_eci_m_s[target],
        np.maximum(time_s - burnout_s, 0.0),
    )
    return np.where((time_s <= burnout_s)[:, None], boost, eci_to_ecef(coast, time_s))


def largest_error_m(ephemeris, flight, points):
    """Return the largest error over random points, half of them crowded towards the start."""
    rng = np.random.default_rng(2)
    worst_m = 0.0
    for _ in range(10):
        target = rng.integers(0, len(ephemeris), points // 10)
        share = rng.random(len(target))
        share = np.where(rng.random(len(share)) < 0.5, share, share**4)
        time_s = ephemeris.start_s[target] + share * (ephemeris.end_s - ephemeris.start_s)[target]
        error_m = ephemeris.position_m(target, time_s) - exact_m(flight, target, time_s)
        worst_m = max(worst_m, float(np.linalg.norm(error_m, axis=1).max()))
    return worst_m


def kilobytes(ephemeris):
    """Return the memory of all the arrays of an ephemeris."""
    values = [
        getattr(record, name)
        for record in (ephemeris, ephemeris.segments)
        for name in type(record).__slots__
        if name != "__weakref__"
    ]
    return sum(array.nbytes for array in values if isinstance(array, np.ndarray)) / 1024


def row_of(
    span,
    build,
    flight,
    tolerance_m,
    points,
    repeat,
):
    """Return the row of one span and tolerance."""
    ephemeris = build(tolerance_m)
    count = len(ephemeris)
    target = np.repeat(np.arange(count), 1000)
    share = np.tile(np.linspace(0.0, 1.0, 1000), count)
    start_s = ephemeris.start_s[target]
    end_s = ephemeris.end_s[target]
    time_s = np.minimum(start_s + share * (end_s - start_s), end_s)
    order = np.random.default_rng(3).permutation(len(target))
    mixed = (target[order], time_s[order])

    def nanoseconds(action):
        return 1e9 * median_s(action, repeat) / len(target)

    return {
        "span": span,
        "tolerance_m": tolerance_m,
        "error_m": largest_error_m(ephemeris, flight, points),
        "pieces": len(ephemeris.segments) / count,
        "kilobytes": kilobytes(ephemeris) / count,
        "build_us": 1e6 * median_s(lambda: build(tolerance_m), min(repeat, 3)) / count,
        "ordered_ns": nanoseconds(lambda: ephemeris.position_m(target, time_s)),
        "shuffled_ns": nanoseconds(lambda: ephemeris.position_m(*mixed)),
        "state_ns": nanoseconds(lambda: ephemeris.state(target, time_s)),
    }


def rows_of(targets, points, repeat):
    """Yield the rows of all spans and tolerances."""
    flight = flights(targets)
    spans = {
        "boost": lambda tolerance_m: boost_ephemeris(flight.path, tolerance_m),
        "flight": lambda tolerance_m: Ephemeris.joined(
            [boost_ephemeris(flight.path, tolerance_m), coast_ephemeris(flight, tolerance_m)]
        ),
    }
    for span, build in spans.items():
        for tolerance_m in TOLERANCES_M:
            yield row_of(span, build, flight, tolerance_m, points, repeat)


def page(table):
    """Return the page."""
    default = table.row(span="flight", tolerance_m=0.01)
    lines = [
        [row["span"], *(f"{row[name]:.3g}" for name in list(COLUMNS)[1:])]
        for row in table
        if row["tolerance_m"] in SHOWN_M
    ]
    return PAGE.format(
        share=max(row["error_m"] / row["tolerance_m"] for row in table),
        build=default["build_us"],
        kilobytes=default["kilobytes"],
        position=default["ordered_ns"],
        table=markdown_table(list(COLUMNS.values()), lines),
        targets=table.facts["targets"],
    )


def draw(path, table):
    """Draw build time, memory and evaluation time against tolerance."""
    names = ("build_us", "kilobytes", "ordered_ns")
    with svg_plot(path, 1, len(names), figsize=(11, 3.4)) as (_, axes):
        for panel, name in zip(axes, names, strict=True):
            draw_lines(panel, table, "span", "tolerance_m", name)
            panel.set(xscale="log", xlabel="tolerance, m", ylabel=COLUMNS[name], ylim=(0, None))
            panel.invert_xaxis()


def main():
    """Measure and write."""
    options = options_of(__doc__, targets=1000, points=1_000_000, repeat=7)
    rows = rows_of(options.targets, options.points, options.repeat)
    publish(options, page, draw, {"targets": options.targets}, ephemeris=rows)


if __name__ == "__main__":
    main()
