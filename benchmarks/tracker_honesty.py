"""Do the regions of `imm` hold what they say, on flights that share no code with it?

    python benchmarks/tracker_honesty.py [--flights 200] [--only "2 stages"] [--write docs/benchmarks]

Staged gravity turns of `foreign_flights` (SciPy) and class profiles of the target model `ballistic`, drawn with seeds
that nothing was built on, each in a scene of its own: one or two SBIRS-GEO, default settings. At 25, 50, 75 and 95 % of
the time from ignition to the last burnout, and 5 and 20 s after it: is the state in its 95 % ellipsoid, the impact in
its 50 and 95 % regions, and how large are these?
"""

import argparse
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from foreign_flights import drawn_flight

import opir_core as opir
from opir_core.flight import propagate_kepler
from opir_core.scoring.consistency import containment, proportion
from opir_core.scoring.evidence import true_states

MARKS = ("25 %", "50 %", "75 %", "95 %", "+5 s", "+20 s")
START_S, AFTER_S = 10.0, 30.0
SPIN = np.array([0.0, 0.0, 7.292115e-5])


class Line(NamedTuple):
    """A line of the page: name, stages (0: class profiles), dark gaps, sensors, P_d and bias of the sensors."""

    name: str
    stages: int
    gaps: bool = False
    sensors: int = 2
    detection_probability: float | None = None
    bias_urad: float = 0.0


LINES = (
    Line("1 stage", 1),
    Line("2 stages", 2),
    Line("2 stages with gaps", 2, True),
    Line("3 stages with gaps", 3, True),
    Line("class profiles", 0),
    Line("1 stage: one sensor", 1, sensors=1),
    Line("2 stages with gaps: one sensor", 2, True, sensors=1),
    Line("2 stages: P_d 0.1", 2, detection_probability=0.1),
    Line("2 stages: biases of 3σ", 2, bias_urad=60.0),
)


class Flight(NamedTuple):
    """A target of the scene, its burnout since the scene's start, states at times (or None), impact and launch."""

    target: dict[str, Any]
    burnout_s: float
    state: Any
    impact: tuple[float, float] | None
    longitude_deg: float


class Row(NamedTuple):
    """What a track said at a mark: normalised errors, errors, and regions."""

    mark: int
    nees: float
    position_m: float
    velocity_m_s: float
    in_50: float
    in_95: float
    area_50_km2: float
    area_95_km2: float


def foreign(line: Line, seed: int, folder: Path) -> Flight:
    """Return a flight of `foreign_flights`, its table written to a folder."""
    flight = drawn_flight(line.stages, line.gaps, np.random.default_rng([7, line.stages, line.gaps, seed]))
    path = folder / "flight.csv"
    flight.write(path)
    kind = "SRBM" if flight.range_km < 1000.0 else "IRBM" if flight.range_km < 5500.0 else "ICBM"
    target = {"id": "T", "model": "table", "type": kind, "file": str(path), "start_s": START_S}
    longitude = float(np.degrees(flight.launch[1]))
    return Flight(target, START_S + flight.burnout_s, lambda s: flight.state(s - START_S), flight.impact[:2], longitude)


def class_profile(seed: int) -> Flight:
    """Return a flight of the target model `ballistic`, of each class in turn."""
    rng = np.random.default_rng([7, 0, seed])
    kind, reach = (("SRBM", (2.0, 8.0)), ("IRBM", (12.0, 40.0)), ("ICBM", (55.0, 90.0)))[seed % 3]
    latitude, longitude = np.degrees(np.arcsin(rng.uniform(-0.7, 0.7))), rng.uniform(-180.0, 180.0)
    azimuth, far = rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(*reach))
    place = np.radians(latitude)
    sine = np.sin(place) * np.cos(far) + np.cos(place) * np.sin(far) * np.cos(azimuth)
    east = np.arctan2(np.sin(azimuth) * np.sin(far) * np.cos(place), np.cos(far) - np.sin(place) * sine)
    aim = {
        "lat_deg": float(np.degrees(np.arcsin(sine))),
        "lon_deg": float(longitude + np.degrees(east) + 540.0) % 360.0 - 180.0,
    }
    launch = {"lat_deg": float(latitude), "lon_deg": float(longitude), "time_s": START_S}
    target = {"id": "T", "model": "ballistic", "type": kind, "launch": launch, "aim": aim}
    return Flight(target, np.nan, None, None, float(longitude))


def scene_of(line: Line, flight: Flight, seed: int, duration_s: float) -> opir.Scene:
    """Return the scene of a flight."""
    slots = [(flight.longitude_deg + shift + 540.0) % 360.0 - 180.0 for shift in (-35.0, 30.0)][: line.sensors]
    sensor: dict[str, Any] = {"model": "SBIRS-GEO", "line_of_sight_bias_sigma_urad": line.bias_urad}
    if line.detection_probability is not None:
        sensor["detection_probability"] = dict.fromkeys(("ICBM", "IRBM", "SRBM"), line.detection_probability)
    return opir.scene_from_mapping(
        {
            "scene": "honesty",
            "epoch": "2026-04-01T18:00:00Z",
            "duration_s": duration_s,
            "seed": 5000 + seed,
            "sensors": [{**sensor, "id": f"S{slot:.2f}", "orbital_slot_deg": slot} for slot in slots],
            "targets": [flight.target],
            "tracker": "imm",
        }
    )


def rows_of(line: Line, seed: int, folder: Path) -> Iterator[Row]:
    """Yield what the track of a flight said at the marks."""
    flight = foreign(line, seed, folder) if line.stages else class_profile(seed)
    plan = opir.compile_plan(scene_of(line, flight, seed, 300.0))
    if not line.stages:
        flight = _known(flight, plan)
    plan = opir.compile_plan(scene_of(line, flight, seed, float(np.ceil(flight.burnout_s + AFTER_S))))
    tracks = opir.run_of_plan(plan).tracks
    number, count = np.unique(tracks.track, return_counts=True)
    burn = flight.burnout_s - START_S
    ends = [START_S + share * burn for share in (0.25, 0.5, 0.75, 0.95)] + [flight.burnout_s + s for s in (5.0, 20.0)]
    for mark, when in enumerate(ends):
        here = np.flatnonzero(tracks.tick_s == np.round(when))
        if len(here):
            # The oldest track: false ones are short.
            row = here[np.argmax(count[np.searchsorted(number, tracks.track[here])])]
            yield _row(mark, flight, tracks, int(row))
        else:
            yield Row(mark, *[np.nan] * 7)


def _known(flight: Flight, plan: opir.Plan) -> Flight:
    """Return a class profile's flight with its truth: in free flight two-body motion, the scene's force."""
    truth = plan.targets.truth()[0]
    end_s = float(plan.targets.end_s[0])
    zero = np.zeros(1, dtype=np.int32)

    def state(time_s: float) -> np.ndarray:
        found = true_states(plan, zero, np.array([min(time_s, end_s - 1e-3)]))[0]
        if time_s < end_s - 1e-3:
            return np.asarray(found)
        since = time_s - end_s + 1e-3
        place, velocity = propagate_kepler(found[:3], found[3:] + np.cross(SPIN, found[:3]), since)
        angle = SPIN[2] * since
        turn = np.array([[np.cos(angle), np.sin(angle), 0.0], [-np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
        return np.concatenate([turn @ place, turn @ velocity - np.cross(SPIN, turn @ place)])

    impact = np.radians([truth["impact"]["lat_deg"], truth["impact"]["lon_deg"]])
    return flight._replace(burnout_s=end_s, state=state, impact=(float(impact[0]), float(impact[1])))


def _row(mark: int, flight: Flight, tracks: opir.Tracks, row: int) -> Row:
    error = tracks.state[row] - flight.state(float(tracks.tick_s[row]))
    nees = float(error @ np.linalg.solve(tracks.state_covariance[row], error))
    regions = {region.containment: region for region in tracks.impact_regions[row]}
    inside = [float(regions[share].contains(*flight.impact)) if regions else np.nan for share in (0.5, 0.95)]
    area = [regions[share].area_km2 if regions else np.nan for share in (0.5, 0.95)]
    return Row(mark, nees, float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:])), *inside, *area)


def table(line: Line, rows: list[Row]) -> Iterator[str]:
    """Yield the CSV lines of a line of the page."""
    for mark, name in enumerate(MARKS):
        mine = [row for row in rows if row.mark == mark]
        told = [row for row in mine if np.isfinite(row.nees)]
        known = [row for row in told if np.isfinite(row.in_95)]
        state = containment(np.array([row.nees for row in told]), 6, 0.95)
        half, most = (
            proportion(int(sum(getattr(row, key) for row in known)), len(known)) for key in ("in_50", "in_95")
        )
        speed = np.sqrt(np.mean([row.velocity_m_s**2 for row in told]))
        area = [np.median([getattr(row, key) for row in known]) for key in ("area_50_km2", "area_95_km2")]
        shares = ",".join(f"{100.0 * value:.1f}" for value in (*state, *half, *most))
        yield f"{line.name},{name},{len(mine)},{len(told)},{shares},{speed:.1f},{area[0]:.4g},{area[1]:.4g}"


HEAD = (
    "flights,mark,flown,tracked,state_95_percent,low,high,impact_50_percent,low,high,impact_95_percent,low,high,"
    "velocity_rmse_m_s,area_50_km2,area_95_km2"
)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--only", help="lines whose names contain this")
    parser.add_argument("--write", type=Path, help="folder of tracker_honesty.csv")
    options = parser.parse_args()
    lines = [HEAD]
    with tempfile.TemporaryDirectory() as folder:
        for line in LINES:
            if options.only is None or options.only in line.name:
                rows = [row for seed in range(options.flights) for row in rows_of(line, seed, Path(folder))]
                lines += list(table(line, rows))
                print("\n".join(lines[-len(MARKS) :]), flush=True)
    if options.write:
        (options.write / "tracker_honesty.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
