"""What two geostationary sensors and the tracker `imm` say of six real ascents, while they burn and
after.

python examples/ascents/what_opir_says.py [--seed 1] [FLIGHT …]
"""

import argparse
import sys
from pathlib import Path

import numpy as np

import opir_core as opir

HERE = Path(__file__).parent
FLIGHTS = ("echostar23", "crs8", "fhdemo", "paz", "orbcomm2", "crs12_stage1")
START_S = 30.0
#: Shares of the time from lift-off to the last state at which the answers are taken.
MARKS = (0.25, 0.5, 0.95)


def show(text: str) -> None:
    """Write a line, at once."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def scene(flight: str, seed: int) -> opir.Scene:
    """Return a scene of one ascent, seen through the air by two slots of SBIRS-GEO once a second."""
    target = {
        "id": flight,
        "model": "table",
        "type": "SLV",
        "file": str(HERE / f"{flight}.csv"),
        "start_s": START_S,
    }
    sensors = [
        {"model": "SBIRS-GEO", "id": "WEST", "orbital_slot_deg": -130.0, "scan_period_ms": 1000},
        {"model": "SBIRS-GEO", "id": "EAST", "orbital_slot_deg": -40.0, "scan_period_ms": 1000},
    ]
    rows = np.loadtxt(HERE / f"{flight}.csv", delimiter=",", skiprows=1, usecols=0)
    return opir.scene_from_mapping(
        {
            "scene": flight,
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": float(START_S + rows[-1]),
            "seed": seed,
            "sensors": sensors,
            "targets": [target],
            "detection": "snr",
            "atmosphere": "lowtran",
            "background": "earth",
            "tracker": "imm",
        }
    )


def answers(flight: str, seed: int) -> None:
    """Print a line for each mark: the likeliest hypothesis, probabilities, and the error of the
    state.
    """
    run = opir.simulate(scene(flight, seed))
    held = run.detections.track[(run.truth.target == 0) & (run.detections.track >= 0)]
    if not len(held):
        show(f"| {flight} | not tracked | | | | | |")
        return
    mine = run.tracks.take(run.tracks.track == np.bincount(held).argmax())
    names = run.plan.hypothesis_names
    for mark in MARKS:
        at_s = START_S + mark * (run.plan.scene.duration_s - START_S)
        row = int(np.searchsorted(mine.tick_s, at_s, side="right")) - 1
        if row < 0:
            show(f"| {flight} | {at_s - START_S:.0f} | no track yet | | | | |")
            continue
        chance = mine.hypothesis_probability[row]
        truth = run.plan.targets.position_ecef_m(np.zeros(1, np.int32), mine.tick_s[[row]])[0]
        off_km = np.linalg.norm(mine.state[row, :3] - truth) * 1e-3
        what = f"{names[int(chance.argmax())]} {chance.max():.2f}"
        sums = [
            mine.probability_launch[row],
            mine.probability_orbit[row],
            mine.probability_missile[row],
        ]
        numbers = " | ".join(f"{value:.2f}" for value in sums)
        show(f"| {flight} | {at_s - START_S:.0f} | {what} | {numbers} | {off_km:.2f} |")


def main() -> None:
    """Print the table of the flights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("flights", nargs="*", default=FLIGHTS)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    show(
        "| flight | s after lift-off | likeliest | P(launch) | P(orbit) | P(missile) | state off"
        " by, km |"
    )
    show("|---|---|---|---|---|---|---|")
    for flight in arguments.flights:
        answers(flight, arguments.seed)


if __name__ == "__main__":
    main()
