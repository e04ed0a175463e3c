"""Is a hot source a missile? Ascents to orbit and short of it, stages that fly back, gliders; and
fires for an hour.

Flights are those of `ascents`, `glide_flights` and `foreign_flights` (notional, no code of opir),
with seeds that nothing was built on, or tables of a folder. SBIRS-GEO and the default tracker see
each alone. At marks: is the state in its 95 % ellipsoid, what is the probability of orbit, glide
and missile, does it come down, does the region hold?
"""

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from ascents import DARK_S, Ascent, drawn_ascent, drawn_near_orbit, drawn_return
from figures import keep
from fires_hour import fire_rows, fires_text
from foreign_flights import drawn_flight
from glide_flights import drawn_glide
from one_flight import (
    CONTAINMENT,
    START_S,
    flight_scene,
    impact_containment,
    longest_track,
    table_target,
    write_table,
)
from opir_scoring.containments import nees, proportion
from pages import Table, options_of, publish, svg_plot
from scipy.stats import chi2

import opir_core as opir

PAGE = """# Is what is hot a missile?

Fires burn for hours, launchers climb to orbit, stages fly back. What does `imm` say? 20 s after
the last burn it gives orbit a median probability of {orbit:.2f} for launchers that reach it and
{short:.2f} for those that come down, and gliders one of {glide:.2f} for a glide. Over all marks
{held:.0f} % of the states lie in their 95 % ellipsoid, and {inside} impacts in the 95 % region of
the true condition ("burn over" or "relights").

![Share of states held, and median probabilities of orbit, missile and glide, by flight and mark](open_world.svg)

Flights are notional and share no code with opir (`benchmarks/ascents.py`, `glide_flights.py`,
`foreign_flights.py`), {flights} of each kind with even seeds from {first}, which nothing was
built on. *Short of orbit*: cut off at 97 % of the orbital speed; *nearly in orbit*: at 7.36 km/s
over ground and 150 km, like Starship IFT-3 (14 March 2024), which came down after half of an
orbit. *Back to the site*: first stages that turn and burn against their motion. Each is a scene
of its own before two SBIRS-GEO, or one. Probabilities are medians over the flights at a mark;
P(down) is the sum over the conditions that have a region. Of a launcher that burns on, a region
is that of failures. All marks with their intervals (Wilson), numbers and areas of regions:
[open_world.csv](open_world.csv).
{fires}"""


class Kind(NamedTuple):
    """Flights: name on the page, a flight by its random numbers, and the number of sensors."""

    title: str
    drawn: Callable[[np.random.Generator], Ascent]
    stream: int
    sensors: int = 2


def staged(stages, gap_s):
    """Return a drawing of staged gravity turns with dark times between the stages."""

    def flight(rng):
        turn = drawn_flight(stages, bool(gap_s[1]), rng, gap_s)
        rows = turn.table[turn.table[:, 0] <= turn.burnout_s + DARK_S]
        longitude_deg = float(np.degrees(turn.boost.launch[1]))
        return Ascent(rows, turn.burns_s, longitude_deg, turn.impact[:2])

    return flight


KINDS = {
    "ascents": Kind("To orbit", drawn_ascent, 31),
    "short": Kind("Short of orbit", lambda rng: drawn_ascent(rng, 0.97), 37),
    "near": Kind("Nearly in orbit", drawn_near_orbit, 43),
    "returns": Kind("Back to the site", drawn_return, 41),
    "gliders": Kind("Gliders", drawn_glide, 47),
    "gaps": Kind("Two stages, 22 to 40 s apart", staged(2, (22.0, 40.0)), 53),
    "one": Kind("Three stages, one sensor", staged(3, (0.0, 0.0)), 59, 1),
}
FIRES = "open_world_fires.csv"
#: Names of marks of a burn, in order of time.
TIMES = ("half of", "95 % of", "5 s after", "20 s after", "40 s after")
#: The probabilities of a mark whose medians are columns of the data.
SHARES = ("burning", "orbit", "down", "missile", "glide")


def table_ascents(folder):
    """Yield the ascents of a folder's CSV files."""
    for path in sorted(folder.glob("*.csv")):
        rows = np.loadtxt(path, delimiter=",", skiprows=1)
        edges = np.flatnonzero(np.diff(rows[:, 7], prepend=0.0, append=0.0))
        times = np.append(rows[:, 0], rows[-1, 0])[edges].reshape(-1, 2)
        longitude_deg = float(np.degrees(np.arctan2(rows[0, 2], rows[0, 1])))
        yield Ascent(rows, tuple(map(tuple, times.tolist())), longitude_deg)


def mark_order(row):
    """Return the place of a mark among those of its flight: the burn, and the time from it."""
    time, _, burn = row["mark"].rpartition(" burn ")
    return int(burn), TIMES.index(time)


def marks_of(ascent):
    """Yield names and times since ignition of marks."""
    for number, (begin, end) in enumerate(ascent.burns_s, 1):
        yield f"half of burn {number}", 0.5 * (begin + end)
        if number > 1:
            yield f"95 % of burn {number}", begin + 0.95 * (end - begin)
        gaps_s = [start - end for start, _ in ascent.burns_s if start > end - 1e-6]
        for late_s in (5.0, 20.0, 40.0):
            if late_s < min(gaps_s, default=np.inf):
                yield f"{late_s:g} s after burn {number}", end + late_s


def figures_at(ascent, plan, track):
    """Return the figures of a track's row."""
    time_s = float(track.tick_s[0]) - START_S
    error = track.state - ascent.state(time_s)
    is_over = time_s >= ascent.burns_s[-1][1]
    inside, inputs = impact_containment(track, 0, ascent.impact, is_over)
    regions = [region for region in track.impact_regions[0] if region.containment == CONTAINMENT]
    glides = [hypothesis.group == "glide" for hypothesis in plan.hypotheses]
    return {
        "nees": float(nees(error, track.state_covariance)[0]),
        "burning": float(track.probability_burning[0]),
        "orbit": float(track.probability_orbit[0]),
        "down": float(sum(region.probability for region in regions)),
        "missile": float(track.probability_missile[0]),
        "glide": float(track.hypothesis_probability[0][glides].sum()),
        "inside": inside,
        "given": inputs,
        "area_km2": regions[0].area_km2 if regions else np.nan,
    }


def flown(ascent, path, seed, sensors):
    """Return the figures of an ascent's longest track at the marks, empty ones without a row."""
    write_table(path, ascent.rows)
    target = table_target(path, "SLV")
    duration_s = START_S + ascent.rows[-1, 0]
    scene = flight_scene(target, ascent.longitude_deg, duration_s, 9000 + seed, sensors)
    plan = opir.compile_plan(scene)
    track = longest_track(opir.run_of_plan(plan).tracks)
    figures = {}
    for name, time_s in marks_of(ascent):
        rows = np.flatnonzero(track.tick_s == np.round(START_S + time_s))
        figures[name] = figures_at(ascent, plan, track.take(rows)) if len(rows) else {}
    return figures


def count_text(values):
    """Return a count of the known values, `10 of 12`."""
    finite = [value for value in values if np.isfinite(value)]
    return f"{int(sum(finite))} of {len(finite)}" if finite else "-"


def row_of(title, mark, flights):
    """Return the row of flights at a mark."""
    reported = [figures for figures in flights if figures]
    held = sum(figures["nees"] <= chi2.ppf(CONTAINMENT, 6) for figures in reported)
    shares = proportion(held, len(reported)) if reported else (np.nan,) * 3
    keep(f"{title}: {mark}: state held", held / max(len(reported), 1))

    def median(name):
        finite = [row[name] for row in reported if np.isfinite(row[name])]
        return float(np.median(finite)) if finite else np.nan

    return {
        "kind": title,
        "mark": mark,
        "flights": len(flights),
        "tracks": len(reported),
        "held": int(held),
        "held_low95": shares[1],
        "held_high95": shares[2],
        **{name: median(name) for name in SHARES},
        "regions": sum(np.isfinite(row["area_km2"]) for row in reported),
        "inside": count_text([row["inside"] for row in reported]),
        "given": count_text([row["given"] for row in reported]),
        "median_km2": median("area_km2"),
    }


def kind_rows(title, ascents, sensors, seeds):
    """Yield the rows of flights at their marks."""
    start_s = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ascent.csv"
        flights = [
            flown(ascent, path, 100 * seed + number, sensors)
            for number, ascent in enumerate(ascents)
            for seed in range(seeds)
        ]
    cost_s = (time.process_time() - start_s) / max(len(flights), 1)
    keep(f"{title}: processor time a flight, s", cost_s)
    for mark in dict.fromkeys(mark for figures in flights for mark in figures):
        yield row_of(title, mark, [figures[mark] for figures in flights if mark in figures])


def rows_of(options):
    """Yield the rows of all kinds."""
    for name in options.only:
        kind = KINDS[name]
        seeds = range(options.from_seed, options.from_seed + 2 * options.flights, 2)
        ascents = [kind.drawn(np.random.default_rng([kind.stream, seed])) for seed in seeds]
        yield from kind_rows(kind.title, ascents, kind.sensors, options.seeds)
    if options.tables:
        yield from kind_rows("Tables", list(table_ascents(options.tables)), 2, options.seeds)


def page(table, launches=()):
    """Return the page, with the launches among fires if they were run."""
    ends = Table(row for row in table if row["mark"].startswith("20 s after"))

    def final(title, name):
        rows = ends.where(kind=title)
        return rows[-1][name] if rows else float("nan")

    counts = [cell.split(" of ") for cell in table.column("given") if cell != "-"]
    inside, regions = (sum(int(count[side]) for count in counts) for side in (0, 1))
    tracks = sum(table.column("tracks"))
    return PAGE.format(
        orbit=final("To orbit", "orbit"),
        short=final("Short of orbit", "orbit"),
        glide=final("Gliders", "glide"),
        held=100.0 * sum(table.column("held")) / max(tracks, 1),
        inside=f"{inside} of {regions}",
        flights=max(table.column("flights")),
        first=table.facts.get("first_seed", 1000),
        fires=fires_text(table.facts, launches) if launches else "",
    )


def draw(path, table):
    """Draw shares and probabilities of each kind by mark."""
    titles = table.names("kind")
    size = (11.0, 2.2 * len(titles))
    with svg_plot(path, len(titles), 1, figsize=size, squeeze=False, sharey=True) as (_, axes):
        for panel, title in zip(axes.flat, titles, strict=True):
            rows = Table(sorted(table.where(kind=title), key=mark_order))
            places = range(len(rows))
            held = [row["held"] / max(row["tracks"], 1) for row in rows]
            panel.plot(places, held, "ks", markersize=3, label="share of states held")
            for name in ("orbit", "missile", "glide", "down"):
                panel.plot(places, rows.column(name), "o-", markersize=3, label=f"P({name})")
            panel.set_xticks(places, rows.column("mark"), fontsize=6)
            panel.set(title=title, ylim=(-0.03, 1.03))


def main():
    """Measure and write; the hour of fires, `--hour-s` long, is part of a run of all kinds."""
    options = options_of(
        __doc__,
        only=tuple(KINDS),
        flights=6,
        seeds=1,
        from_seed=1000,
        hour_s=1200.0,
        tables=Path,
    )
    facts = {"first_seed": options.from_seed}
    tables = {"open_world": rows_of(options)}
    if options.from_csv:
        tables |= {"open_world_fires": ()} if (options.from_csv / FIRES).exists() else {}
    elif len(options.only) == len(KINDS):
        # Facts are written with the first table: fires are measured before it.
        fires = fire_rows(options.hour_s, options.from_seed, facts)
        tables["open_world_fires"] = list(fires)
    publish(options, page, draw, facts, **tables)


if __name__ == "__main__":
    main()
