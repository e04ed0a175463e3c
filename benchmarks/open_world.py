"""What is hot and no missile: fires for an hour, ascents to orbit and short of it, stages that fly back, gliders.

    python benchmarks/open_world.py [--only ascents] [--flights 12] [--tables FOLDER] [--write docs/benchmarks]

Ascents are those of `ascents` (notional, no code of opir), with seeds that nothing was built on, or tables of a
folder. Two SBIRS-GEO and the default tracker see each alone. At marks: is the state in its 95 % ellipsoid, what is the
probability of orbit and of a missile, how large is the impact region while it burns?
"""

import argparse
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from ascents import Ascent, drawn_ascent, drawn_return
from figures import keep
from opir_scoring import energy_scores

import opir_core as opir

PAGE = """# Is what is hot a missile?

Fires burn for hours, launchers climb to orbit, stages fly back. What does `imm` say of them, with default settings?

A state is held if it lies in its 95 % ellipsoid; *energy* is the mean energy score of position. Probabilities are
medians over the flights at a mark. *Regions* are those of 95 % that a track has; a small one while a target burns on,
or in orbit, would be wrong.
{lines}

Ascents are notional and share no code with opir (`benchmarks/ascents.py`): to orbit, cut off at 97 % of the orbital
speed, and first stages that turn and burn against their motion. Each is a scene of its own before two SBIRS-GEO.
{hour}
By `--write docs/benchmarks`; ascents have seeds from {first}, which nothing was built on.
"""

#: What the page says of the scene of `hour`.
HOUR = """
The scene with fires: 15° by 40° of land with 8 fires and 4 gas flares per million km², glints, noise and four launches,
before SBIRS-GEO, DSP and NEXTGEN-GEO, with `detection: snr` and `classification: spectral`.
"""

EPOCH, START_S = "2026-04-01T18:00:00Z", 10.0
LAUNCHED = 0.5


class Mark(NamedTuple):
    """What a track said of a flight at a mark; nan where there is no track, no region."""

    name: str
    nees: float
    energy_m: float
    burning: float
    missile: float
    orbit: float
    launch: float
    area_km2: float
    samples: float
    likeliest: str


def tables(folder: Path) -> Iterator[tuple[str, Ascent]]:
    """Yield the ascents of a folder's CSV files, by name; those whose name begins with `crs12` fly back."""
    for path in sorted(folder.glob("*.csv")):
        rows = np.loadtxt(path, delimiter=",", skiprows=1)
        lit = np.flatnonzero(np.diff(rows[:, 7], prepend=0.0, append=0.0))
        ends = np.append(rows[:, 0], rows[-1, 0])[lit].reshape(-1, 2)
        place = rows[0, 1:4]
        yield (
            path.stem,
            Ascent(rows, tuple(map(tuple, ends.tolist())), True, float(np.degrees(np.arctan2(place[1], place[0])))),
        )


def scene_of(ascent: Ascent, path: Path, seed: int) -> opir.Scene:
    """Return the scene of one ascent before two sensors."""
    slots = [(ascent.longitude_deg + shift + 540.0) % 360.0 - 180.0 for shift in (-35.0, 30.0)]
    return opir.scene_from_mapping(
        {
            "scene": "ascent",
            "epoch": EPOCH,
            "duration_s": float(np.ceil(START_S + ascent.rows[-1, 0])),
            "seed": 9000 + seed,
            "sensors": [{"model": "SBIRS-GEO", "id": f"S{slot:.2f}", "orbital_slot_deg": slot} for slot in slots],
            "targets": [{"id": "T", "model": "table", "type": "SLV", "file": str(path), "start_s": START_S}],
            "tracker": "imm",
        }
    )


def marks_of(ascent: Ascent, path: Path, seed: int) -> list[Mark]:
    """Return what the track of an ascent said at its marks."""
    run = opir.run_of_plan(opir.compile_plan(scene_of(ascent, path, seed)))
    return [mark_of(ascent, run, name, when_s) for name, when_s in mark_times(ascent.burns_s)]


def mark_times(burns_s: Sequence[tuple[float, float]]) -> Iterator[tuple[str, float]]:
    """Yield names and times since ignition of marks."""
    (begin, end), *later = burns_s
    yield "half of burn 1", 0.5 * (begin + end)
    yield "5 s after burn 1", end + 5.0
    for number, (begin, end) in enumerate(later, 2):
        yield f"half of burn {number}", 0.5 * (begin + end)
        yield f"95 % of burn {number}", begin + 0.95 * (end - begin)
        yield f"8 s after burn {number}", end + 8.0


def mark_of(ascent: Ascent, run: opir.Run, name: str, when_s: float) -> Mark:
    """Return what the longest track said at a time since ignition."""
    tracks, tick_s = run.tracks, float(np.round(START_S + when_s))
    number, count = np.unique(tracks.track, return_counts=True)
    here = np.flatnonzero(tracks.tick_s == tick_s)
    if not len(here):
        return Mark(name, *[np.nan] * 8, "")
    row = here[np.argmax(count[np.searchsorted(number, tracks.track[here])])]
    error = tracks.state[row] - ascent.state(tick_s - START_S)
    nees = float(error @ np.linalg.solve(tracks.state_covariance[row], error))
    wide = [region for region in tracks.impact_regions[row] if region.containment == 0.95]
    names = [hypothesis.name for hypothesis in run.plan.hypotheses]
    shares = tracks.hypothesis_probability[row]
    return Mark(
        name,
        nees,
        float(energy_scores(error[None], tracks.state_covariance[[row]], tracks.state_sigmas[[row]], slice(0, 3))[0]),
        float(tracks.probability_burning[row]),
        float(tracks.probability_missile[row]),
        float(tracks.probability_orbit[row]),
        float(tracks.probability_launch[row]),
        wide[0].area_km2 if wide else np.nan,
        wide[0].effective_samples if wide else np.nan,
        names[int(np.argmax(shares))] if len(shares) else "",
    )


def table_of(title: str, flights: Sequence[tuple[str, Ascent]], seeds: int = 1) -> list[str]:
    """Return the lines of a table of flights at their marks."""
    marks = list[Mark]()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ascent.csv"
        for place, (_, ascent) in enumerate(flights):
            ascent.write(path)
            for seed in range(seeds):
                marks += marks_of(ascent, path, 100 * seed + place)
    lines = [f"\n{title}: {len(flights)} flights, {seeds} seed(s) each\n"]
    lines.append(
        "| mark | tracks | state in 95 % | energy, m | P(burning) | P(orbit) | P(missile) | regions"
        " | least, 10³ km² | < 10⁴ km² |"
    )
    lines.append("|---|---|---|---|---|---|---|---|---|---|")
    for name in dict.fromkeys(mark.name for mark in marks):
        mine = [mark for mark in marks if mark.name == name]
        told = [mark for mark in mine if np.isfinite(mark.nees)]
        held = sum(mark.nees <= 12.592 for mark in told)
        areas = np.array([mark.area_km2 for mark in told])
        known = areas[np.isfinite(areas)]
        energy_m = np.mean([mark.energy_m for mark in told]) if told else np.nan
        burns, orbit, missile = (
            np.median([getattr(mark, key) for mark in told]) if told else np.nan
            for key in ("burning", "orbit", "missile")
        )
        least = f"{1e-3 * known.min():.3g}" if len(known) else "-"
        lines.append(
            f"| {name} | {len(told)} of {len(mine)} | {held} | {energy_m:.0f} | {burns:.2f} | {orbit:.2f}"
            f" | {missile:.2f} | {len(known)} | {least} | {int(np.sum(known < 1e4))} |"
        )
        keep(f"{title}: {name}: state held", held / max(len(told), 1))
    return lines


def hour_scene(duration_s: float, seed: int) -> opir.Scene:
    """Return fires, flares, a glint and false alarms before three constellations, and a few launches."""
    region = {"south_deg": 30, "north_deg": 45, "west_deg": 40, "east_deg": 80}
    rng = np.random.default_rng([17, seed])
    targets = []
    for number, kind in enumerate(("SRBM", "IRBM", "ICBM", "SLV")):
        launch = {"lat_deg": rng.uniform(31, 44), "lon_deg": rng.uniform(42, 78)}
        launch["time_s"] = duration_s * (number + 0.5) / 5.0
        target: dict[str, Any] = {"id": f"T{number}", "type": kind, "launch": launch}
        reach = {"SRBM": 4.0, "IRBM": 25.0, "ICBM": 70.0}.get(kind)
        if reach is None:
            target["azimuth_deg"] = 70.0
        else:
            target["aim"] = {"lat_deg": launch["lat_deg"] - 0.3 * reach, "lon_deg": launch["lon_deg"] + reach}
        targets.append(target)
    return opir.scene_from_mapping(
        {
            "scene": "hour",
            "epoch": "2026-04-01T03:00:00Z",
            "duration_s": duration_s,
            "seed": seed,
            "sensors": [
                {"model": "SBIRS-GEO", "id": "S1", "orbital_slot_deg": 40.0},
                {"model": "DSP", "id": "D1", "orbital_slot_deg": 70.0},
                {"model": "NEXTGEN-GEO", "id": "N1", "orbital_slot_deg": 90.0},
            ],
            "targets": targets,
            "detection": "snr",
            "classification": "spectral",
            "atmosphere": {"model": "lowtran", "climate": "midlat_summer"},
            "background": "earth",
            "tracker": "imm",
            "sources": [
                {"id": "fires", "model": "fires", "field": {"region": region, "per_million_km2": 8}},
                {"id": "flares", "model": "flares", "field": {"region": region, "per_million_km2": 4}},
                {"id": "sea", "model": "glints", "at": [{"lat_deg": 20.0, "lon_deg": 65.0}]},
            ],
        }
    )


def hour(duration_s: float, seed: int) -> list[str]:
    """Return the lines about fires for a time: tracks that claim a launch, and when launches are recognised."""
    plan = opir.compile_plan(hour_scene(duration_s, seed))
    clock, wall = time.process_time(), time.perf_counter()
    seen: dict[int, dict[int, int]] = {}
    above: dict[int, float] = {}
    ever: dict[int, float] = {}
    tracks = set[int]()
    for window in opir.plan_windows(plan):
        for target, track in zip(window.truth.target.tolist(), window.detections.track.tolist(), strict=True):
            if track >= 0:
                counts = seen.setdefault(track, {})
                counts[target] = counts.get(target, 0) + 1
        rows = window.tracks
        tracks |= set(rows.track.tolist())
        for track, when_s, chance in zip(
            rows.track.tolist(), rows.tick_s.tolist(), rows.probability_launch.tolist(), strict=True
        ):
            if chance > LAUNCHED:
                ever[track] = max(ever.get(track, 0.0), chance)
            if chance > 0.95:
                above.setdefault(track, when_s)
    launches = int(np.sum(plan.targets.ignition_s[: len(plan.scene.targets)] >= 0.0))
    of = {track: max(counts, key=lambda target: counts[target]) for track, counts in seen.items()}
    false = [track for track in ever if of.get(track, -1) >= launches or of.get(track, -1) < 0]
    first = {
        plan.targets.ids[target]: min(above[track] for track in above if of.get(track) == target)
        - float(plan.targets.ignition_s[target])
        for target in range(launches)
        if any(of.get(track) == target for track in above)
    }
    cost = time.process_time() - clock
    keep("false launches", len(false))
    return [
        f"\n{duration_s:g} s, seed {seed}: {len(tracks)} tracks of {len(plan.targets.ids)} targets and sources;",
        f"{len(false)} claimed a launch falsely (P > {LAUNCHED});",
        f"P(launch) > 0.95 after {', '.join(f'{name} {value:.1f} s' for name, value in first.items())};",
        f"{cost:.0f} s of processor time, {time.perf_counter() - wall:.0f} s.",
    ]


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("ascents", "short", "returns", "hour", "tables"))
    parser.add_argument("--flights", type=int, default=12)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--from-seed", type=int, default=1000)
    parser.add_argument("--hour-s", type=float, default=3600.0)
    parser.add_argument("--tables", type=Path)
    parser.add_argument("--write", type=Path, help="folder of the page")
    wanted = parser.parse_args()
    numbers = range(wanted.from_seed, wanted.from_seed + wanted.flights)
    lines = list[str]()
    if wanted.only in (None, "ascents"):
        lines += table_of(
            "To orbit", [(str(n), drawn_ascent(np.random.default_rng([31, n]))) for n in numbers], wanted.seeds
        )
    if wanted.only in (None, "short"):
        short = [(str(n), drawn_ascent(np.random.default_rng([37, n]), 0.97)) for n in numbers]
        lines += table_of("Short of orbit", short, wanted.seeds)
    if wanted.only in (None, "returns"):
        lines += table_of("Back to the site", [(str(n), drawn_return(np.random.default_rng([41, n]))) for n in numbers])
    if wanted.tables:
        lines += table_of("Tables", list(tables(wanted.tables)), wanted.seeds)
    if wanted.only in (None, "hour"):
        lines += hour(wanted.hour_s, wanted.from_seed)
    print("\n".join(lines))
    if wanted.write:
        hour_text = HOUR if wanted.only in (None, "hour") else ""
        page = PAGE.format(lines="\n".join(lines), hour=hour_text, first=wanted.from_seed)
        (wanted.write / "open_world.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
