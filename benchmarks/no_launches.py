"""What moves or flashes and is no launch: how often does the default tracker take it for one? And is
a launch from the air recognised?

Each kind of source is a scene of its own, of random places, before two SBIRS-GEO. A track is false
if P(launch) passes 0.5 at any tick.
"""

import os
import time
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from opir_scoring.containments import proportion
from pages import markdown_table, options_of, publish, shown, svg_plot

import opir_core as opir

PAGE = """# Is what moves or flashes taken for a launch?

{tracks} tracks of aircraft, lightning, re-entries, meteors and fires: {false} pass P(launch) 0.5 at
some tick, {last} do at their last. Of {launches} launches from the air {found} pass P(launch) 0.95
within 15 s of ignition, {expected} where the tracker expects every second launch from there.

{table}

![Share of tracks that pass P(launch) 0.5, by kind](no_launches.svg)

Two SBIRS-GEO, `imm` every second, tropical air, the Earth as background, `detection: snr`, seed
{seed}. Each kind is a scene of {number} sources at random places in 40° by 40° (storms: {number}
with 30 flashes a minute); what they are is on [sources that move](../explanation/moving-sources.md).
*Sources* have a detection; *false* are tracks with P(launch) > 0.5 at any tick, with the 95 %
interval of their share (Wilson); *longest* is for how many ticks one stays there; *last* counts
those above it at their last tick. Fires and tailpipes near the ground are too dim in tropical air.
Of launches from the air the last column says how many pass P(launch) 0.95 within 15 s of ignition,
and the median time.
"""
HEAD = ("kind", "sources", "tracks", "false", "longest, s", "last", "found in 15 s; median, s")
REGION = {"south_deg": -20.0, "north_deg": 20.0, "west_deg": 25.0, "east_deg": 65.0}
#: A track claims a launch above this, and has recognised one above that.
LAUNCHED = 0.5
KNOWN = 0.95
FOUND_S = 15.0
#: When launches from the air ignite, s.
IGNITION_S = 5.0


class Kind(NamedTuple):
    """Sources of one kind: title, block of the scene, the scene's length, s, and the tracker's prior
    share of launches from the air.
    """

    title: str
    block: dict[str, Any]
    duration_s: float = 70.0
    air_share: float | None = None


def jet(*legs, **settings):
    """Return a block of aircraft."""
    return {"model": "aircraft", "legs": list(legs), **settings}


BURNING = {"for_s": 100.0, "afterburner": True}
CLIMB = {**BURNING, "climb_m_s": 100.0}
RUN = {"for_s": 15.0, "acceleration_m_s2": 5.0, "afterburner": True}
KINDS = {
    "climb": Kind("jet, climbs on afterburner", jet(CLIMB, speed_m_s=250.0, height_m=2000.0)),
    "take-off": Kind(
        "jet, takes off on afterburner", jet(RUN, CLIMB, speed_m_s=20.0, height_m=0.0)
    ),
    "level": Kind("jet, level on afterburner", jet(BURNING)),
    "turn": Kind("jet, turns on afterburner", jet({**BURNING, "bank_deg": 60.0}, speed_m_s=220.0)),
    "dash": Kind("jet, speeds up on afterburner", jet({**RUN, "for_s": 40.0}, BURNING)),
    "low": Kind("cruise missile, 30 m high (tailpipe of 2 m²)", jet(height_m=30.0, area_m2=2.0)),
    "storms": Kind("lightning", {"model": "storms", "flashes_per_minute": 30.0}),
    "reentries": Kind("re-entry", {"model": "reentries", "height_m": 85e3}),
    "grazers": Kind("earth grazer", {"model": "grazers", "shining_s": 60.0}),
    "bolides": Kind("bolide", {"model": "bolides"}),
    "fronts": Kind("fire front", {"model": "fire_fronts"}),
    "fires": Kind("fire, at sea level", {"model": "fires"}),
    "highland": Kind("fire, 3 km high", {"model": "fires", "height_m": 3000.0}),
    "summit": Kind("fire, 6 km high", {"model": "fires", "height_m": 6000.0}),
    "air": Kind("launch from the air", {}, 45.0),
    "expected": Kind("launch from the air, `air_share: 0.5`", {}, 45.0, 0.5),
}


def places(number, rng):
    """Return random places and times in the region."""
    latitudes = rng.uniform(REGION["south_deg"], REGION["north_deg"], number)
    longitudes = rng.uniform(REGION["west_deg"], REGION["east_deg"], number)
    return [
        {"lat_deg": float(latitude), "lon_deg": float(longitude)}
        for latitude, longitude in zip(latitudes, longitudes, strict=True)
    ]


def air_launches(number, rng):
    """Return targets that are launched from the air."""
    return [
        {
            "id": f"A{row}",
            "model": "air-launch",
            "type": ("SRBM", "MRBM")[row % 2],
            "heading_deg": float(rng.uniform(0.0, 360.0)),
            "speed_m_s": float(rng.uniform(200.0, 270.0)),
            "climb_deg": float(rng.uniform(30.0, 65.0)),
            "pull_m_s2": float(rng.uniform(15.0, 40.0)),
            "launch": {
                **place,
                "height_m": float(rng.uniform(9e3, 13e3)),
                "time_s": IGNITION_S,
            },
        }
        for row, place in enumerate(places(number, rng))
    ]


def scene_of(kind, name, number, seed):
    """Return the scene of a kind."""
    # Both rows of launches from the air are the same flights.
    number_of_kind = list(KINDS).index("air" if name == "expected" else name)
    rng = np.random.default_rng([61, seed, number_of_kind])
    prior = {} if kind.air_share is None else {"hypotheses": {"air_share": kind.air_share}}
    brief = name in ("bolides", "reentries")
    starts = rng.uniform(0.0, 0.7 * kind.duration_s, number) if brief else [None] * number
    spots = [
        place if start is None else {**place, "start_s": float(start)}
        for place, start in zip(places(number, rng), starts, strict=True)
    ]
    blocks = [{"id": name, **kind.block, "at": spots}] if kind.block else []
    return opir.scene_from_mapping(
        {
            "scene": f"no-launch-{name}",
            "epoch": "2026-04-01T20:00:00Z",
            "duration_s": kind.duration_s,
            "seed": seed,
            "sensors": [
                {"model": "SBIRS-GEO", "id": f"S{slot:g}", "orbital_slot_deg": slot}
                for slot in (10.0, 80.0)
            ],
            "targets": [] if blocks else air_launches(number, rng),
            "sources": blocks,
            "detection": "snr",
            "atmosphere": {"model": "lowtran", "climate": "tropical"},
            "background": "earth",
            "tracker": {"model": "imm", "cadence_s": 1.0, **prior},
        }
    )


def rows_of(options):
    """Yield a row a kind."""
    for name in options.only:
        kind = KINDS[name]
        began_s = time.process_time()
        run = opir.simulate(scene_of(kind, name, options.number, options.seed))
        yield {**row_of(kind, run), "processor_s": time.process_time() - began_s}


def claims_of(tracks):
    """Return P(launch) at the ticks of each track."""
    numbers = np.unique(tracks.track)
    return [tracks.probability_launch[tracks.track == number] for number in numbers]


def row_of(kind, run):
    """Return the figures of a run."""
    claims = claims_of(run.tracks)
    above = [np.count_nonzero(claim > LAUNCHED) for claim in claims]
    false = sum(count > 0 for count in above)
    _, low, high = proportion(false, max(len(claims), 1))
    row = {
        "kind": kind.title,
        "sources": len(np.unique(run.truth.target[run.truth.target >= 0])),
        "tracks": len(claims),
        "false": false,
        "false_low95": low,
        "false_high95": high,
        "longest_s": max(above, default=0),
        "last": sum(claim[-1] > LAUNCHED for claim in claims),
        "found": "",
        "found_s": "",
    }
    if kind.block:
        return row
    times = first_known_s(run)
    none = dict.fromkeys(("false", "false_low95", "false_high95", "longest_s", "last"), "")
    found = int(np.count_nonzero(times <= FOUND_S))
    return {**row, **none, "found": f"{found} of {len(times)}", "found_s": float(np.median(times))}


def first_known_s(run):
    """Return when launches (n,) are first recognised, s since ignition; inf for never."""
    times_s = np.full(len(run.plan.scene.targets), np.inf)
    tracks = run.tracks
    known = np.flatnonzero(tracks.probability_launch > KNOWN)
    owners = dict(zip(run.detections.track.tolist(), run.truth.target.tolist(), strict=True))
    for row in known.tolist():
        target = owners.get(int(tracks.track[row]), -1)
        if target >= 0:
            since_s = float(tracks.tick_s[row]) - IGNITION_S
            times_s[target] = min(times_s[target], since_s)
    return times_s


def page(table):
    """Return the page."""
    sources = [row for row in table if row["false"] != ""]
    found = [row["found"].split(" of ") for row in table if row["found"] != ""]

    def false_text(row):
        low, high = (100.0 * row[f"false_{side}95"] for side in ("low", "high"))
        return f"{row['false']} [{low:.0f}–{high:.0f} %]"

    cells = [
        (
            row["kind"],
            row["sources"],
            row["tracks"],
            "–" if row["false"] == "" or not row["tracks"] else false_text(row),
            shown(row["longest_s"], "g"),
            shown(row["last"], "g"),
            f"{row['found']}; {row['found_s']:.0f}" if row["found"] else "–",
        )
        for row in table
    ]
    return PAGE.format(
        table=markdown_table(HEAD, cells),
        tracks=sum(row["tracks"] for row in sources),
        false=sum(row["false"] for row in sources),
        last=sum(row["last"] for row in sources),
        found=found[0][0] if found else "–",
        launches=found[0][1] if found else "–",
        expected=found[-1][0] if found else "–",
        **{name: table.facts[name] for name in ("seed", "number")},
    )


def draw(path, table):
    """Draw the share of false tracks of each kind."""
    rows = [row for row in table if row["false"] != "" and row["tracks"]][::-1]
    shares = np.array([row["false"] / row["tracks"] for row in rows])
    lows = np.array([row["false_low95"] for row in rows])
    highs = np.array([row["false_high95"] for row in rows])
    with svg_plot(path, figsize=(7.0, 0.35 * len(rows) + 1.0)) as (_, axes):
        spread = np.maximum([shares - lows, highs - shares], 0.0)
        axes.errorbar(shares, range(len(rows)), xerr=spread, fmt="o", capsize=3)
        axes.set_yticks(range(len(rows)), [row["kind"] for row in rows])
        axes.set(xlabel="share of tracks with P(launch) > 0.5 at a tick", xlim=(-0.02, 1.02))


def main():
    """Measure and write."""
    options = options_of(__doc__, only=tuple(KINDS), number=20, seed=2000)
    facts = {"seed": options.seed, "number": options.number}
    publish(options, page, draw, facts, no_launches=rows_of(options))


if __name__ == "__main__":
    main()
