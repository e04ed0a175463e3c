"""Are P(missile), P(comes down), P(orbit) and P(burn over) of `imm` right on launches that share no
code with it?

Flights are those of `foreign_flights`, `ascents` and `glide_flights`; kinds and numbers of stages
are as frequent as the tracker assumes (`vehicles.json`), for a probability is right only in a world
with these frequencies. All else of a flight is drawn from other laws than the tracker's. Ten
launches are a scene, degrees apart. Marks are times since the first detection, which the tracker
knows. Probabilities of kinds are those given a launch: there are no other sources.
"""

import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from ascents import DARK_S, drawn_ascent, drawn_return
from calibration_ranks import EDGES, ORBIT, OVER
from foreign_flights import drawn_flight
from glide_flights import drawn_glide
from one_flight import START_S, table_target, write_table
from opir_forecast.vehicles import vehicle_model
from opir_scoring import evidence_of_run, ownership
from opir_scoring.containments import proportion
from pages import GREY, interval_text, markdown_table

import opir_core as opir
from opir_core.interfaces.weighed_tracks import hypothesis_columns

#: Times since the first detection, s.
MARKS_S = (30.0, 90.0, 180.0, 300.0)
#: Launches of a scene.
LAUNCHES = 10
MISSILE = "P(missile)"
DOWN = "P(comes down)"
QUANTITIES = (MISSILE, DOWN, ORBIT, OVER)
#: A bin of stated probabilities with fewer launches is joined with the next.
LEAST_LAUNCHES = 50


TEXT = """**`imm` on foreign launches.** {launches} launches whose flights share no code with the
tracker, of kinds and numbers of stages as frequent as it assumes; P(missile), P(comes down),
P(orbit) and P(burn over), given a launch, at {marks} s after the first detection. Of {bins} bins of
{least} launches or more the mean that is stated lies in the 95 % interval (Wilson) of the share
that is true in {hold}; where 0.95 or more is stated, {sure:.0f} % or more are true. The farthest:

{table}

P(orbit) is too low, and P(comes down) too high, while launchers climb. One reason is the generator:
its launchers lift off with 11.5 to 15 m/s² and its missiles with 14 to 28; the tracker's law of
missiles is wider, 19 % of them begin below 15. On flights of its own prior P(orbit) holds at 90 and 180 s, and at
30 s not ([ranks](simulation_calibration.csv)). Two SBIRS-GEO, `classification:
none`; a launch without a region states no P(comes down). [Data](foreign_calibration.csv)."""


class Flight(NamedTuple):
    """A flight below the meridian 0: rows (n, 8) of its table, last burnout, s after ignition, and
    what is true of it.
    """

    rows: np.ndarray
    burnout_s: float
    is_missile: bool
    falls: bool
    in_orbit: bool


class Event(NamedTuple):
    """What is stated of a launch at a mark, and whether it is true."""

    since_s: float
    quantity: str
    stated: float
    is_true: bool


def turned_to_meridian(rows, longitude_deg, place_deg):
    """Return rows (n, 8) of a flight turned about the Earth's axis from one meridian to another."""
    angle = np.radians(place_deg - longitude_deg)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turned = rows.copy()
    for first in (1, 4):
        turned[:, first : first + 2] = rows[:, first : first + 2] @ turn
    return turned


def drawn_missile(rng):
    """Return a staged gravity turn; half of those with several stages are dark between them."""
    shares = vehicle_model().data["families"]["missile"]["stages"]
    stages = min(1 + int(rng.choice(len(shares), p=shares)), 3)
    flight = drawn_flight(stages, bool(rng.random() < 0.5), rng)
    rows = flight.table[flight.table[:, 0] <= flight.burnout_s + DARK_S]
    longitude_deg = float(np.degrees(flight.boost.launch[1]))
    rows = turned_to_meridian(rows, longitude_deg, 0.0)
    return Flight(rows, flight.burnout_s, is_missile=True, falls=True, in_orbit=False)


def of_ascent(ascent, in_orbit):
    """Return the flight of an ascent, a return or a glide."""
    rows = turned_to_meridian(ascent.rows, ascent.longitude_deg, 0.0)
    return Flight(rows, ascent.burns_s[-1][1], False, not in_orbit, in_orbit)


def drawn_launcher(rng):
    """Return an ascent to orbit, or short of it as often as the tracker assumes failures."""
    fails = bool(rng.random() < vehicle_model().data["failure_probability"])
    share = rng.uniform(0.5, 0.98) if fails else 1.0
    while True:
        ascent = drawn_ascent(rng, share)
        if not fails or ascent.impact:
            return of_ascent(ascent, not fails)


DRAWN = {
    "missile": drawn_missile,
    "orbit": drawn_launcher,
    "glide": lambda rng: of_ascent(drawn_glide(rng), False),
    "none": lambda rng: of_ascent(drawn_return(rng), False),
}


def drawn_flights(count, seed):
    """Return flights of all kinds in random order, as frequent as the tracker assumes."""
    groups = vehicle_model().data["groups"]
    edges = np.rint(count * np.cumsum([groups[name] for name in DRAWN])).astype(int)
    names = np.repeat(list(DRAWN), np.diff(edges, prepend=0))
    rng = np.random.default_rng([seed, 67])
    return [DRAWN[name](rng) for name in rng.permutation(names).tolist()]


def scene_of(targets, seed):
    """Return a scene of launches near the meridian 0; sensors report no types."""
    return opir.scene_from_mapping(
        {
            "scene": "foreign launches",
            "epoch": "2026-04-01T18:00:00Z",
            "duration_s": START_S + MARKS_S[-1] + 10.0,
            "seed": seed,
            "sensors": [
                {"model": "SBIRS-GEO", "id": f"S{slot_deg}", "orbital_slot_deg": slot_deg}
                for slot_deg in (-35, 30)
            ],
            "targets": targets,
            "classification": "none",
            "tracker": "imm",
            "outputs": [],
        }
    )


def events_of(flights, seed):
    """Return the events of flights in one scene."""
    with tempfile.TemporaryDirectory() as folder:
        targets = []
        for number, flight in enumerate(flights):
            path = Path(folder, f"{number}.csv")
            place_deg = 6.0 * (number - 0.5 * (LAUNCHES - 1))
            write_table(path, turned_to_meridian(flight.rows, 0.0, place_deg))
            kind = "SLV" if flight.in_orbit else "ICBM"
            targets.append({**table_target(path, kind), "id": f"T{number}"})
        plan = opir.compile_plan(scene_of(targets, seed))
        run = opir.run_of_plan(plan)
    names = [hypothesis.name for hypothesis in plan.hypotheses]
    evidence = evidence_of_run(run, plan)
    owners = ownership(evidence)
    owner = owners.target[np.searchsorted(owners.track, run.tracks.track)]
    events = list[Event]()
    for number, flight in enumerate(flights):
        seen_s = evidence.time_s[evidence.target == number]
        for since_s in MARKS_S if len(seen_s) else ():
            tick_s = np.round(seen_s.min() + since_s)
            rows = np.flatnonzero((owner == number) & (run.tracks.tick_s == tick_s))
            if len(rows):
                events += events_at(since_s, flight, run.tracks.take(rows[:1]), names)
    return events


def events_at(since_s, flight, track, names):
    """Yield the events of a track's row, as far as the tracker states them; `names` are those of
    its hypotheses.
    """
    launched = float(track.probability_launch[0])
    burning = float(track.probability_burning[0] + np.nan_to_num(track.probability_relights[0]))
    (falls,) = hypothesis_columns(track, names)["probability_comes_down"]
    stated = {
        MISSILE: float(track.probability_missile[0]) / max(launched, 1e-9),
        DOWN: np.nan if falls is None else falls,
        ORBIT: float(track.probability_orbit[0]) / max(launched, 1e-9),
        OVER: 1.0 - burning,
    }
    is_over = float(track.tick_s[0]) - START_S >= flight.burnout_s
    truth = (flight.is_missile, flight.falls, flight.in_orbit, is_over)
    for (quantity, value), is_true in zip(stated.items(), truth, strict=True):
        if np.isfinite(value):
            yield Event(since_s, quantity, float(np.clip(value, 0.0, 1.0)), is_true)


def joined_bins(stated):
    """Return the bins (n,) of probabilities (n,), of neighbours joined until each has enough."""
    number = np.digitize(stated, EDGES[1:-1])
    count = np.bincount(number, minlength=len(EDGES) - 1)
    group = np.zeros(len(count), dtype=int)
    held = last = 0
    for place, size in enumerate(count.tolist()):
        group[place] = last
        held += size
        if held >= LEAST_LAUNCHES and count[place + 1 :].sum() >= LEAST_LAUNCHES:
            held = 0
            last += 1
    return group[number]


def bin_rows(events, count):
    """Yield the bins of events of so many launches, of each quantity at each mark."""
    for quantity in QUANTITIES:
        for since_s in MARKS_S:
            part = [event for event in events if event[:2] == (since_s, quantity)]
            stated = np.array([event.stated for event in part])
            is_true = np.array([event.is_true for event in part], dtype=bool)
            number = joined_bins(stated)
            for group in np.unique(number).tolist():
                rows = number == group
                share, low, high = proportion(int(is_true[rows].sum()), int(rows.sum()))
                yield {
                    "of": count,
                    "quantity": quantity,
                    "since_first_detection_s": since_s,
                    "least": float(stated[rows].min()),
                    "largest": float(stated[rows].max()),
                    "launches": int(rows.sum()),
                    "stated": float(stated[rows].mean()),
                    "right": share,
                    "right_low95": low,
                    "right_high95": high,
                }


def foreign_text(table):
    """Return the paragraph about the bins, with those that are farthest outside their intervals."""
    outside = [
        row for row in table if not row["right_low95"] <= row["stated"] <= row["right_high95"]
    ]
    farthest = sorted(outside, key=lambda row: -abs(row["stated"] - row["right"]))
    cells = [
        (
            f"{row['quantity']} at {row['since_first_detection_s']:g} s",
            row["launches"],
            f"{row['stated']:.2f}",
            interval_text(row, "right", ".2f"),
        )
        for row in farthest[:8]
    ]
    return TEXT.format(
        launches=max(table.column("of")),
        marks=", ".join(f"{mark_s:g}" for mark_s in MARKS_S),
        bins=len(table),
        least=LEAST_LAUNCHES,
        hold=len(table) - len(outside),
        sure=100.0 * min((row["right"] for row in table if row["stated"] >= 0.95), default=np.nan),
        table=markdown_table(("", "launches", "stated", "true [95 %]"), cells),
    )


def draw_foreign(axes, table, quantities):
    """Draw the shares that are true against the means that are stated, with intervals."""
    axes.plot([0.0, 1.0], [0.0, 1.0], color=GREY, linewidth=0.8)
    for quantity in quantities:
        rows = table.where(quantity=quantity)
        right = np.array(rows.column("right"))
        spread = (right - rows.column("right_low95"), rows.column("right_high95") - right)
        axes.errorbar(
            rows.column("stated"), right, np.maximum(spread, 0.0), fmt="o", ms=3, label=quantity
        )
    axes.set(xlabel="probability", ylabel="share that is right", title="imm, foreign launches")


def foreign_rows(count, seed=1):
    """Yield the bins of so many launches before two sensors."""
    flights = drawn_flights(count, seed)
    events = [
        event
        for start in range(0, len(flights), LAUNCHES)
        for event in events_of(flights[start:][:LAUNCHES], 1000 * seed + start)
    ]
    yield from bin_rows(events, count)
