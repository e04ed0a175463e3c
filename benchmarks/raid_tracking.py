"""A hundred launches in ten seconds from twenty sites, five sensors, false alarms: are all tracked,
and how fast?

    python benchmarks/raid_tracking.py [--runs 3] [--duration 120] [--false-alarms 0.5] [--write
    docs/benchmarks]

The launches of examples/raid_100.yaml seen by five SBIRS-GEO; false alarms are uniform over each
sensor's Earth disc, Poisson in each scan. A target is tracked if some track holds more of its
detections than of any other target's. A track is false if it has no target, or if its target has
another track already. Purity is the share of associated detections that belong to their track's
target; "associated" is the share of the targets' detections that have a track, as the detection
events have it: by the tracks of the last tick. Speed is scene time over the tracker's processor
time, without first imports. The median error is that of the positions at the last tick, of targets
that still burn.
"""

import argparse
import os
import time
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import yaml
from attrs import evolve
from opir_scoring import energy_scores
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.tracker import imm_tracker
from work_precision.results_csv import write_csv

import opir_core as opir
from opir_core.estimation import tangent_axes
from opir_core.interfaces.contexts import TrackerContext
from opir_core.interfaces.records import Detections
from opir_core.planning.plan import Plan, compile_plan

SLOTS_DEG = (-175.0, -155.0, -135.0, -120.0, -100.0)
DISC_RAD = 0.15
PERIOD_NS = 100_000_000
EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "raid_100.yaml"

PAGE = """# Tracking a raid

Does `imm` track a raid, and how fast? It tracks at least {least} of 100 targets, with {false_tracks} false
tracks in {runs} runs, {slow:.0f} to {fast:.0f} times faster than real time. At least {purity:.4f} of the associated
detections belong to their track's target, and at least {labelled:.3f} of the targets' detections have a track. The
median error of position at the end is at most {error:.0f} m, its mean energy score {energy:.0f} m.

A hundred launches in ten seconds (`examples/raid_100.yaml`), five SBIRS-GEO (10 looks/s), {false} false alarms a scan
and sensor, {duration} s, default settings, {detections:.0f} detections a run, one core. By run:
[raid_tracking.csv](raid_tracking.csv).
"""


class Outcome(NamedTuple):
    """What became of one run."""

    seed: int
    tracked: int
    false_tracks: int
    purity: float
    labelled: float
    times_real: float
    median_m: float
    energy_m: float
    detections: int


def scene_of(seed: int, duration_s: int) -> Plan:
    """Return the plan of the raid seen by five sensors."""
    scene: dict[str, Any] = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8"))
    scene.pop("outputs")
    scene |= {"seed": seed, "duration_s": duration_s}
    scene["sensors"] = [
        {"model": "SBIRS-GEO", "id": f"S{number}", "orbital_slot_deg": slot}
        for number, slot in enumerate(SLOTS_DEG)
    ]
    return compile_plan(opir.scene_from_mapping(scene))


def with_false_alarms(
    plan: Plan, detections: Detections, target: np.ndarray, mean: float, seed: int
) -> tuple[Detections, np.ndarray]:
    """Return detections and targets (-1 for false alarms), in order of time."""
    rng = np.random.default_rng(seed)
    scans = int(plan.scene.duration_s * 1e9) // PERIOD_NS
    number = rng.poisson(mean, (len(plan.sensors), scans))
    sensor, scan = (np.repeat(index, number[np.nonzero(number)]) for index in np.nonzero(number))
    place = np.stack([one.orbit.position_ecef_m(np.zeros(1))[0] for one in plan.sensors])[sensor]
    axes = tangent_axes(-place / np.linalg.norm(place, axis=1)[:, None])
    depth = 1.0 - rng.random(len(sensor)) * (1.0 - np.cos(DISC_RAD))
    turn = rng.uniform(0.0, 2.0 * np.pi, len(sensor))
    across = np.sqrt(1.0 - depth**2)
    parts = np.stack([across * np.cos(turn), across * np.sin(turn), depth], axis=1)
    false = evolve(
        detections.take(np.zeros(len(sensor), dtype=np.int64)),
        time_ns=(scan + 1) * PERIOD_NS,
        scan=scan + 1,
        sensor=sensor.astype(np.int32),
        sensor_ecef_m=place,
        line_of_sight_ecef=np.einsum("nk,nkc->nc", parts, axes),
    )
    every = Detections.concatenate([detections, false])
    whose = np.concatenate([target, np.full(len(false), -1)])
    order = np.lexsort((every.sensor, every.time_ns))
    return every.take(order), whose[order]


def outcome(seed: int, duration_s: int, mean: float, settings: dict[str, Any]) -> Outcome:
    """Return what becomes of one run."""
    plan = scene_of(seed, duration_s)
    run = opir.simulate(plan.scene)
    detections, target = with_false_alarms(plan, run.detections, run.truth.target, mean, seed)
    context = TrackerContext(sensors=plan.sensors, epoch_us=0, duration_s=float(duration_s))
    tracker = imm_tracker(ImmConfig(**settings), context)
    label = np.full(len(detections), -1)
    before = 0
    taken = 0.0
    last = None
    for tick in range(1, duration_s + 1):
        cut = int(np.searchsorted(detections.time_ns, tick * 1_000_000_000))
        part = detections.take(slice(before, cut))
        start = time.process_time()
        label[before:cut] = tracker.associate(part)
        last = tracker.step(float(tick), part)
        taken += time.process_time() - start
        before = cut
    assert last is not None
    owner = {
        int(track): Counter(target[label == track].tolist()).most_common(1)[0]
        for track in np.unique(label[label >= 0])
    }
    followed = {whose for whose, _ in owner.values()} - {-1}
    labelled = np.count_nonzero(label >= 0)
    return Outcome(
        seed,
        len(followed),
        len(owner) - len(followed),
        sum(count for _, count in owner.values()) / labelled,
        float(np.mean(label[target >= 0] >= 0)),
        duration_s / taken,
        *errors_m(plan, last, {track: whose for track, (whose, _) in owner.items()}),
        len(detections),
    )


def errors_m(plan: Plan, tracks: Any, owner: dict[int, int]) -> tuple[float, float]:
    """Return the median distance to the truth, and the mean energy score of position, at the last
    tick, of tracks whose target still burns.
    """
    rows = [row for row, track in enumerate(tracks.track.tolist()) if owner.get(track, -1) >= 0]
    whose = np.array([owner[int(tracks.track[row])] for row in rows], dtype=np.int32)
    truth = plan.targets.position_ecef_m(whose, np.full(len(rows), tracks.tick_s[0]))
    error = tracks.state[rows, :3] - truth
    covariance = tracks.state_covariance[rows, :3, :3]
    return float(np.nanmedian(np.linalg.norm(error, axis=1))), float(
        np.nanmean(energy_scores(error, covariance))
    )


def main() -> None:
    """Run the raids and print, or write, the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--duration", type=int, default=120)
    parser.add_argument("--false-alarms", type=float, default=0.5)
    parser.add_argument("--write", type=Path)
    chosen = parser.parse_args()
    outcome(99, 25, chosen.false_alarms, {})  # what is imported at the first use is not counted
    outcomes = [
        outcome(100 + run, chosen.duration, chosen.false_alarms, {}) for run in range(chosen.runs)
    ]
    print(*outcomes, sep="\n")
    if chosen.write:
        detections = float(np.mean([one.detections for one in outcomes]))
        speeds = [one.times_real for one in outcomes]
        page = PAGE.format(
            runs=len(outcomes),
            least=min(one.tracked for one in outcomes),
            false_tracks=sum(one.false_tracks for one in outcomes),
            slow=min(speeds),
            fast=max(speeds),
            purity=min(one.purity for one in outcomes),
            labelled=min(one.labelled for one in outcomes),
            error=max(one.median_m for one in outcomes),
            energy=max(one.energy_m for one in outcomes),
            false=chosen.false_alarms,
            duration=chosen.duration,
            detections=detections,
        )
        (chosen.write / "raid_tracking.md").write_text(page, encoding="utf-8")
        write_csv(chosen.write / "raid_tracking.csv", outcomes)


if __name__ == "__main__":
    main()
