"""Processor time and memory of a coverage map: geometry alone and all layers, against a bare numpy
script.

    python benchmarks/coverage_map.py [--scene FILE] [--grid DEG]

24 satellites of LEO-WIDE, 96 instants, cells of 2°, heights 10 and 100 km, one class, two instants
of launches. The script is what a user would write for one height: elevation above the horizon of a
sphere, without field of regard, the Sun or the ellipsoid.
"""

import argparse
import resource
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from figures import keep
from opir_coverage import CoverageSettings, computed_coverage

from opir_core import compile_plan, load_scene, scene_from_mapping

SCENE = {
    "scene": "leo",
    "epoch": "2026-04-01T00:00:00Z",
    "duration_s": 300.0,
    "seed": 1,
    "detection": "snr",
    "atmosphere": "lowtran",
    "background": "earth",
    "sensors": [{"constellation": "LEO-WIDE"}],
    "targets": [],
}
EARTH_M = 6371008.8

Result = TypeVar("Result")


def timed(words: str, work: Callable[[], Result]) -> Result:
    """Print the processor time of a piece of work, and the most memory so far."""
    start = time.process_time()
    result = work()
    spent_s = time.process_time() - start
    keep(f"{words}, processor time", spent_s, "s")
    print(
        f"{words:44} {spent_s:6.2f} s "
        f" {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:5.0f} MiB"
    )
    return result


def script(position_m: "np.ndarray") -> "np.ndarray":
    """Return the numbers in view (T, cells) of satellites (S, T, 3) above a sphere."""
    latitude, longitude = np.meshgrid(
        np.radians(np.arange(-89, 90, 2)), np.radians(np.arange(-179, 180, 2)), indexing="ij"
    )
    up = np.stack(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ]
    )
    up = up.reshape(3, -1)
    return np.stack(
        [(position_m[:, step] @ up > EARTH_M).sum(axis=0) for step in range(position_m.shape[1])]
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene")
    parser.add_argument("--grid", type=float, default=2.0)
    arguments = parser.parse_args()
    scene = load_scene(arguments.scene) if arguments.scene else scene_from_mapping(SCENE)
    plan = timed("plan of the scene", lambda: compile_plan(scene))
    time_s = (np.arange(96) + 0.5) * 900.0
    position_m = np.stack([sensor.orbit.position_ecef_m(time_s) for sensor in plan.sensors])
    timed("numpy script, one height", lambda: script(position_m))
    alone = CoverageSettings(target_class=None, heights_km=(10.0,), grid_deg=arguments.grid)
    timed("access and gaps, one height", lambda: computed_coverage(plan, alone))
    whole = CoverageSettings(grid_deg=arguments.grid)
    timed("all layers, two heights, two launches", lambda: computed_coverage(plan, whole))


if __name__ == "__main__":
    main()
