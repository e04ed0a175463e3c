"""Coverage of the default constellations: by latitude, over a day.

    python benchmarks/coverage.py [--step-s 300] [--write docs/benchmarks]

Targets 20 km up, every 4 degrees of latitude and 30 of longitude, and every satellite of a fleet, through the engine's
own test of visibility. A place is covered while at least one satellite of the fleet sees it. `--write` puts a table,
and, where matplotlib is installed, a plot into a folder.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from opir_core.geometry import geodetic_to_ecef
from opir_core.interfaces.protocols import Sensor
from opir_core.planning.plan import compile_plan
from opir_core.planning.visibility.margins import visible_now
from opir_core.scene.reading import scene_from_mapping

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

Made by `python benchmarks/coverage.py --write docs/benchmarks`: targets {height_km:g} km up, every 4° of latitude and
30° of longitude, every {step_s:g} s of a day. Slots, orbits and fields of regard are notional.

- *covered*: the share of the day and of the longitudes of a band of latitude in which at least one satellite sees a
  place;
- *twice*: in which at least two do, so that lines of sight can be crossed;
- *satellites*: how many see it, on average;
- *longest gap*: the longest time, s, for which a place of the band is seen by none; a day where it never is.

{table}

![Share of a day with at least one and at least two satellites in view, by latitude](coverage.svg)
"""


class Coverage(NamedTuple):
    """What a fleet sees, by latitude."""

    covered: NDArray[np.float64]
    twice: NDArray[np.float64]
    satellites: NDArray[np.float64]
    longest_gap_s: NDArray[np.float64]


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
    latitude, longitude = np.meshgrid(np.radians(LATITUDES_DEG), np.radians(LONGITUDES_DEG), indexing="ij")
    return geodetic_to_ecef(latitude.ravel(), longitude.ravel(), np.full(latitude.size, HEIGHT_M))


def in_view(sensors: tuple[Sensor, ...], step_s: float) -> NDArray[np.int64]:
    """Return how many sensors see each place at each time, (places, times)."""
    time_s, place_m = np.arange(0.0, DAY_S, step_s), places_ecef_m()
    count = np.zeros((len(place_m), len(time_s)), dtype=np.int64)
    for sensor in sensors:
        position_m = sensor.orbit.position_ecef_m(time_s)
        for column, here in enumerate(position_m):
            count[:, column] += visible_now(sensor, np.broadcast_to(here, place_m.shape), place_m)
    return count


def longest_gap_s(seen: NDArray[np.bool_], step_s: float) -> float:
    """Return the longest run of times, over the day's end and into the next, in which a place is not seen."""
    if not seen.any():
        return DAY_S
    turned = np.roll(seen, -int(np.argmax(seen)))
    ends = np.flatnonzero(np.append(turned, True))
    return float(np.diff(ends, prepend=-1).max() - 1) * step_s


def coverage(constellations: list[str], step_s: float) -> Coverage:
    """Return the coverage of constellations together."""
    count = in_view(sensors_of(constellations), step_s)
    bands = count.reshape(len(LATITUDES_DEG), -1)
    gaps = np.array([longest_gap_s(row > 0, step_s) for row in count]).reshape(len(LATITUDES_DEG), -1)
    return Coverage((bands > 0).mean(1), (bands > 1).mean(1), bands.mean(1), gaps.max(1))


def table(found: dict[str, Coverage]) -> str:
    """Return the figures of every fourth latitude."""
    lines = ["| latitude, deg | fleet | covered | twice | satellites | longest gap, s |", "|---|---|---|---|---|---|"]
    for row in range(0, len(LATITUDES_DEG), 4):
        for name, fleet in found.items():
            share = f"{fleet.covered[row]:.3f} | {fleet.twice[row]:.3f} | {fleet.satellites[row]:.2f}"
            lines.append(f"| {LATITUDES_DEG[row]:g} | {name} | {share} | {fleet.longest_gap_s[row]:g} |")
    return "\n".join(lines)


def plot(found: dict[str, Coverage], path: Path) -> None:
    """Draw coverage against latitude."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "opir"
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(11.0, 4.2), sharey=True, layout="constrained")
    for axis, name, label in zip(
        axes,
        ("covered", "twice", "satellites"),
        ("share of the day with a satellite in view", "share with two or more", "satellites in view, mean"),
        strict=True,
    ):
        # Three fleets have four even slots each: their lines lie on one another, and each is to be seen.
        for (fleet, values), width, style in zip(
            found.items(), (5.0, 3.0, 1.2, 1.6, 1.6), ("-", "-", "--", "-", "-"), strict=True
        ):
            axis.plot(getattr(values, name), LATITUDES_DEG, label=fleet, linewidth=width, linestyle=style)
        axis.set(xlabel=label, xlim=(0.0, None), ylim=(-90.0, 90.0))
        axis.set_yticks(range(-90, 91, 30))
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("latitude, deg")
    axes[2].legend(frameon=False, loc="center right")
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Print the table; with `--write`, make the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--step-s", type=float, default=300.0)
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    found = {name: coverage(constellations, arguments.step_s) for name, constellations in FLEETS.items()}
    print(table(found))
    if arguments.write:
        page = PAGE.format(height_km=HEIGHT_M / 1e3, step_s=arguments.step_s, table=table(found))
        (arguments.write / "coverage.md").write_text(page)
        plot(found, arguments.write / "coverage.svg")


if __name__ == "__main__":
    main()
