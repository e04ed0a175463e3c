"""Atmospheric transmittance: run time and error of several interpolations of LOWTRAN's table.

All climates, bands and spectra of the shipped table, or every N-th of them. Errors are differences
of transmittance: at the table's own points, at each inner height and zenith angle omitted in turn,
and from LOWTRAN7 itself at random places between the points (`tests/data/lowtran7_between.csv`, and
below the horizon `lowtran7_below.csv`, by `docs/design/lowtran_table.py`). Times are processor time
of one core, medians.
"""

from functools import cache
from pathlib import Path

import numpy as np
from atmosphere_left_out import Way, left_out, region_rows
from opir_photons.radiometry.configs import CLIMATES
from opir_photons.radiometry.long_paths import CLIMBS
from opir_photons.radiometry.lowtran import (
    GRID_SHAPE,
    LowtranAtmosphere,
    fine_grid,
    node_tables,
    shell_air_mass,
)
from pages import (
    markdown_table,
    median_s,
    options_of,
    publish,
    read_csv,
    shown,
    svg_plot,
)

from opir_core.interfaces.radiometric_models import Paths

#: LOWTRAN7's own values between the table's points, above and below the horizon.
DATA = Path(__file__).parents[1] / "tests" / "data"
ABOVE = "lowtran7_between.csv"
BELOW = "lowtran7_below.csv"
SHAPES = ((8, 26), (16, 51), (32, 101), (63, 201), (125, 401), (249, 801))
#: The interpolations in the table of the page; the CSV file has all.
SHOWN = (
    "bilinear in ln τ over height and air mass",
    "grid 32 x 101",
    "grid 125 x 401",
    "grid 249 x 801",
)
LEAST = 1e-26

PAGE = """# Atmospheric transmittance: error and run time

*How far is an interpolated transmittance from LOWTRAN7, and what does it cost?* The `lowtran`
atmosphere has the grid of 125 x 401: {between:.3f} between the points of the table, {below:.3f} on
limb paths, {nanoseconds:.0f} ns per look. A target above 100 km needs no lookup: {space_ns} ns.

![Error against time](atmosphere.svg)

{table}

Errors are the largest differences of transmittance over the {tables} tables of LOWTRAN7 that opir
ships:

- *between*: at {places} random heights and zenith angles between the table's points;
- *limb*: at {paths} paths to a sensor below the target's horizon, with lowest points at 2.5 km or
  more. For these the `lowtran` atmosphere has a second grid, of 81 climbs by as many lowest
  heights.

Without one of the table's points, interpolation over the gap, two to three times as wide, is off
by {omitted:.3f} at most; the tests allow 0.03. [By region](atmosphere_omitted.csv). [All
interpolations](atmosphere.csv), also with errors at the table's own points (`at_points`) and from
a grid four times as fine (`from_curves`).
"""


def secant_law(nodes):
    """Return exp(-(optical depth straight up) / sine), with optical depths straight in height."""
    depth = -np.log(np.maximum(nodes.transmittance[:, 0], LEAST))
    return lambda height, sine: np.exp(-np.interp(height, nodes.height_m, depth) / sine)


def bilinear(nodes):
    """Return the bilinear interpolation of ln τ over height and air mass."""
    depth = -np.log(np.maximum(nodes.transmittance, LEAST))
    masses = shell_air_mass(np.cos(nodes.zenith_rad))

    def model(height_m, sine):
        row, up = bracket(nodes.height_m, height_m)
        column, across = bracket(masses, shell_air_mass(sine))
        lower = depth[row, column] * (1.0 - across) + depth[row, column + 1] * across
        upper = depth[row + 1, column] * (1.0 - across) + depth[row + 1, column + 1] * across
        return np.exp(-(lower * (1.0 - up) + upper * up))

    return model


def gridded(shape):
    """Return opir's own way with a grid of slants and heights."""

    def model_of(nodes):
        atmosphere = LowtranAtmosphere((fine_grid(nodes, shape),), None)
        return lambda height, sine: atmosphere._looked_up((0,), height, sine)[0]

    return model_of


#: Ways to interpolate, and their kB per band.
WAYS: dict[str, tuple[Way, float]] = {
    "exp(-τ(nadir) sec z)": (secant_law, 26 * 8 / 1024),
    "bilinear in ln τ over height and air mass": (bilinear, 26 * 12 * 8 / 1024),
    **{f"grid {a} x {b}": (gridded((a, b)), (a + CLIMBS) * b * 8 / 1024) for a, b in SHAPES},
}


def bracket(points, values):
    """Return the gaps between points that values lie in, and how far across."""
    row = np.clip(np.searchsorted(points, values, side="right") - 1, 0, len(points) - 2)
    return row, (values - points[row]) / (points[row + 1] - points[row])


@cache
def tables():
    """Return all tables."""
    skies = [(climate, "rural23km") for climate in CLIMATES] + [("us1976", "none")]
    return [
        nodes
        for sky in skies
        for spectrum in ("flat", "blackbody-1500K")
        for nodes in node_tables(*sky, spectrum).values()
    ]


def error_at_points(way, nodes):
    """Return the largest error at a table's points."""
    height_m, zenith_rad = np.meshgrid(nodes.height_m, nodes.zenith_rad, indexing="ij")
    transmittance = way(nodes)(height_m.ravel(), np.cos(zenith_rad).ravel())
    return float(np.abs(transmittance - nodes.transmittance.ravel()).max())


def error_left_out(way, nodes, kind):
    """Return the largest error at points left out of their tables."""
    errors = (error for table in nodes for _, error in left_out(way, table, kind))
    return max(float(error.max()) for error in errors)


@cache
def lowtran_values(file):
    """Return LOWTRAN7's own values between the points."""
    return read_csv(DATA / file)


def error_between(way, file, every):
    """Return the largest difference from LOWTRAN7 between the table's points, for every n-th
    climate.
    """
    values = lowtran_values(file)
    worst = 0.0
    for sky in sorted({(row["atmosphere"], row["aerosol"]) for row in values})[::every]:
        group = values.where(atmosphere=sky[0], aerosol=sky[1])
        height_m = 1e3 * np.array(group.column("h_km"))
        sine = np.cos(np.radians(group.column("zen_deg")))
        for name, nodes in node_tables(*sky, "flat").items():
            error = way(nodes)(height_m, sine) - np.array(group.column(name))
            worst = max(worst, float(np.abs(error).max()))
    return worst


def looks(count):
    """Return random heights up to 100 km and sines of elevation above 5 degrees."""
    rng = np.random.default_rng(1)
    return rng.uniform(0.0, 99_999.0, count), rng.uniform(np.sin(np.radians(5.0)), 1.0, count)


def from_curves(name, count=20_000):
    """Return the largest difference of a grid from one four times as fine, nan for other ways."""
    if not name.startswith("grid"):
        return float("nan")
    slants, heights = map(int, name.removeprefix("grid ").split(" x "))
    coarse = gridded((slants, heights))
    fine = gridded((4 * (slants - 1) + 1, 4 * (heights - 1) + 1))
    hardest = [nodes for nodes in tables() if nodes.band.name in {"SWIR", "MWIR_N", "LWIR"}][:6]
    places = looks(count)
    return max(
        float(np.abs(coarse(nodes)(*places) - fine(nodes)(*places)).max()) for nodes in hardest
    )


def row_of(name, options):
    """Return the row of one way."""
    way, kilobytes = WAYS[name]
    nodes = tables()[0]
    subset = tables()[:: options.every]
    model = way(nodes)
    places = looks(options.looks)
    is_grid = name.startswith("grid")
    return {
        "way": name,
        "at_points": max(error_at_points(way, table) for table in subset),
        "angle_out": np.nan if way is secant_law else error_left_out(way, subset, "an angle"),
        "height_out": error_left_out(way, subset, "a height"),
        "between": error_between(way, ABOVE, options.every),
        "below": error_between(way, BELOW, options.every) if is_grid else np.nan,
        "from_curves": from_curves(name),
        "nanoseconds": 1e9 * median_s(lambda: model(*places), options.repeat) / options.looks,
        "build_ms": 1e3 * median_s(lambda: way(nodes), options.repeat),
        "kilobytes": kilobytes,
    }


def nanoseconds_above_the_air(count, repeat):
    """Return the time of a look at a target above 100 km."""
    atmosphere = LowtranAtmosphere((fine_grid(tables()[0]),), None)
    blank = np.zeros((count, 3))
    paths = Paths(np.full(count, 2e5), np.full(count, 0.5), blank, blank, np.zeros(count))
    return 1e9 * median_s(lambda: atmosphere.transmittance(0, paths), repeat) / count


def rows_of(options, facts):
    """Yield the rows of all ways."""
    facts["tables"] = len(tables()[:: options.every])
    facts["space_ns"] = round(nanoseconds_above_the_air(options.looks, options.repeat), 1)
    for name in WAYS:
        yield row_of(name, options)


def omitted_rows(every):
    """Yield the errors of the shipped grid with points left out, by region."""
    yield from region_rows(gridded(GRID_SHAPE), tables()[::every])


def page(table, omitted):
    """Return the page."""
    shipped = table.row(way="grid {} x {}".format(*GRID_SHAPE))
    lines = [
        (
            row["way"],
            f"{row['between']:.3g}",
            shown(row["below"], ".2g"),
            f"{row['nanoseconds']:.0f}",
            f"{row['kilobytes']:.0f}",
        )
        for row in table
        if row["way"] in SHOWN
    ]
    head = ("interpolation", "between", "limb", "ns per look", "kB per band")
    return PAGE.format(
        **{name: shipped[name] for name in ("between", "below", "nanoseconds")},
        table=markdown_table(head, lines),
        omitted=max(omitted.column("error")),
        places=len(lowtran_values(ABOVE)),
        paths=len(lowtran_values(BELOW)),
        **table.facts,
    )


def draw(path, table):
    """Draw error against time."""
    with svg_plot(path, figsize=(7, 4)) as (_, axes):
        times_ns = table.column("nanoseconds")
        axes.plot(times_ns, table.column("at_points"), "o", label="at the table's points")
        axes.plot(times_ns, table.column("between"), "o", label="between them")
        for row in table:
            axes.annotate(row["way"], (row["nanoseconds"], row["at_points"]), fontsize=6)
        axes.set(yscale="log", xlabel="time per look, ns", ylabel="largest error of transmittance")


def main():
    """Measure and write; `--every N` takes every N-th of the tables."""
    options = options_of(__doc__, looks=1_000_000, repeat=7, every=1)
    facts = {}
    publish(
        options,
        page,
        draw,
        facts,
        atmosphere=rows_of(options, facts),
        atmosphere_omitted=omitted_rows(options.every),
    )


if __name__ == "__main__":
    main()
