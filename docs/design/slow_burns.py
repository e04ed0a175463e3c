"""How probable is a space launch for `imm`, of an ICBM of the class profiles? Figures of
`explanation/forecast.md`.

python docs/design/slow_burns.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from tracker_honesty import AFTER_S, LINES, MARKS, START_S, class_profile, scene_of

import opir_core as opir

#: Seeds of `class_profile` that are ICBMs: thirteen flights.
SEEDS = range(2, 41, 3)


def probabilities(seed: int) -> list[float]:
    """Return P(SLV) of the longest track of a flight at the marks of `tracker_honesty`; nan without
    a track.
    """
    line = next(each for each in LINES if not each.stages)
    flight = class_profile(seed)
    end_s = float(opir.compile_plan(scene_of(line, flight, seed, 300.0)).targets.end_s[0])
    run = opir.run_of_plan(
        opir.compile_plan(scene_of(line, flight, seed, float(np.ceil(end_s + AFTER_S))))
    )
    tracks = run.tracks
    orbit = [each.name for each in run.plan.hypotheses].index("SLV")
    number, count = np.unique(tracks.track, return_counts=True)
    own = tracks.take(np.flatnonzero(tracks.track == number[np.argmax(count)]))
    shares = [START_S + share * (end_s - START_S) for share in (0.25, 0.5, 0.75, 0.95)]
    at = [
        np.flatnonzero(own.tick_s == np.round(when))
        for when in (*shares, end_s + 5.0, end_s + 20.0)
    ]
    return [
        float(own.hypothesis_probability[rows[0], orbit]) if len(rows) else np.nan for rows in at
    ]


def main() -> None:
    """Print the means over the flights."""
    means = np.nanmean([probabilities(seed) for seed in SEEDS], axis=0)
    for mark, mean in zip(MARKS, means, strict=True):
        sys.stdout.write(f"{mark:6} {mean:.2f}\n")


if __name__ == "__main__":
    main()
