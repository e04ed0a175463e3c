"""Tracking: run time against error over the bound, for `imm` at several cadences, Stone Soup and
FilterPy.

    python benchmarks/work_precision/tracking.py [--runs 100] [--peer-runs 4] [--raid-seconds 20]
    [--write FOLDER] python benchmarks/work_precision/tracking.py --from-csv
    docs/benchmarks/tracking.csv

The same detections for all, in one run. One target: two geostationary sensors at 10° E and 100° E,
10 looks a second each, 20 µrad, 300 s of free flight. A hundred targets: P_d 0.9, 20 clutter points
a frame, tracks started from noisy truth, spread over 2000 km or crowded in 100 km. Processor time
of one core. Peers that are not installed are left out.
"""

import argparse
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import tracking_peers as peers
import tracking_scene
from attrs import evolve
from opir_scoring.gospa_metric import gospa
from opir_testing.doubles import stub_sensor
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.associate import associate
from opir_trackers.imm.predict import predict
from opir_trackers.imm.state import TrackerState
from opir_trackers.imm.track_management import TrackTable
from opir_trackers.imm.tracking import ImmTracking
from opir_trackers.imm.update import update
from opir_trackers.onset.motion_statistics import MotionStatistics
from peers import installed, is_installed
from tracking_page import (
    Line,
    RaidLines,
    raid_rows,
    single_rows,
    write_csv,
    write_page,
)
from tracking_problems import (
    CHANCE,
    CLUTTER,
    SENSORS_M,
    Problem,
    bound_m,
    coasting_filter,
    first_bank,
    known_sights,
    problem as made,
)

from opir_core.interfaces.contexts import TrackerContext

CADENCES_S = (0.1, 1.0, 5.0, 10.0)
CUTOFF_M = 5000.0


def coasted(case: Problem, cadence_s: float, burning: float = 0.0) -> tuple[np.ndarray, float]:
    """Return `imm`'s positions at the end, association known, and the seconds taken."""
    filter_ = coasting_filter()
    if burning:
        filter_ = evolve(filter_, boost_s=150.0, coast_s=1000.0)
    bank = first_bank(case.prior, burning)
    everything = known_sights(case.rays, case.target)
    cuts = np.searchsorted(
        case.rays.time_s, np.arange(1, round(case.seconds / cadence_s) + 1) * cadence_s + 1e-9
    )
    start = time.process_time()
    before = 0
    for number, cut in enumerate(cuts, start=1):
        bank = filter_.predicted(bank, cadence_s)
        bank = filter_.updated(
            bank, number * cadence_s, everything.take(slice(before, cut)), cadence_s
        )
        before = cut
    taken = time.process_time() - start
    return filter_.moments(bank)[0][:, :3], taken


def part_of(case: Problem, targets: int) -> Problem:
    """Return the problem of the first targets alone."""
    rows = np.flatnonzero((case.target >= 0) & (case.target < targets))
    return Problem(
        case.rays.take(rows),
        case.target[rows],
        case.start[:targets],
        case.prior[:targets],
        case.seconds,
    )


def single_of(case: Problem, target: int) -> Problem:
    """Return the problem of one target."""
    rows = np.flatnonzero(case.target == target)
    return Problem(
        case.rays.take(rows),
        np.zeros(len(rows), dtype=np.int64),
        case.start[[target]],
        case.prior[[target]],
        case.seconds,
    )


def rmse_m(found: np.ndarray, case: Problem) -> float:
    """Return the root of the mean squared distance to the truth at the end."""
    return float(
        np.sqrt(np.mean(np.sum((found - case.truth(float(case.seconds))[:, :3]) ** 2, axis=1)))
    )


def single_lines(case: Problem, peer_runs: int) -> Iterator[Line]:
    """Yield a line for each tracker on one target."""
    bound = float(np.sqrt(np.mean(bound_m(case) ** 2)))
    alone = single_of(case, 0)
    looks = len(alone.rays)

    def micro(cadence_s: float, burning: float = 0.0) -> float:
        return 1e6 * min(coasted(alone, cadence_s, burning)[1] for _ in range(3)) / looks

    for cadence in CADENCES_S:
        yield Line(
            f"imm, coast, {cadence:g} s",
            micro(cadence),
            rmse_m(coasted(case, cadence)[0], case) / bound,
            len(case.start),
        )
    both = rmse_m(coasted(case, 1.0, 0.5)[0], case) / bound
    yield Line("imm, boost and coast, 1 s", micro(1.0, 0.5), both, len(case.start))
    few = part_of(case, peer_runs)
    yield Line(
        "imm, coast, 1 s, same runs",
        micro(1.0),
        rmse_m(coasted(few, 1.0)[0], few) / bound,
        peer_runs,
    )
    ways: dict[str, Callable[[Problem], tuple[np.ndarray, float]]] = {
        "FilterPy EKF, two-body": peers.filterpy_filter,
        "Stone Soup EKF, two-body": lambda one: peers.stone_soup_filter(one, False),
        "Stone Soup UKF, two-body": lambda one: peers.stone_soup_filter(one, True),
    }
    for name in installed(ways):
        way = ways[name]
        reports = [way(single_of(case, target)) for target in range(peer_runs)]
        found = np.stack([state[:3] for state, _ in reports])
        yield Line(
            name,
            1e6 * min(taken for _, taken in reports) / looks,
            rmse_m(found, few) / bound,
            peer_runs,
        )


def tracked(case: Problem, **settings: float | str) -> tuple[list[tuple[float, np.ndarray]], float]:
    """Return `imm`'s positions at the end of each slice, association unknown, and the seconds
    taken.
    """
    sensors = tuple(
        stub_sensor(name, slot, detection_probability={"ICBM": CHANCE}) for name, slot in _SLOTS
    )
    config = ImmConfig(
        motion="coast", coast_noise_m_s=0.0, false_alarms_per_sr=_density(case), **settings
    )
    context = TrackerContext(
        sensors=sensors,
        epoch_us=0,
        duration_s=float(case.seconds),
        forces="kepler",
        light_time=False,
    )
    tracking = ImmTracking.of(config, context)
    slice_s = config.slice_s
    now = begun(tracking, case)
    reports = []
    before = 0
    taken = 0.0
    for number in range(1, round(case.seconds / slice_s) + 1):
        end = number * slice_s
        cut = int(np.searchsorted(case.rays.time_s, end + 1e-9))
        rays = case.rays.take(slice(before, cut))
        before = cut
        start = time.process_time()
        ahead = predict(tracking.models, now, end, rays)
        now = update(
            tracking.models,
            now,
            ahead,
            associate(tracking.models, now, ahead),
            np.full(len(rays), -1),
        )
        taken += time.process_time() - start
        reports.append((end, tracking.models.filter.moments(now.estimates)[0][:, :3]))
    return reports, taken


def begun(tracking: ImmTracking, case: Problem) -> TrackerState:
    """Return the situation at time 0: a track a target, begun with its noisy truth."""
    number = np.arange(len(case.prior))
    bank = first_bank(case.prior)
    # As if just detected: what is asked of tracks without any detection is nan.
    first_s = np.zeros(len(number))
    roster = evolve(TrackTable.fresh(number, 0.0, len(_SLOTS)), first_s=first_s, seen_s=first_s)
    prior = tracking.models.groups.prior
    motion = MotionStatistics.fresh(bank.likelier_position_m, 0.0, first_s, prior)
    return evolve(
        tracking.start(), estimates=bank, table=roster, motion=motion, next_number=len(bank)
    )


_SLOTS = (("WEST", 10.0), ("EAST", 100.0))


def _density(case: Problem) -> float:
    """Return clutter points a scan and sr, of the square they are drawn in as the first sensor sees
    it.
    """
    width = 1.5 * np.ptp(case.start[:, :3] - case.start[:, :3].mean(axis=0), axis=0).max()
    return float(
        CLUTTER / (width / np.linalg.norm(case.start[:, :3].mean(axis=0) - SENSORS_M[0])) ** 2
    )


def mean_gospa_m(case: Problem, reports: list[tuple[float, np.ndarray]]) -> float:
    """Return the GOSPA a target, over the last half of what was reported."""
    late = reports[len(reports) // 2 :]
    scores = [
        gospa(found, case.truth(when)[:, :3], cutoff=CUTOFF_M).distance for when, found in late
    ]
    return float(np.mean(scores) / np.sqrt(len(case.start)))


def followed_known(case: Problem) -> list[tuple[float, np.ndarray]]:
    """Return `imm`'s positions at the end of each second, association known."""
    filter_ = coasting_filter()
    bank = first_bank(case.prior)
    reports = []
    before = 0
    mine = np.flatnonzero(case.target >= 0)
    everything = known_sights(case.rays.take(mine), case.target[mine])
    for second in range(1, case.seconds + 1):
        cut = int(np.searchsorted(everything.time_s, second + 1e-9))
        part = everything.take(slice(before, cut))
        before = cut
        bank = filter_.updated(filter_.predicted(bank, 1.0), float(second), part, 1.0)
        reports.append((float(second), filter_.moments(bank)[0][:, :3]))
    return reports


def raid_lines(case: Problem, first: bool, joint_peer: bool) -> Iterator[tuple[str, float, float]]:
    """Yield name, ms a frame and GOSPA a target for each way to associate."""
    frames = 20 * case.seconds
    yield "known", np.nan, mean_gospa_m(case, followed_known(case))
    tracked(case)  # what is imported at the first use is not counted
    ways: list[dict[str, float]] = [
        {"slice_s": 1.0},
        {"slice_s": 2.0, "cadence_s": 2.0},
    ]
    for way in ways:
        reports, taken = tracked(case, **way)
        name = f"imm, slices of {way['slice_s']} s"
        yield name, 1e3 * taken / frames, mean_gospa_m(case, reports)
    if not first or not is_installed("Stone Soup"):
        return
    reports, taken = peers.stone_soup_raid(case, "nearest", CLUTTER / _density(case))
    yield "Stone Soup EKF, GNN with k-d tree", 1e3 * taken / frames, mean_gospa_m(case, reports)
    if joint_peer:
        reports, taken = peers.stone_soup_raid(case, "joint", CLUTTER / _density(case))
        yield "Stone Soup EKF, JPDA with EHM2", 1e3 * taken / frames, mean_gospa_m(case, reports)


def raid_lines_of(cases: list[Problem], joint_peer: bool) -> RaidLines:
    """Return, by name, ms a frame and GOSPA a target for each seed of one scene of a hundred
    targets.
    """
    found: RaidLines = {}
    for number, case in enumerate(cases):
        for name, taken, score in raid_lines(case, number == 0, joint_peer):
            found.setdefault(name, []).append((taken, score))
    return found


def chosen_runs() -> argparse.Namespace:
    """Return what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--peer-runs", type=int, default=4)
    parser.add_argument("--seconds", type=int, default=300)
    parser.add_argument("--raid-targets", type=int, default=100)
    parser.add_argument("--raid-seconds", type=int, default=20)
    parser.add_argument("--raid-seeds", type=int, default=6)
    parser.add_argument("--scene-runs", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", type=Path, help="folder for the CSV file, the page and the plot")
    parser.add_argument(
        "--from-csv", type=Path, help="redraw page and plot beside this file, and run nothing"
    )
    return parser.parse_args()


def main() -> None:
    """Run everything and write the results, or redraw page and plot from a CSV file."""
    chosen = chosen_runs()
    if chosen.from_csv:
        write_page(chosen.from_csv)
        return
    if chosen.scene_runs:
        tracking_scene.written(chosen.scene_runs, chosen.write)
    case = made(chosen.runs, chosen.seconds, chosen.seed, 5e4, 1.0, 0)
    bound = float(np.sqrt(np.mean(bound_m(case) ** 2)))
    rows = single_rows(list(single_lines(case, chosen.peer_runs)), bound, chosen.seconds)

    def raids(half_width_m: float) -> list[Problem]:
        seeds = range(chosen.seed, chosen.seed + chosen.raid_seeds)
        return [
            made(chosen.raid_targets, chosen.raid_seconds, seed, half_width_m, CHANCE, CLUTTER)
            for seed in seeds
        ]

    scenes = {"spread": raid_lines_of(raids(1e6), False), "raid": raid_lines_of(raids(5e4), True)}
    rows += raid_rows(scenes, chosen.raid_seconds)
    print("\n".join(",".join(row.values()) for row in rows))
    if chosen.write:
        write_csv(chosen.write / "tracking.csv", rows)
        write_page(chosen.write / "tracking.csv")


if __name__ == "__main__":
    main()
