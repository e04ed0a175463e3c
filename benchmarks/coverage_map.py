"""Processor time and memory of a coverage map: geometry alone and all layers, beside a bare script.

24 satellites of LEO-WIDE, 96 instants, cells of 2°, heights 10 and 100 km, one class, two instants
of launches. The script is what a user would write in numpy for one height: elevation above the
horizon of a sphere, without field of regard, the Sun or the ellipsoid.
"""

import resource
import time

import numpy as np
from figures import keep
from opir_coverage import CoverageSettings, computed_coverage
from pages import options_of

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


def timed(name, work):
    """Print the processor time of a piece of work, and the most memory so far."""
    start = time.process_time()
    result = work()
    spent_s = time.process_time() - start
    keep(f"{name}, processor time", spent_s, "s")
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{name:44} {spent_s:6.2f} s  {peak_mib:5.0f} MiB")
    return result


def script(position_m):
    """Return the numbers in view (T, cells) of satellites (S, T, 3) above a sphere."""
    latitude, longitude = np.radians(
        np.meshgrid(np.arange(-89, 90, 2), np.arange(-179, 180, 2), indexing="ij")
    ).reshape(2, -1)
    level = np.cos(latitude)
    up = np.stack([level * np.cos(longitude), level * np.sin(longitude), np.sin(latitude)])
    instants = position_m.transpose(1, 0, 2)
    return np.stack([(satellites @ up > 6371008.8).sum(axis=0) for satellites in instants])


def main():
    """Measure and print."""
    options = options_of(__doc__, scene=str, grid=2.0)
    scene = load_scene(options.scene) if options.scene else scene_from_mapping(SCENE)
    plan = timed("plan of the scene", lambda: compile_plan(scene))
    time_s = (np.arange(96) + 0.5) * 900.0
    position_m = np.stack([sensor.orbit.position_ecef_m(time_s) for sensor in plan.sensors])
    timed("numpy script, one height", lambda: script(position_m))
    access = CoverageSettings(target_class=None, heights_km=(10.0,), grid_deg=options.grid)
    timed("access and gaps, one height", lambda: computed_coverage(plan, access))
    layers = CoverageSettings(grid_deg=options.grid)
    timed("all layers, two heights, two launches", lambda: computed_coverage(plan, layers))


if __name__ == "__main__":
    main()
