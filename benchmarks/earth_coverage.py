"""Coverage of the default constellations: by latitude, over a day.

    python benchmarks/earth_coverage.py [--step-s 300] [--write docs/benchmarks] [--from-csv
    docs/benchmarks]

Targets 20 km up, every 4 degrees of latitude and 30 of longitude, and every satellite of a fleet,
through the engine's own test of visibility. A place is covered while at least one satellite of the
fleet sees it. `--write` puts the page, its data as a CSV file and, where matplotlib is installed, a
plot into a folder; `--from-csv` draws page and plot again from the CSV file in a folder.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from work_precision.results_csv import read_csv, write_csv

from opir_core.geometry import geodetic_to_ecef
from opir_core.planning.plan import compile_plan
from opir_core.planning.visibility import visible_now
from opir_core.plugin import Sensor
from opir_core.reading import scene_from_mapping

FLEETS = {
    "DSP": ["DSP"],
    "SBIRS-GEO": ["SBIRS-GEO"],
    "NEXTGEN-GEO": ["NEXTGEN-GEO"],
    "HEO": ["HEO-MOLNIYA", "HEO-TUNDRA"],
    "LEO": ["LEO-WIDE", "LEO-MEDIUM"],
}
HEIGHT_M = 20e3
LATITUDES_DEG = np.arange(-88.0, 89.0, 4.0)
LONGITUDES_DEG = np.arange(-180.0, 180.0, 30.0)
DAY_S = 86400.0

PAGE = """# Coverage of the default constellations

*Which latitudes does each default constellation see, for how much of the day, and with how many satellites?* Orbital
slots, orbits and fields of regard are notional.

{table}

{remarks}

![Share of a day with at least one and at least two satellites in view, by latitude](coverage.svg)

*Two satellites*: share of the day with two or more in view, as stereo tracking needs, and *satellites in view*, their
mean number: the smallest and the largest of all latitudes within ±72°. *Longest gap*: for which no satellite sees a
place. Targets are {height_km:g} km up, every 4° of latitude and 30° of longitude; times every {step_s:g} s of a day. By
latitude: [coverage.csv](coverage.csv).
"""

REMARKS = """The geostationary fleets see nothing at 88° N and S; from 76° to 84° two satellites see only a third of the
longitudes. HEO sees everything north of 36° N all day, and everything north of 52° N with two satellites; further
south it has gaps of up to 11 hours. LEO sees the whole Earth all day."""


class Row(NamedTuple):
    """What a fleet sees at a latitude: shares of the day with one and with two satellites, mean
    number, longest gap.
    """

    latitude_deg: float
    fleet: str
    covered: float
    twice: float
    satellites: float
    longest_gap_s: float


def sensors_of(constellations: list[str]) -> tuple[Sensor, ...]:
    """Return the sensors of constellations, as a scene gets them."""
    scene = {
        "scene": "coverage",
        "epoch": "2026-04-01T00:00:00Z",
        "duration_s": 1.0,
        "seed": 1,
        "sensors": [{"constellation": name} for name in constellations],
        "targets": [],
    }
    return compile_plan(scene_from_mapping(scene)).sensors


def places_ecef_m() -> NDArray[np.float64]:
    """Return the targets, latitude by latitude, (n, 3)."""
    latitude, longitude = np.meshgrid(
        np.radians(LATITUDES_DEG), np.radians(LONGITUDES_DEG), indexing="ij"
    )
    return geodetic_to_ecef(latitude.ravel(), longitude.ravel(), np.full(latitude.size, HEIGHT_M))


def in_view(sensors: tuple[Sensor, ...], step_s: float) -> NDArray[np.int64]:
    """Return how many sensors see each place at each time, (places, times)."""
    time_s = np.arange(0.0, DAY_S, step_s)
    place_m = places_ecef_m()
    count = np.zeros((len(place_m), len(time_s)), dtype=np.int64)
    for sensor in sensors:
        position_m = sensor.orbit.position_ecef_m(time_s)
        for column, here in enumerate(position_m):
            count[:, column] += visible_now(sensor, np.broadcast_to(here, place_m.shape), place_m)
    return count


def longest_gap_s(seen: NDArray[np.bool_], step_s: float) -> float:
    """Return the longest run of times, over the day's end and into the next, in which a place is
    not seen.
    """
    if not seen.any():
        return DAY_S
    turned = np.roll(seen, -int(np.argmax(seen)))
    ends = np.flatnonzero(np.append(turned, True))
    return float(np.diff(ends, prepend=-1).max() - 1) * step_s


def coverage(fleet: str, constellations: list[str], step_s: float) -> list[Row]:
    """Return the coverage of constellations together, by latitude."""
    count = in_view(sensors_of(constellations), step_s)
    bands = count.reshape(len(LATITUDES_DEG), -1)
    gaps = np.array([longest_gap_s(row > 0, step_s) for row in count]).reshape(
        len(LATITUDES_DEG), -1
    )
    columns = (bands > 0).mean(1), (bands > 1).mean(1), bands.mean(1), gaps.max(1)
    return [
        Row(float(latitude), fleet, *map(float, values))
        for latitude, *values in zip(LATITUDES_DEG, *columns, strict=True)
    ]


def table(rows: list[Row]) -> str:
    """Return one line for each fleet."""
    lines = [
        "| fleet | covered all day | two satellites | satellites in view | longest gap, min |",
        "|---|---|---|---|---|",
    ]
    for fleet in FLEETS:
        own = [row for row in rows if row.fleet == fleet]
        gap_s = max(row.longest_gap_s for row in own)
        inside = [row for row in own if abs(row.latitude_deg) <= 72.0]
        spans = " | ".join(
            span([getattr(row, column) for row in inside]) for column in ("twice", "satellites")
        )
        gap = "a day" if gap_s >= DAY_S else f"{gap_s / 60.0:.0f}"
        lines.append(f"| {fleet} | {covered_all_day(own)} | {spans} | {gap} |")
    return "\n".join(lines)


def span(values: list[float]) -> str:
    """Return the smallest and the largest of some values, or the one value that all have."""
    low = f"{min(values):.2f}"
    high = f"{max(values):.2f}"
    return low if low == high else f"{low} to {high}"


def covered_all_day(rows: list[Row]) -> str:
    """Return the range of latitudes in which a fleet sees every place all day; it is one range for
    all of them.
    """
    whole = [row.latitude_deg for row in rows if row.covered == 1.0]
    return f"{named(whole[0])} to {named(whole[-1])}" if whole else "none"


def named(latitude_deg: float) -> str:
    """Return a latitude with its hemisphere."""
    return f"{abs(latitude_deg):g}° {'S' if latitude_deg < 0.0 else 'N'}" if latitude_deg else "0°"


def plot(rows: list[Row], path: Path) -> None:
    """Draw coverage against latitude."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "opir"
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(11.0, 4.6), sharey=True, layout="constrained")
    for axis, name, label in zip(
        axes,
        ("covered", "twice", "satellites"),
        (
            "share of the day with a satellite in view",
            "share with two or more",
            "satellites in view, mean",
        ),
        strict=True,
    ):
        # Three fleets have four even slots each: their lines coincide, so widths differ.
        for fleet, width, style in zip(
            FLEETS, (5.0, 3.0, 1.2, 1.6, 1.6), ("-", "-", "--", "-", "-"), strict=True
        ):
            own = [row for row in rows if row.fleet == fleet]
            values = [getattr(row, name) for row in own]
            latitude = [row.latitude_deg for row in own]
            axis.plot(values, latitude, label=fleet, linewidth=width, linestyle=style)
        axis.set(xlabel=label, xlim=(0.0, None), ylim=(-90.0, 90.0))
        axis.set_yticks(range(-90, 91, 30))
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("latitude, deg")
    figure.legend(
        *axes[2].get_legend_handles_labels(), frameon=False, loc="outside lower center", ncols=5
    )
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Print the table; with `--write`, make the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--step-s", type=float, default=300.0)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--from-csv", type=Path)
    arguments = parser.parse_args()
    if arguments.from_csv:
        redraw(arguments.from_csv)
        return
    rows = [
        row for fleet, names in FLEETS.items() for row in coverage(fleet, names, arguments.step_s)
    ]
    print(table(rows))
    if arguments.write:
        write_csv(arguments.write / "coverage.csv", rows, {"step_s": arguments.step_s})
        redraw(arguments.write)


def redraw(folder: Path) -> None:
    """Write the page and the plot from the CSV file of a folder."""
    rows, facts = read_csv(folder / "coverage.csv", Row)
    page = PAGE.format(
        height_km=HEIGHT_M / 1e3, step_s=float(facts["step_s"]), table=table(rows), remarks=REMARKS
    )
    (folder / "coverage.md").write_text(page, encoding="utf-8")
    plot(rows, folder / "coverage.svg")


if __name__ == "__main__":
    main()
