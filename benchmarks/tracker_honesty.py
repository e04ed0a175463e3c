"""Do the regions of `imm` hold what they say, on flights that share no code with it?

    python benchmarks/tracker_honesty.py [--flights 12] [--only "2 stages"] [--write
    docs/benchmarks]

Staged gravity turns of `foreign_flights` (SciPy) and class profiles of the target model
`ballistic`, drawn with seeds that nothing was built on, each in a scene of its own: one or two
SBIRS-GEO, default settings. At 25, 50, 75 and 95 % of the time from ignition to the last burnout,
and 5 and 20 s after it: is the state in its 95 % ellipsoid, the impact in its 50 and 95 % regions,
and how large are these? What are the energy scores of state and impact, and the log score of
"missile"? And how large are errors beside the Cramér–Rao bound of an estimator that knows the law
of the flights and has their parameters to find (`foreign_bound`)?
"""

import argparse
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import foreign_bound
import numpy as np
from flight_bound import KnownValues, bound_of, central_slopes, parameter_bound
from foreign_flights import RADIUS_M, drawn_flight, ecef
from opir_scoring import energy_scores, log_scores, main_regions, region_energy_m, regions_given
from opir_scoring.bound import DetectedLooks
from opir_scoring.containments import containment, proportion
from opir_scoring.errors import bias_turns
from opir_scoring.evidence import true_states_ecef

import opir_core as opir
from opir_core.flight import propagate_kepler
from opir_core.geometry import eci_to_ecef

#: Columns whose means end the lines of the CSV.
PROPER = (
    *(
        "in_95_if_burn_known",
        "position_energy_m",
        "velocity_energy_m_s",
        "impact_energy_m",
        "missile_log_score",
    ),
    "effective_samples",
)
BOUNDED = ("position", "velocity", "impact")
MARKS = ("25 %", "50 %", "75 %", "95 %", "+5 s", "+20 s")
EPOCH = "2026-04-01T18:00:00Z"
START_S = 10.0
AFTER_S = 30.0
SPIN = np.array([0.0, 0.0, 7.292115e-5])


class Line(NamedTuple):
    """A line of the page: name, stages (0: class profiles), dark gaps, sensors, P_d and bias of the
    sensors.
    """

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


class Law(NamedTuple):
    """What an estimator that knows the law of flights has to find: parameters (p,), their prior,
    steps of differences.

    `states` returns states (m, n, 6) of parameters (m, p) at times (n,), `impacts` ECEF impacts (m,
    3), `edges` the times (m, k) at which they light or go dark.
    """

    parameters: np.ndarray
    prior_sigma: np.ndarray
    step: np.ndarray
    states: Callable[[np.ndarray, np.ndarray], np.ndarray]
    impacts: Callable[[np.ndarray], np.ndarray]
    edges: Callable[[np.ndarray], np.ndarray]


class Flight(NamedTuple):
    """A target, its burnout since the scene's start, states at times (or None), impact, launch and
    law (or None).
    """

    target: dict[str, Any]
    burnout_s: float
    state: Any
    impact: tuple[float, float] | None
    longitude_deg: float
    law: Law | None = None


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
    impact_m: float
    position_over_bound: float
    velocity_over_bound: float
    impact_over_bound: float
    in_95_if_burn_known: float
    position_energy_m: float
    velocity_energy_m_s: float
    impact_energy_m: float
    missile_log_score: float
    effective_samples: float


def foreign(line: Line, seed: int, folder: Path) -> Flight:
    """Return a flight of `foreign_flights`, its table written to a folder."""
    flight = drawn_flight(
        line.stages, line.gaps, np.random.default_rng([7, line.stages, line.gaps, seed])
    )
    path = folder / "flight.csv"
    flight.write(path)
    kind = "SRBM" if flight.range_km < 1000.0 else "IRBM" if flight.range_km < 5500.0 else "ICBM"
    target = {"id": "T", "model": "table", "type": kind, "file": str(path), "start_s": START_S}
    longitude = float(np.degrees(flight.launch[1]))
    parameters, sigma = foreign_bound.parameters(flight.boost, START_S)

    def paths(rows: np.ndarray) -> foreign_bound.Paths:
        return foreign_bound.flown(rows, line.stages)

    law = Law(
        parameters,
        sigma,
        1e-4 * sigma,
        lambda rows, time_s: paths(rows).states(time_s),
        lambda rows: paths(rows).impacts(),
        lambda rows: foreign_bound.edges(rows, line.stages),
    )
    state = lambda s: flight.state(s - START_S)  # noqa: E731
    return Flight(target, START_S + flight.burnout_s, state, flight.impact[:2], longitude, law)


def class_profile(seed: int) -> Flight:
    """Return a flight of the target model `ballistic`, of each class in turn."""
    rng = np.random.default_rng([7, 0, seed])
    kind, reach = (("SRBM", (2.0, 8.0)), ("IRBM", (12.0, 40.0)), ("ICBM", (55.0, 90.0)))[seed % 3]
    latitude = np.degrees(np.arcsin(rng.uniform(-0.7, 0.7)))
    longitude = rng.uniform(-180.0, 180.0)
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    far = np.radians(rng.uniform(*reach))
    place = np.radians(latitude)
    sine = np.sin(place) * np.cos(far) + np.cos(place) * np.sin(far) * np.cos(azimuth)
    east = np.arctan2(
        np.sin(azimuth) * np.sin(far) * np.cos(place), np.cos(far) - np.sin(place) * sine
    )
    aim = {
        "lat_deg": float(np.degrees(np.arcsin(sine))),
        "lon_deg": float(longitude + np.degrees(east) + 540.0) % 360.0 - 180.0,
    }
    launch = {"lat_deg": float(latitude), "lon_deg": float(longitude), "time_s": START_S}
    target = {"id": "T", "model": "ballistic", "type": kind, "launch": launch, "aim": aim}
    return Flight(target, np.nan, None, None, float(longitude))


def scene_of(line: Line, flight: Flight, seed: int, duration_s: float) -> opir.Scene:
    """Return the scene of a flight."""
    slots = [(flight.longitude_deg + shift + 540.0) % 360.0 - 180.0 for shift in (-35.0, 30.0)][
        : line.sensors
    ]
    sensor: dict[str, Any] = {"model": "SBIRS-GEO", "line_of_sight_bias_sigma_urad": line.bias_urad}
    if line.detection_probability is not None:
        sensor["detection_probability"] = dict.fromkeys(
            ("ICBM", "IRBM", "SRBM"), line.detection_probability
        )
    return opir.scene_from_mapping(
        {
            "scene": "honesty",
            "epoch": EPOCH,
            "duration_s": duration_s,
            "seed": 5000 + seed,
            "sensors": [
                {**sensor, "id": f"S{slot:.2f}", "orbital_slot_deg": slot} for slot in slots
            ],
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
    plan = opir.compile_plan(
        scene_of(line, flight, seed, float(np.ceil(flight.burnout_s + AFTER_S)))
    )
    run = opir.run_of_plan(plan)
    tracks = run.tracks
    number, count = np.unique(tracks.track, return_counts=True)
    burn = flight.burnout_s - START_S
    ends = [START_S + share * burn for share in (0.25, 0.5, 0.75, 0.95)] + [
        flight.burnout_s + s for s in (5.0, 20.0)
    ]
    bounds = (
        bounds_of(flight, plan, run, np.round(ends))
        if flight.law
        else np.full((len(ends), 3), np.nan)
    )
    for mark, when in enumerate(ends):
        here = np.flatnonzero(tracks.tick_s == np.round(when))
        if len(here):
            # The oldest track: false ones are short.
            row = here[np.argmax(count[np.searchsorted(number, tracks.track[here])])]
            yield _row(mark, flight, tracks, int(row), bounds[mark])
        else:
            yield Row(mark, *[np.nan] * (len(Row._fields) - 1))


def bounds_of(flight: Flight, plan: opir.Plan, run: opir.Run, tick_s: np.ndarray) -> np.ndarray:
    """Return bounds (ticks, 3) of the errors of position, velocity and impact, m and m/s, by the
    looks before ticks.
    """
    law = flight.law
    assert law
    detections = run.detections.take(np.flatnonzero(run.truth.target == 0))
    detections = detections.take(np.argsort(detections.time_ns, kind="stable"))
    times = detections.time_s
    count = len(tick_s)
    if len(times) < 2:  # out of the sensors' sight
        return np.full((count, len(BOUNDED)), np.nan)
    every = np.concatenate([times, tick_s])

    def values(rows: np.ndarray) -> np.ndarray:
        states = law.states(rows, every)
        parts = [
            states[:, : len(times), :3],
            states[:, len(times) :],
            law.impacts(rows),
            law.edges(rows),
        ]
        return np.concatenate([part.reshape(len(rows), -1) for part in parts], axis=1)

    slopes = central_slopes(values, law.parameters, law.step)
    cuts = np.cumsum([3 * len(times), 6 * count, 3])
    by_look, by_tick, by_impact, by_edge = np.split(slopes, cuts)
    size = len(law.parameters)
    place = law.states(law.parameters[None], times)[0, :, :3]
    turns = bias_turns(plan.sensors, detections.sensor, detections.sensor_ecef_m)
    looks = DetectedLooks(
        times, place, detections.sensor_ecef_m, detections.line_of_sight_sigma_rad, turns
    )
    # Light and dark show within the time between two looks.
    gap_s = (times[-1] - times[0]) / max(len(times) - 1, 1)
    known = KnownValues(law.edges(law.parameters[None])[0] + gap_s, by_edge * np.sqrt(12.0) / gap_s)
    found = parameter_bound(tick_s, looks, by_look.reshape(-1, 3, size), law.prior_sigma, known)
    state = bound_of(found, by_tick.reshape(count, 6, size))
    impact = bound_of(found, np.broadcast_to(by_impact, (count, 3, size)))
    variance = np.diagonal(state, axis1=1, axis2=2)
    parts = [
        variance[:, :3].sum(axis=1),
        variance[:, 3:].sum(axis=1),
        np.trace(impact, axis1=1, axis2=2),
    ]
    return np.sqrt(np.stack(parts, axis=1))


def _known(flight: Flight, plan: opir.Plan) -> Flight:
    """Return a class profile's flight with its truth, and what an estimator that knows the class
    has to find.
    """
    (truth,) = plan.targets.truth()
    impact = np.radians([truth["impact"]["lat_deg"], truth["impact"]["lon_deg"]])
    launch = flight.target["launch"]
    aim = flight.target["aim"]

    def targets(rows: np.ndarray) -> opir.Plan:
        """Return a plan of flights with launch and aim, deg, and ignition, s, (m, 5)."""
        keys = ("lat_deg", "lon_deg")
        each = [
            {
                **flight.target,
                "id": f"T{number}",
                "launch": {**dict(zip(keys, row[:2], strict=True)), "time_s": row[4]},
                "aim": dict(zip(keys, row[2:4], strict=True)),
            }
            for number, row in enumerate(rows.tolist())
        ]
        scene = {"scene": "law", "epoch": EPOCH, "duration_s": 300.0, "seed": 1, "targets": each}
        return opir.compile_plan(
            opir.scene_from_mapping(
                {**scene, "sensors": [{"constellation": "SBIRS-GEO"}], "tracker": "none"}
            )
        )

    def impacts(rows: np.ndarray) -> np.ndarray:
        return np.array([ecef(*place) for place in np.radians(rows[:, 2:4])])

    flat = np.cos(np.radians([launch["lat_deg"], aim["lat_deg"]]))
    metres = np.radians(1.0) * RADIUS_M * np.array([1.0, flat[0], 1.0, flat[1], np.nan])
    law = Law(
        np.array([*list(launch.values())[:2], *aim.values(), launch["time_s"]]),
        np.append(1e6 / metres[:4], 1e3),
        np.append(3e3 / metres[:4], 0.1),
        lambda rows, time_s: states_of(targets(rows), time_s),
        impacts,
        lambda rows: rows[:, 4:],
    )
    end_s = float(plan.targets.end_s[0])
    state = lambda s: states_of(plan, np.array([s]))[0, 0]  # noqa: E731
    return flight._replace(
        burnout_s=end_s, state=state, impact=(float(impact[0]), float(impact[1])), law=law
    )


def states_of(plan: opir.Plan, time_s: np.ndarray) -> np.ndarray:
    """Return states (m, n, 6) of a plan's targets at times (n,): after burnout two-body motion, the
    scene's force.
    """
    count = len(plan.targets.ids)
    size = len(time_s)
    target = np.repeat(np.arange(count, dtype=np.int32), size)
    when = np.tile(time_s, count)
    last = plan.targets.end_s[target] - 1e-3
    found = true_states_ecef(
        plan, target, np.maximum(np.minimum(when, last), plan.targets.ignition_s[target])
    )
    late = np.flatnonzero(when > last)
    if len(late):
        since = when[late] - last[late]
        place = found[late, :3]
        velocity = found[late, 3:]
        place, velocity = propagate_kepler(place, velocity + np.cross(SPIN, place), since)
        place = eci_to_ecef(place, since)
        velocity = eci_to_ecef(velocity, since)
        found[late] = np.concatenate([place, velocity - np.cross(SPIN, place)], axis=1)
    return found.reshape(count, size, 6)


def _row(mark: int, flight: Flight, tracks: opir.Tracks, row: int, bound: np.ndarray) -> Row:
    error = tracks.state[row] - flight.state(float(tracks.tick_s[row]))
    nees = float(error @ np.linalg.solve(tracks.state_covariance[row], error))
    reported = tracks.impact_regions[row]
    regions = {region.containment: region for region in main_regions(reported)}
    given = regions_given(reported, float(tracks.tick_s[row]) >= flight.burnout_s)
    inside = [
        float(regions[share].contains(*flight.impact)) if regions else np.nan
        for share in (0.5, 0.95)
    ]
    area = [regions[share].area_km2 if regions else np.nan for share in (0.5, 0.95)]
    place = ecef(*tracks.impact[row, :2])
    true = ecef(*flight.impact)
    angle = np.arctan2(np.linalg.norm(np.cross(place, true)), place @ true)
    errors = np.array([np.linalg.norm(error[:3]), np.linalg.norm(error[3:]), RADIUS_M * angle])
    known = [
        float(region.contains(*flight.impact)) for region in given if region.containment == 0.95
    ]
    scores = proper_scores(flight, tracks, row, error)
    ratios = (errors / bound).tolist()
    return Row(
        mark,
        nees,
        *errors[:2].tolist(),
        *inside,
        *area,
        float(errors[2]),
        *ratios,
        *(known or [np.nan]),
        *scores,
    )


def proper_scores(
    flight: Flight, tracks: opir.Tracks, row: int, error: np.ndarray
) -> tuple[float, ...]:
    """Return energy scores of position, velocity and impact, m and m/s, log score of "missile",
    effective samples.
    """
    one = tracks.take(np.array([row]))
    state = [
        float(energy_scores(error[None], one.state_covariance, one.state_sigmas, part)[0])
        for part in (slice(0, 3), slice(3, 6))
    ]
    regions = tracks.impact_regions[row]
    impact_m = region_energy_m(regions, np.array(flight.impact)) if regions else np.nan
    stated = one.probability_missile[:, None]
    log_score = float(log_scores(stated, np.zeros(1, dtype=np.int64))[0])
    samples = min((region.effective_samples for region in regions), default=np.nan)
    return *state, impact_m, log_score, samples


def table(line: Line, rows: list[Row]) -> Iterator[str]:
    """Yield the CSV lines of a line of the page."""
    for mark, name in enumerate(MARKS):
        mine = [row for row in rows if row.mark == mark]
        reported = [row for row in mine if np.isfinite(row.nees)]
        known = [row for row in reported if np.isfinite(row.in_95)]
        state = containment(np.array([row.nees for row in reported]), 6, 0.95)
        half, most = (
            proportion(int(sum(getattr(row, key) for row in known)), len(known))
            for key in ("in_50", "in_95")
        )
        speed = np.sqrt(np.mean([row.velocity_m_s**2 for row in reported]))
        area = [
            np.median([getattr(row, key) for row in known])
            for key in ("area_50_km2", "area_95_km2")
        ]
        shares = ",".join(f"{100.0 * value:.1f}" for value in (*state, *half, *most))
        ratios = ",".join(
            over_bound(getattr(row, f"{what}_over_bound") for row in reported) for what in BOUNDED
        )
        impact_km = 1e-3 * np.median([row.impact_m for row in known])
        sizes = f"{speed:.1f},{area[0]:.4g},{area[1]:.4g},{impact_km:.1f}"
        proper = ",".join(mean_of(getattr(row, key) for row in reported) for key in PROPER)
        yield f"{line.name},{name},{len(mine)},{len(reported)},{shares},{sizes},{ratios},{proper}"


def mean_of(values: Iterable[float]) -> str:
    """Return the mean of the known values, for the CSV."""
    known = np.array([value for value in values if np.isfinite(value)])
    return f"{known.mean():.4g}" if len(known) else ""


def over_bound(ratios: Iterable[float]) -> str:
    """Return root mean square and median of errors over their bounds, for the CSV."""
    known = np.array([ratio for ratio in ratios if np.isfinite(ratio)])
    return f"{np.sqrt(np.mean(known**2)):.2f},{np.median(known):.2f}" if len(known) else ","


HEAD = (
    "flights,mark,flown,tracked,state_95_percent,low,high,impact_50_percent,low,high,impact_95_percent,low,high,"
    "velocity_rmse_m_s,area_50_km2,area_95_km2,impact_error_median_km,"
    "position_over_bound_rms,position_over_bound_median,velocity_over_bound_rms,velocity_over_bound_median,"
    "impact_over_bound_rms,impact_over_bound_median," + ",".join(PROPER)
)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flights", type=int, default=12)
    parser.add_argument("--only", help="lines whose names contain this")
    parser.add_argument("--write", type=Path, help="folder of the CSV")
    options = parser.parse_args()
    lines = [HEAD]
    with tempfile.TemporaryDirectory() as folder:
        for line in LINES:
            if options.only is None or options.only in line.name:
                rows = [
                    row
                    for seed in range(options.flights)
                    for row in rows_of(line, seed, Path(folder))
                ]
                lines += list(table(line, rows))
                print("\n".join(lines[-len(MARKS) :]), flush=True)
    if options.write:
        (options.write / "tracker_honesty.csv").write_text(
            "\n".join(lines) + "\n", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
