"""Do the regions of `imm` hold what they say, on flights that share no code with it?

Staged gravity turns of `foreign_flights` (SciPy) and class profiles of the target model
`ballistic`, drawn with seeds that nothing was built on, each in a scene of its own: one or two
SBIRS-GEO, default settings. At 25, 50, 75 and 95 % of the time from ignition to the last burnout,
and 5 and 20 s after it: is the state in its 95 % ellipsoid, the impact in its 50 and 95 % regions,
and how large are these? What are the energy scores of state and impact, and the log score of
"missile"? Errors over the bound of an estimator that knows the law of flights are those of
`tracking_set`.
"""

import os
import tempfile
from collections.abc import Callable, Mapping
from operator import itemgetter
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from foreign_flights import AXIS, distance_m, drawn_flight
from one_flight import (
    START_S,
    flight_scene,
    impact_containment,
    longest_track,
    table_target,
    write_table,
)
from opir_scoring import energy_scores, log_scores, main_regions, region_energy_m
from opir_scoring.containments import containment, nees, proportion
from opir_scoring.evidence import true_states_ecef
from pages import GREY, interval_text, markdown_table, options_of, publish, svg_plot

import opir_core as opir
from opir_core.flight import propagate_kepler
from opir_core.geometry import eci_to_ecef

MARKS = ("25 %", "50 %", "75 %", "95 %", "+5 s", "+20 s")
AFTER_S = 30.0
#: Figures of a mark whose means are columns of the data.
MEANS = (
    *("in_95_if_burn_known", "position_energy_m", "velocity_energy_m_s", "impact_energy_m"),
    *("missile_log_score", "effective_samples"),
)

PAGE = """# Are the regions of imm true?

Does a track's 95 % region hold the impact, on flights that share nothing with the tracker? From a
quarter of the burn on it holds {pooled:.0f} % of the impacts over all marks and lines of flights,
dark gaps between stages among them; by mark and line {least:.0f} to {most:.0f} % of {flights}
flights.

![Share of impacts in the 50 % and 95 % regions, and median area, by time](tracker_honesty.svg)

{table}

State in its 95 % ellipsoid and impact in the 95 % region: the least share of the marks, with its
95 % interval (Wilson); in the 50 % region the mean. Velocity: RMSE at 95 % of the burn. How close
errors come to the bound of an estimator that knows the law of flights: [tracking
set](tracking_set.md). All figures with their 95 % intervals:
[tracker_honesty.csv](tracker_honesty.csv).

Flights are gravity turns of one to three stages, integrated by SciPy, and class profiles of
`ballistic`, over 150 to 12 000 km. The tracker's prior (`vehicles.json`) knows neither. Each is a
scene of its own, seen by two SBIRS-GEO, or one; default settings. Marks are 25, 50, 75 and 95 % of
the time from ignition to the last burnout, and 5 and 20 s after it. The tracker does not know how
much of a burn is over, so its 50 % region cannot hold half of the impacts at each mark; over all
marks together it holds {half:.0f} %.

By `--flights {flights} --write docs/benchmarks`.
"""
#: The lines in the table of the page; the CSV file has all.
SHOWN = (
    "1 stage",
    "3 stages with gaps",
    "class profiles",
    "2 stages with gaps: one sensor",
    "2 stages: biases of 3σ",
    "2 stages with gaps: Stone Soup EKF",
)
HEAD = (
    *("flights", "state in 95 %", "impact in 95 %", "in 50 %", "velocity, m/s"),
    "95 % area, half and +20 s, 10³ km²",
)


class Line(NamedTuple):
    """A line of the page: name, stages (0: class profiles), dark gaps, sensors, and settings of
    these.
    """

    name: str
    stages: int
    gaps: bool = False
    sensors: int = 2
    settings: Mapping[str, Any] = MappingProxyType({})


LOW_P_D = {"detection_probability": dict.fromkeys(("ICBM", "IRBM", "SRBM"), 0.1)}
#: Stone Soup's filter with the same forecaster.
STONE_SOUP = {"model": "stonesoup", "silence_s": 400.0}
LINES = (
    Line("1 stage", 1),
    Line("2 stages", 2),
    Line("2 stages with gaps", 2, True),
    Line("3 stages with gaps", 3, True),
    Line("class profiles", 0),
    Line("1 stage: one sensor", 1, sensors=1),
    Line("2 stages with gaps: one sensor", 2, True, sensors=1),
    Line("2 stages: P_d 0.1", 2, settings=LOW_P_D),
    Line("2 stages: biases of 3σ", 2, settings={"line_of_sight_bias_sigma_urad": 60.0}),
    Line("2 stages with gaps: Stone Soup EKF", 2, True, settings={"tracker": STONE_SOUP}),
)


class Flight(NamedTuple):
    """A target, its burnout in the scene, s, states (6,) at times, impact, rad, and longitude of
    the launch.
    """

    target: dict[str, Any]
    burnout_s: float
    state: Callable[[float], np.ndarray]
    impact: tuple[float, float]
    longitude_deg: float


def foreign_flight(line, seed, folder):
    """Return a flight of `foreign_flights`, its table written to a folder."""
    rng = np.random.default_rng([7, line.stages, line.gaps, seed])
    flight = drawn_flight(line.stages, line.gaps, rng)
    path = folder / "flight.csv"
    write_table(path, flight.table[flight.table[:, 0] <= flight.burnout_s])
    kind = "SRBM" if flight.range_km < 1000.0 else "IRBM" if flight.range_km < 5500.0 else "ICBM"
    longitude_deg = float(np.degrees(flight.boost.launch[1]))
    return Flight(
        table_target(path, kind),
        START_S + flight.burnout_s,
        lambda time_s: flight.state(time_s - START_S),
        flight.impact[:2],
        longitude_deg,
    )


def class_profile(seed):
    """Return a flight of the target model `ballistic`, of each class in turn."""
    rng = np.random.default_rng([7, 0, seed])
    kind, reach = (("SRBM", (2.0, 8.0)), ("IRBM", (12.0, 40.0)), ("ICBM", (55.0, 90.0)))[seed % 3]
    latitude = np.arcsin(rng.uniform(-0.7, 0.7))
    longitude_deg = float(rng.uniform(-180.0, 180.0))
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    angle = np.radians(rng.uniform(*reach))
    level = np.sin(angle) * np.cos(latitude)
    sine = np.sin(latitude) * np.cos(angle) + level * np.cos(azimuth)
    east = np.arctan2(np.sin(azimuth) * level, np.cos(angle) - np.sin(latitude) * sine)
    aim = {
        "lat_deg": float(np.degrees(np.arcsin(sine))),
        "lon_deg": float(longitude_deg + np.degrees(east) + 540.0) % 360.0 - 180.0,
    }
    launch = {
        "lat_deg": float(np.degrees(latitude)),
        "lon_deg": longitude_deg,
        "time_s": START_S,
    }
    target = {"id": "T", "model": "ballistic", "type": kind, "launch": launch, "aim": aim}
    plan = opir.compile_plan(flight_scene(target, longitude_deg, 300.0, 1, tracker="none"))
    (truth,) = plan.targets.truth()
    impact = np.radians([truth["impact"]["lat_deg"], truth["impact"]["lon_deg"]]).tolist()
    end_s = float(plan.targets.end_s[0])
    return Flight(
        target, end_s, lambda time_s: state_of(plan, time_s), tuple(impact), longitude_deg
    )


def state_of(plan, time_s):
    """Return the ECEF state (6,) of a plan's only target: after burnout in two-body motion."""
    burnout_s = float(plan.targets.end_s[0]) - 1e-3
    target = np.zeros(1, dtype=np.int32)
    state = true_states_ecef(plan, target, np.array([min(time_s, burnout_s)]))
    since_s = np.array([time_s - burnout_s])
    if since_s[0] <= 0.0:
        return state[0]
    place = state[:, :3]
    place, velocity = propagate_kepler(place, state[:, 3:] + np.cross(AXIS, place), since_s)
    place = eci_to_ecef(place, since_s)
    velocity = eci_to_ecef(velocity, since_s) - np.cross(AXIS, place)
    return np.concatenate([place[0], velocity[0]])


def scene_of(line, flight, seed, duration_s):
    """Return the scene of a flight."""
    return flight_scene(
        flight.target,
        flight.longitude_deg,
        duration_s,
        5000 + seed,
        line.sensors,
        **line.settings,
    )


def figures_of(line, seed, folder):
    """Return the figures of a flight's track at the marks, empty ones without a track."""
    flight = foreign_flight(line, seed, folder) if line.stages else class_profile(seed)
    scene = scene_of(line, flight, seed, flight.burnout_s + AFTER_S)
    track = longest_track(opir.run_of_plan(opir.compile_plan(scene)).tracks)
    burn_s = flight.burnout_s - START_S
    times_s = [START_S + share * burn_s for share in (0.25, 0.5, 0.75, 0.95)]
    times_s += [flight.burnout_s + 5.0, flight.burnout_s + 20.0]
    rows = [np.flatnonzero(track.tick_s == np.round(time_s)) for time_s in times_s]
    return [figures_at(flight, track.take(row)) if len(row) else {} for row in rows]


def figures_at(flight, track):
    """Return the figures of a track's row."""
    time_s = float(track.tick_s[0])
    error = track.state - flight.state(time_s)
    regions = track.impact_regions[0]
    _, inputs = impact_containment(track, 0, flight.impact, time_s >= flight.burnout_s)
    stated = track.probability_missile[:, None]
    figures = {
        "nees": float(nees(error, track.state_covariance)[0]),
        "velocity_m_s": float(np.linalg.norm(error[0, 3:])),
        "impact_m": distance_m(tuple(track.impact[0, :2].tolist()), flight.impact),
        "in_95_if_burn_known": inputs,
        "missile_log_score": float(log_scores(stated, np.zeros(1, dtype=np.int64))[0]),
    }
    for name, part in (("position_energy_m", slice(0, 3)), ("velocity_energy_m_s", slice(3, 6))):
        scores = energy_scores(error, track.state_covariance, track.state_sigmas, part)
        figures[name] = float(scores[0])
    if regions:
        figures["impact_energy_m"] = region_energy_m(regions, np.array(flight.impact))
        figures["effective_samples"] = min(region.effective_samples for region in regions)
        for region in main_regions(regions):
            percent = f"{100 * region.containment:.0f}"
            figures[f"in_{percent}"] = float(region.contains(*flight.impact))
            figures[f"area_{percent}"] = region.area_km2
    return figures


def column(figures, name):
    """Return the known values of a figure."""
    values = np.array([row.get(name, np.nan) for row in figures])
    return values[np.isfinite(values)]


def row_of(line, mark, flights):
    """Return the row of a line at a mark."""
    inside = column(flights, "in_95")
    row = {
        "flights": line.name,
        "mark": mark,
        "flown": len(flights),
        "tracked": len(column(flights, "nees")),
    }
    for name, shares in (
        ("state_95_percent", containment(column(flights, "nees"), 6, 0.95)),
        ("impact_50_percent", proportion(column(flights, "in_50").sum(), len(inside))),
        ("impact_95_percent", proportion(inside.sum(), len(inside))),
    ):
        names = (name, f"{name}_low95", f"{name}_high95")
        row |= {key: 100.0 * value for key, value in zip(names, shares, strict=True)}
    row["velocity_rmse_m_s"] = float(np.sqrt(np.mean(column(flights, "velocity_m_s") ** 2)))
    row["area_50_km2"] = float(np.median(column(flights, "area_50")))
    row["area_95_km2"] = float(np.median(column(flights, "area_95")))
    row["impact_error_median_km"] = float(np.median(column(flights, "impact_m")) / 1e3)
    return row | {name: float(np.mean(column(flights, name))) for name in MEANS}


def rows_of(flights, names):
    """Yield the rows of all lines and marks."""
    with tempfile.TemporaryDirectory() as folder:
        for line in LINES:
            if line.name in names:
                figures = [figures_of(line, seed, Path(folder)) for seed in range(flights)]
                for mark, column_ in zip(MARKS, zip(*figures, strict=True), strict=True):
                    yield row_of(line, mark, column_)


def page(table):
    """Return the page."""
    lines = []
    for name in table.names("flights"):
        rows = table.where(flights=name)
        least = [
            interval_text(min(rows, key=itemgetter(share)), share, ".0f", " %")
            for share in ("state_95_percent", "impact_95_percent")
        ]
        half = np.mean(rows.column("impact_50_percent"))
        areas = [1e-3 * rows.row(mark=mark)["area_95_km2"] for mark in ("50 %", "+20 s")]
        velocity = rows.row(mark="95 %")["velocity_rmse_m_s"]
        cells = (f"{half:.0f} %", f"{velocity:.0f}", f"{areas[0]:.0f}, {areas[1]:.0f}")
        if name in SHOWN:
            lines.append((name, *least, *cells))
    inside = table.column("impact_95_percent")
    return PAGE.format(
        pooled=np.mean(inside),
        least=min(inside),
        most=max(inside),
        flights=table[0]["flown"],
        table=markdown_table(HEAD, lines),
        half=np.mean(table.column("impact_50_percent")),
    )


def draw(path, table):
    """Draw shares and areas by mark."""
    with svg_plot(path, 1, 2, figsize=(10.0, 4.4)) as (_, (left, right)):
        for number, name in enumerate(table.names("flights")):
            rows = table.where(flights=name)
            places = np.arange(len(rows))
            style = {"color": f"C{number}", "markersize": 3.5, "linewidth": 0.8}
            shifted = places + 0.06 * (number - 4)
            share, low, high = (
                np.array(rows.column(f"impact_95_percent{end}"))
                for end in ("", "_low95", "_high95")
            )
            left.errorbar(shifted, share, (share - low, high - share), fmt="o", label=name, **style)
            left.plot(shifted, rows.column("impact_50_percent"), "x", **style)
            right.semilogy(places, rows.column("area_95_km2"), "o-", **style)
        for level in (50.0, 95.0):
            left.axhline(level, color=GREY, linewidth=0.8, linestyle="--")
        left.set(ylabel="impacts in the 95 % (o) and 50 % (x) regions, %", ylim=(0.0, 102.0))
        right.set(ylabel="median area of the 95 % region, km²")
        for axes in (left, right):
            axes.set_xticks(range(len(MARKS)), MARKS)
            axes.set_xlabel("share of the burn, and time after it")


def main():
    """Measure and write."""
    options = options_of(__doc__, flights=12, only=tuple(line.name for line in LINES))
    publish(options, page, draw, tracker_honesty=rows_of(options.flights, options.only))


if __name__ == "__main__":
    main()
