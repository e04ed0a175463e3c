"""Atmospheric transmittance: run time and error of several interpolations of LOWTRAN's table.

    python benchmarks/work_precision/atmosphere.py [--looks 1000000] [--repeat 7] [--every 1]
        [--write FOLDER] [--from-csv FOLDER]

All climates, bands and spectra of the shipped table, or every N-th of them. Errors are differences
of transmittance: at the table's own points, at each inner height and zenith angle omitted in turn,
and from LOWTRAN7 itself at random places between the points (`tests/data/lowtran7_between.csv`, and
below the horizon `lowtran7_below.csv`, by `docs/design/lowtran_table.py`). Times are processor time
of one core, medians. `--write` puts the page and, where matplotlib is installed, a plot into a
folder.
"""

import argparse
import csv
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from atmosphere_left_out import Model, Region, Way, left_out, regions
from opir_photons.radiometry.configs import CLIMATES
from opir_photons.radiometry.long_paths import CLIMBS
from opir_photons.radiometry.lowtran import (
    GRID_SHAPE,
    LowtranAtmosphere,
    NodeTable,
    fine_grid,
    node_tables,
    shell_air_mass,
)
from results_csv import read_csv, write_csv
from timing import median_s

from opir_core.interfaces.radiometric_models import Paths

#: Where LOWTRAN7's own values between the table's points stand.
DATA = Path(__file__).parents[2] / "tests" / "data"

#: LOWTRAN7's own values above and below the horizon.
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

PAGE = """# Atmospheric transmittance: error and run time

*How far is an interpolated transmittance from LOWTRAN7, and what does it cost?* The `lowtran` atmosphere has the grid
of 125 x 401: {answer} A target above
100 km needs no lookup: {space_ns} ns.

![Error against time](atmosphere.svg)

Errors are the largest differences of transmittance over the {tables} tables of LOWTRAN7 that opir ships:

- *between*: at {places} random heights and zenith angles between the table's points;
- *limb*: at {below} paths to a sensor below the target's horizon, with lowest points at 2.5 km or more. For these the
  `lowtran` atmosphere has a second grid, of 81 climbs by as many lowest heights.

Without one of the table's points, interpolation over the gap, two to three times as wide, is off by {omitted} at most;
the tests allow 0.03. [By region](atmosphere_omitted.csv). [All interpolations](atmosphere.csv), also with errors at the
table's own points (`at_points`) and from a grid four times as fine (`from_curves`).
"""


class Row(NamedTuple):
    """One line of the table."""

    way: str
    at_points: float
    angle_out: float
    height_out: float
    between: float
    below: float
    from_curves: float
    nanoseconds: float
    build_ms: float
    kilobytes: float


def secant_law(nodes: NodeTable) -> Model:
    """Return exp(-(optical depth straight up) / sine), with optical depths straight in height."""
    depth = -np.log(np.maximum(nodes.transmittance[:, 0], 1e-26))
    return lambda height, sine: np.exp(-np.interp(height, nodes.height_m, depth) / sine)


def bilinear(nodes: NodeTable) -> Model:
    """Return the bilinear interpolation of ln τ over height and air mass."""
    depth = -np.log(np.maximum(nodes.transmittance, 1e-26))
    masses = shell_air_mass(np.cos(nodes.zenith_rad))

    def model(height: np.ndarray, sine: np.ndarray) -> np.ndarray:
        (row, up), (column, across) = (
            placed(nodes.height_m, height),
            placed(masses, shell_air_mass(sine)),
        )
        lower = depth[row, column] * (1.0 - across) + depth[row, column + 1] * across
        upper = depth[row + 1, column] * (1.0 - across) + depth[row + 1, column + 1] * across
        return np.exp(-(lower * (1.0 - up) + upper * up))

    return model


def gridded(shape: tuple[int, int]) -> Way:
    """Return opir's own way with a grid of slants and heights."""

    def made(nodes: NodeTable) -> Model:
        atmosphere = LowtranAtmosphere((fine_grid(nodes, shape),), None)
        return lambda height, sine: atmosphere._looked_up((0,), height, sine)[0]

    return made


WAYS: dict[str, tuple[Way, float]] = {
    "exp(-τ(nadir) sec z)": (secant_law, 26 * 8 / 1024),
    "bilinear in ln τ over height and air mass": (bilinear, 26 * 12 * 8 / 1024),
    **{f"grid {a} x {b}": (gridded((a, b)), (a + CLIMBS) * b * 8 / 1024) for a, b in SHAPES},
}


def placed(points: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the gaps that places lie in, and how far across."""
    row = np.clip(np.searchsorted(points, at, side="right") - 1, 0, len(points) - 2)
    return row, (at - points[row]) / (points[row + 1] - points[row])


@cache
def tables() -> list[NodeTable]:
    """Return all tables."""
    skies = [(climate, "rural23km") for climate in CLIMATES] + [("us1976", "none")]
    return [
        nodes
        for sky in skies
        for spectrum in ("flat", "blackbody-1500K")
        for nodes in node_tables(*sky, spectrum).values()
    ]


def error_at(model: Model, nodes: NodeTable, rows: slice, columns: slice) -> float:
    """Return the largest error at some of a table's points."""
    height, zenith = np.meshgrid(nodes.height_m[rows], nodes.zenith_rad[columns], indexing="ij")
    found = model(height.ravel(), np.cos(zenith).ravel())
    return float(np.abs(found - nodes.transmittance[rows, columns].ravel()).max())


def worst_out(way: Way, chosen: list[NodeTable], kind: str) -> float:
    """Return the largest error at points left out of their tables."""
    return max(
        float(errors.error.max()) for nodes in chosen for errors in left_out(way, nodes, kind)
    )


@cache
def own_values(file: str) -> dict[tuple[str, str], list[dict[str, str]]]:
    """Return LOWTRAN7's own values between the points, by climate and aerosol."""
    lines = (DATA / file).read_text(encoding="utf-8").splitlines()
    found: dict[tuple[str, str], list[dict[str, str]]] = {}
    for row in csv.DictReader(line for line in lines if not line.startswith("#")):
        found.setdefault((row["atmosphere"], row["aerosol"]), []).append(row)
    return found


def own_error(way: Way, file: str, every: int) -> float:
    """Return the largest difference from LOWTRAN7 between the table's points, for every n-th
    climate.
    """
    worst = 0.0
    for sky, rows in list(own_values(file).items())[::every]:
        height, zenith = (
            np.array([float(row[name]) for row in rows]) for name in ("h_km", "zen_deg")
        )
        for name, nodes in node_tables(*sky, "flat").items():
            found = way(nodes)(height * 1e3, np.cos(np.radians(zenith)))
            worst = max(worst, float(np.abs(found - [float(row[name]) for row in rows]).max()))
    return worst


def looks(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return random heights up to 100 km and sines of elevation above 5 degrees."""
    rng = np.random.default_rng(1)
    return rng.uniform(0.0, 99_999.0, count), rng.uniform(np.sin(np.radians(5.0)), 1.0, count)


def from_curves(name: str, count: int) -> float:
    """Return how far a grid is from one four times as fine."""
    if not name.startswith("grid"):
        return float("nan")
    shape = tuple(int(part) for part in name.removeprefix("grid ").split(" x "))
    fine = (4 * (shape[0] - 1) + 1, 4 * (shape[1] - 1) + 1)
    where = looks(count)
    hardest = [nodes for nodes in tables() if nodes.band.name in {"SWIR", "MWIR_N", "LWIR"}][:6]
    return max(
        float(np.abs(gridded(shape)(nodes)(*where) - gridded(fine)(nodes)(*where)).max())
        for nodes in hardest
    )


def measured(name: str, options: argparse.Namespace) -> Row:
    """Return the table's line of one way."""
    way, kilobytes = WAYS[name]
    nodes = tables()[0]
    chosen = tables()[:: options.every]
    every = slice(None)
    count = options.looks
    repeat = options.repeat
    model = way(nodes)
    where = looks(count)
    return Row(
        way=name,
        at_points=max(error_at(way(table), table, every, every) for table in chosen),
        angle_out=worst_out(way, chosen, "an angle") if way is not secant_law else float("nan"),
        height_out=worst_out(way, chosen, "a height"),
        between=own_error(way, ABOVE, options.every),
        below=own_error(way, BELOW, options.every) if name.startswith("grid") else float("nan"),
        from_curves=from_curves(name, 20_000),
        nanoseconds=1e9 * median_s(lambda: model(*where), repeat) / count,
        build_ms=1e3 * median_s(lambda: way(nodes), repeat),
        kilobytes=kilobytes,
    )


def above_the_air(count: int, repeat: int) -> float:
    """Return the time of a look at a target above 100 km, ns."""
    atmosphere = LowtranAtmosphere((fine_grid(tables()[0]),), None)
    nowhere = np.zeros((count, 3))
    paths = Paths(np.full(count, 2e5), np.full(count, 0.5), nowhere, nowhere, np.zeros(count))
    return 1e9 * median_s(lambda: atmosphere.transmittance(0, paths), repeat) / count


def table(rows: list[Row]) -> str:
    """Return the rows on the page as a Markdown table."""
    head = "| interpolation | between | limb | ns per look | kB per band |\n|---|---|---|---|---|"
    lines = [
        f"| {r.way} | {r.between:.3g} | {shown(r.below)} | {r.nanoseconds:.0f} | {r.kilobytes:.0f}"
        f" |"
        for r in rows
        if r.way in SHOWN
    ]
    return "\n".join([head, *lines])


def answer(rows: list[Row]) -> str:
    """Return the errors and the time of the grid that opir has."""
    row = next(row for row in rows if row.way == "grid {} x {}".format(*GRID_SHAPE))
    return (
        f"{row.between:.3f} between the points of the table, {row.below:.3f} on limb paths,"
        f" {row.nanoseconds:.0f} ns per look."
    )


def shown(error: float) -> str:
    """Return an error, or an empty cell where it was not measured."""
    return "" if np.isnan(error) else f"{error:.2g}"


def write_plot(rows: list[Row], path: Path) -> None:
    """Write error against time."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(7, 4), constrained_layout=True)
    for column, label in (("at_points", "at the table's points"), ("between", "between them")):
        axis.plot(
            [r.nanoseconds for r in rows], [getattr(r, column) for r in rows], "o", label=label
        )
    for row in rows:
        axis.annotate(row.way, (row.nanoseconds, row.at_points), fontsize=6)
    axis.set(
        yscale="log",
        xlabel="time per look, ns",
        ylabel="largest error of transmittance",
        xlim=(0, None),
    )
    axis.legend()
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Measure and print; write where asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--looks", type=int, default=1_000_000)
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--every", type=int, default=1, help="every N-th of the tables")
    parser.add_argument("--write", type=Path)
    parser.add_argument("--from-csv", type=Path)
    options = parser.parse_args()
    if options.from_csv:
        redraw(options.from_csv)
        return
    rows = [measured(name, options) for name in WAYS]
    print(table(rows))
    if options.write:
        chosen = tables()[:: options.every]
        space_ns = f"{above_the_air(options.looks, options.repeat):.1f}"
        write_csv(
            options.write / "atmosphere.csv", rows, {"tables": len(chosen), "space_ns": space_ns}
        )
        write_csv(
            options.write / "atmosphere_omitted.csv", list(regions(gridded(GRID_SHAPE), chosen))
        )
        redraw(options.write)


def redraw(folder: Path) -> None:
    """Write the page and the plot from the CSV files of a folder."""
    rows, facts = read_csv(folder / "atmosphere.csv", Row)
    omitted, _ = read_csv(folder / "atmosphere_omitted.csv", Region)
    page = PAGE.format(
        answer=answer(rows),
        omitted=f"{max(region.error for region in omitted):.3f}",
        places=sum(len(rows) for rows in own_values(ABOVE).values()),
        below=sum(len(rows) for rows in own_values(BELOW).values()),
        **facts,
    )
    (folder / "atmosphere.md").write_text(page, encoding="utf-8")
    write_plot(rows, folder / "atmosphere.svg")


if __name__ == "__main__":
    main()
