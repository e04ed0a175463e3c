"""What is hot and no missile: fires for an hour, ascents to orbit and short of it, stages that fly
back, gliders.

    python benchmarks/open_world.py [--only ascents] [--flights 6] [--tables FOLDER] [--write
    docs/benchmarks]

Flights are those of `ascents`, `glide_flights` and `foreign_flights` (notional, no code of opir),
with seeds that nothing was built on, or tables of a folder. SBIRS-GEO and the default tracker see
each alone. At marks: is the state in its 95 % ellipsoid, what is the probability of orbit, glide
and missile, does it come down, does the region hold?
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from ascents import DARK_S, Ascent, drawn_ascent, drawn_near_orbit, drawn_return
from figures import keep
from foreign_flights import drawn_flight
from glide_flights import drawn_glide
from open_world_hour import hour
from open_world_page import Row, csv_text, interval, page_text
from opir_scoring.impacts import main_regions, regions_given

import opir_core as opir

EPOCH = "2026-04-01T18:00:00Z"
START_S = 10.0
SLOTS_DEG = (-35.0, 30.0)
#: 95 % of χ² with six degrees of freedom.
WITHIN = 12.592


class Kind(NamedTuple):
    """A kind of flights: its name on the command line and on the page, a flight by seed, and its
    number of sensors.
    """

    key: str
    title: str
    drawn: Callable[[int], Ascent]
    sensors: int = 2


def _staged(stages: int, gap_s: tuple[float, float], stream: int) -> Callable[[int], Ascent]:
    def flight(seed: int) -> Ascent:
        found = drawn_flight(stages, bool(gap_s[1]), np.random.default_rng([stream, seed]), gap_s)
        rows = found.table[found.table[:, 0] <= found.burnout_s + DARK_S]
        return Ascent(rows, found.burns_s, float(np.degrees(found.launch[1])), found.impact[:2])

    return flight


def _rng(stream: int, seed: int) -> np.random.Generator:
    return np.random.default_rng([stream, seed])


KINDS = (
    Kind("ascents", "To orbit", lambda seed: drawn_ascent(_rng(31, seed))),
    Kind("short", "Short of orbit", lambda seed: drawn_ascent(_rng(37, seed), 0.97)),
    Kind("near", "Nearly in orbit", lambda seed: drawn_near_orbit(_rng(43, seed))),
    Kind("returns", "Back to the site", lambda seed: drawn_return(_rng(41, seed))),
    Kind("gliders", "Gliders", lambda seed: drawn_glide(_rng(47, seed))),
    Kind("gaps", "Two stages, 22 to 40 s apart", _staged(2, (22.0, 40.0), 53)),
    Kind("one", "Three stages, one sensor", _staged(3, (0.0, 0.0), 59), 1),
)


class Mark(NamedTuple):
    """What a track said of a flight at a mark; nan where there is no track, no region.

    `inside` and `given` are 1 where the impact lies in the 95 % region of the likeliest condition,
    and of the true one.
    """

    name: str
    nees: float
    burning: float
    orbit: float
    down: float
    missile: float
    glide: float
    inside: float
    given: float
    area_km2: float


class Flown(NamedTuple):
    """Marks of a flight, and of each tick with a region: is the last burn over, is the impact in
    the main region?
    """

    marks: list[Mark]
    is_over: np.ndarray
    inside: np.ndarray


def tables(folder: Path) -> Iterator[tuple[str, Ascent]]:
    """Yield the ascents of a folder's CSV files, by name."""
    for path in sorted(folder.glob("*.csv")):
        rows = np.loadtxt(path, delimiter=",", skiprows=1)
        lit = np.flatnonzero(np.diff(rows[:, 7], prepend=0.0, append=0.0))
        ends = np.append(rows[:, 0], rows[-1, 0])[lit].reshape(-1, 2)
        place = rows[0, 1:4]
        yield (
            path.stem,
            Ascent(
                rows,
                tuple(map(tuple, ends.tolist())),
                float(np.degrees(np.arctan2(place[1], place[0]))),
            ),
        )


def scene_of(ascent: Ascent, path: Path, seed: int, sensors: int) -> opir.Scene:
    """Return the scene of one ascent before its sensors."""
    slots = [
        (ascent.longitude_deg + shift + 540.0) % 360.0 - 180.0 for shift in SLOTS_DEG[:sensors]
    ]
    return opir.scene_from_mapping(
        {
            "scene": "ascent",
            "epoch": EPOCH,
            "duration_s": float(np.ceil(START_S + ascent.rows[-1, 0])),
            "seed": 9000 + seed,
            "sensors": [
                {"model": "SBIRS-GEO", "id": f"S{slot:.2f}", "orbital_slot_deg": slot}
                for slot in slots
            ],
            "targets": [
                {"id": "T", "model": "table", "type": "SLV", "file": str(path), "start_s": START_S}
            ],
            "tracker": "imm",
        }
    )


def flown(ascent: Ascent, path: Path, seed: int, sensors: int) -> Flown:
    """Return what the longest track of an ascent said."""
    run = opir.run_of_plan(opir.compile_plan(scene_of(ascent, path, seed, sensors)))
    number, count = np.unique(run.tracks.track, return_counts=True)
    rows = (
        np.flatnonzero(run.tracks.track == number[np.argmax(count)])
        if len(number)
        else np.empty(0, dtype=int)
    )
    said = {
        float(run.tracks.tick_s[row]): (row, *_inside(ascent, run.tracks, row))
        for row in rows.tolist()
    }
    marks = [
        mark_of(ascent, run, name, said.get(float(np.round(START_S + when_s))))
        for name, when_s in _times(ascent)
    ]
    known = np.array(
        [(when_s, one[1]) for when_s, one in said.items() if np.isfinite(one[1])]
    ).reshape(-1, 2)
    return Flown(marks, known[:, 0] - START_S >= ascent.burns_s[-1][1], known[:, 1])


def _times(ascent: Ascent) -> Iterator[tuple[str, float]]:
    """Yield names and times since ignition of marks."""
    for number, (begin, end) in enumerate(ascent.burns_s, 1):
        yield f"half of burn {number}", 0.5 * (begin + end)
        if number > 1:
            yield f"95 % of burn {number}", begin + 0.95 * (end - begin)
        after = [start - end for start, _ in ascent.burns_s if start > end - 1e-6]
        for late_s in (5.0, 20.0, 40.0):
            if late_s < min(after, default=np.inf):
                yield f"{late_s:g} s after burn {number}", end + late_s


def _inside(ascent: Ascent, tracks: opir.Tracks, row: int) -> tuple[float, float]:
    """Return whether the impact lies in the region of 95 % of a row, and in that given the burn;
    nan without one.
    """
    regions = [region for region in tracks.impact_regions[row] if region.containment == 0.95]
    if ascent.impact is None or not regions:
        return np.nan, np.nan
    is_over = float(tracks.tick_s[row]) - START_S >= ascent.burns_s[-1][1]
    given = regions_given(regions, is_over)
    return (
        float(main_regions(regions)[0].contains(*ascent.impact)),
        float(given[0].contains(*ascent.impact)) if given else np.nan,
    )


def mark_of(
    ascent: Ascent, run: opir.Run, name: str, said: tuple[int, float, float] | None
) -> Mark:
    """Return what a track said in a row, with what `_inside` says of it."""
    if said is None:
        return Mark(name, *[np.nan] * 9)
    row, inside, given = said
    tracks = run.tracks
    error = tracks.state[row] - ascent.state(float(tracks.tick_s[row]) - START_S)
    regions = [region for region in tracks.impact_regions[row] if region.containment == 0.95]
    glides = [one.group == "glide" for one in run.plan.hypotheses]
    return Mark(
        name,
        float(error @ np.linalg.solve(tracks.state_covariance[row], error)),
        float(tracks.probability_burning[row]),
        float(tracks.probability_orbit[row]),
        float(sum(region.probability for region in regions)),
        float(tracks.probability_missile[row]),
        float(tracks.hypothesis_probability[row][glides].sum()),
        inside,
        given,
        regions[0].area_km2 if regions else np.nan,
    )


def rows_of(
    title: str, flights: Sequence[Ascent], sensors: int = 2, seeds: int = 1
) -> tuple[list[Row], str]:
    """Return the rows of flights at their marks, and a sentence on all their ticks with a
    region.
    """
    said = list[Flown]()
    clock = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ascent.csv"
        for place, ascent in enumerate(flights):
            ascent.write(path)
            said += [flown(ascent, path, 100 * seed + place, sensors) for seed in range(seeds)]
    keep(f"{title}: processor time a flight, s", (time.process_time() - clock) / max(len(said), 1))
    rows = []
    marks = [mark for each in said for mark in each.marks]
    for name in dict.fromkeys(mark.name for mark in marks):
        mine = [mark for mark in marks if mark.name == name]
        reported = [mark for mark in mine if np.isfinite(mark.nees)]
        within = sum(mark.nees <= WITHIN for mark in reported)
        shares = [
            float(np.median([getattr(mark, key) for mark in reported])) if reported else np.nan
            for key in SHARES
        ]
        areas = np.array([mark.area_km2 for mark in reported])
        known = areas[np.isfinite(areas)]
        sizes = (float(known.min()), float(np.median(known))) if len(known) else (np.nan, np.nan)
        inside = (_inside_of(reported, "inside"), _inside_of(reported, "given"))
        rows.append(
            Row(title, name, len(mine), len(reported), within, *shares, len(known), *inside, *sizes)
        )
        keep(f"{title}: {name}: state held", within / max(len(reported), 1))
    return rows, ticks_of(title, said)


#: The probabilities of a mark whose medians the page has.
SHARES = ("burning", "orbit", "down", "missile", "glide")


def _inside_of(marks: Sequence[Mark], key: str) -> str:
    known = [getattr(mark, key) for mark in marks if np.isfinite(getattr(mark, key))]
    return f"{int(sum(known))} of {len(known)}" if known else "-"


def ticks_of(title: str, said: Sequence[Flown]) -> str:
    """Return the shares of the ticks with regions of flights that come down, in words, or ""."""
    if not any(len(each.inside) for each in said):
        return ""
    parts = {
        "all": [each.inside for each in said],
        "before the last burnout": [each.inside[~each.is_over] for each in said],
        "after it": [each.inside[each.is_over] for each in said],
    }
    shares = {
        name: np.array([part.mean() for part in each if len(part)]) for name, each in parts.items()
    }
    keep(f"{title}: regions hold", float(shares["all"].mean()))
    return (
        f"{title}:"
        f" {', '.join(f'{name} {interval(each)}' for name, each in shares.items() if len(each))}"
    )


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", choices=(*[kind.key for kind in KINDS], "hour", "tables"))
    parser.add_argument("--flights", type=int, default=6)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--from-seed", type=int, default=1000)
    parser.add_argument("--hour-s", type=float, default=1200.0)
    parser.add_argument("--tables", type=Path)
    parser.add_argument("--write", type=Path, help="folder of the page")
    wanted = parser.parse_args()
    numbers = range(wanted.from_seed, wanted.from_seed + 2 * wanted.flights, 2)
    rows = list[Row]()
    ticks = list[str]()
    hours = list[str]()
    for kind in KINDS:
        if wanted.only in (None, kind.key):
            found = rows_of(
                kind.title, [kind.drawn(seed) for seed in numbers], kind.sensors, wanted.seeds
            )
            rows = rows + found[0]
            ticks = [*ticks, found[1]]
            print(csv_text(found[0]), found[1], sep="\n", flush=True)
    if wanted.tables:
        found = rows_of("Tables", [ascent for _, ascent in tables(wanted.tables)], 2, wanted.seeds)
        print(csv_text(found[0]), found[1], sep="\n", flush=True)
    if wanted.only in (None, "hour"):
        hours = hour(wanted.hour_s, wanted.from_seed)
        print("\n".join(hours))
    if wanted.write:
        (wanted.write / "open_world.md").write_text(
            page_text(rows, ticks, hours, wanted.from_seed), encoding="utf-8"
        )
        (wanted.write / "open_world.csv").write_text(csv_text(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
