"""Coverage of the default constellations: by latitude, over a day.

Targets 20 km up, every 4 degrees of latitude and 30 of longitude, and every satellite of a fleet,
through the engine's own test of visibility. A place is covered while at least one satellite of the
fleet sees it.
"""

import numpy as np
from pages import Table, draw_lines, markdown_table, options_of, publish, svg_plot

import opir_core as opir
from opir_core.geometry import geodetic_to_ecef
from opir_core.planning.visibility import visible_now

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

*Which latitudes does each default constellation see, for how much of the day, and with how many
satellites?* Orbital slots, orbits and fields of regard are notional.

{table}

The geostationary fleets see nothing at 88° N and S; from 76° to 84° two satellites see only a
third of the longitudes. HEO sees everything north of 36° N all day, and everything north of 52° N
with two satellites; further south it has gaps of up to 11 hours. LEO sees the whole Earth all day.

![Share of a day with at least one and at least two satellites in view, by latitude](coverage.svg)

*Two satellites*: share of the day with two or more in view, as stereo tracking needs, and
*satellites in view*, their mean number: the smallest and the largest of all latitudes within ±72°.
*Longest gap*: for which no satellite sees a place. Targets are {height_km:g} km up, every 4° of
latitude and 30° of longitude; times every {step_s:g} s of a day. By latitude:
[coverage.csv](coverage.csv).
"""
HEAD = ("fleet", "covered all day", "two satellites", "satellites in view", "longest gap, min")


def satellites_in_view(constellations, step_s):
    """Return how many satellites see each place at each time (latitudes, longitudes, times)."""
    scene = {
        "scene": "coverage",
        "epoch": "2026-04-01T00:00:00Z",
        "duration_s": 1.0,
        "seed": 1,
        "sensors": [{"constellation": name} for name in constellations],
        "targets": [],
    }
    grid = np.meshgrid(np.radians(LATITUDES_DEG), np.radians(LONGITUDES_DEG), indexing="ij")
    latitude, longitude = (axis.ravel() for axis in grid)
    place_m = geodetic_to_ecef(latitude, longitude, np.full(latitude.size, HEIGHT_M))
    time_s = np.arange(0.0, DAY_S, step_s)
    count = np.zeros((len(place_m), len(time_s)), dtype=np.int64)
    for sensor in opir.compile_plan(opir.scene_from_mapping(scene)).sensors:
        for column, satellite_m in enumerate(sensor.orbit.position_ecef_m(time_s)):
            satellites_m = np.broadcast_to(satellite_m, place_m.shape)
            count[:, column] += visible_now(sensor, satellites_m, place_m)
    return count.reshape(len(LATITUDES_DEG), len(LONGITUDES_DEG), -1)


def longest_gap_s(seen, step_s):
    """Return the longest run of times (n,), over the day's end and into the next, in which a place
    is not seen.
    """
    if not seen.any():
        return DAY_S
    turned = np.roll(seen, -int(np.argmax(seen)))
    ends = np.flatnonzero(np.append(turned, True))
    return float(np.diff(ends, prepend=-1).max() - 1) * step_s


def rows_of(step_s):
    """Yield the coverage of each fleet by latitude."""
    for fleet, constellations in FLEETS.items():
        counts = satellites_in_view(constellations, step_s)
        for latitude_deg, count in zip(LATITUDES_DEG.tolist(), counts, strict=True):
            yield {
                "latitude_deg": latitude_deg,
                "fleet": fleet,
                "covered": float((count > 0).mean()),
                "twice": float((count > 1).mean()),
                "satellites": float(count.mean()),
                "longest_gap_s": max(longest_gap_s(place > 0, step_s) for place in count),
            }


def span(values):
    """Return the smallest and the largest of some values, or the one value that all have."""
    low = f"{min(values):.2f}"
    high = f"{max(values):.2f}"
    return low if low == high else f"{low} to {high}"


def latitude_text(latitude_deg):
    """Return a latitude with its hemisphere."""
    return f"{abs(latitude_deg):g}° {'S' if latitude_deg < 0.0 else 'N'}" if latitude_deg else "0°"


def page(table):
    """Return the page."""
    lines = []
    for fleet in table.names("fleet"):
        rows = table.where(fleet=fleet)
        inside = Table(row for row in rows if abs(row["latitude_deg"]) <= 72.0)
        covered = rows.where(covered=1).column("latitude_deg")
        belt = f"{latitude_text(covered[0])} to {latitude_text(covered[-1])}" if covered else "none"
        gap_s = max(rows.column("longest_gap_s"))
        gap = "a day" if gap_s >= DAY_S else f"{gap_s / 60.0:.0f}"
        lines.append(
            (fleet, belt, span(inside.column("twice")), span(inside.column("satellites")), gap)
        )
    return PAGE.format(
        table=markdown_table(HEAD, lines),
        height_km=HEIGHT_M / 1e3,
        step_s=table.facts["step_s"],
    )


def draw(path, table):
    """Draw coverage against latitude."""
    labels = {
        "covered": "share of the day with a satellite in view",
        "twice": "share with two or more",
        "satellites": "satellites in view, mean",
    }
    with svg_plot(path, 1, 3, figsize=(11.0, 4.6), sharey=True) as (_, axes):
        for panel, (name, label) in zip(axes, labels.items(), strict=True):
            draw_lines(panel, table, "fleet", name, "latitude_deg", "-")
            panel.set(xlabel=label, xlim=(0.0, None), ylim=(-90.0, 90.0))
        axes[0].set_ylabel("latitude, deg")


def main():
    """Measure and write."""
    options = options_of(__doc__, step_s=300.0)
    publish(options, page, draw, {"step_s": options.step_s}, coverage=rows_of(options.step_s))


if __name__ == "__main__":
    main()
