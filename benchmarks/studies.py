"""Executors of studies: wall and processor time of the same runs, serial, with processes, Dask.

Wall times are ratios only where the computer is idle. The ratio of processor times (of this process
and its workers) does not depend on other load: it is what starting workers, sending tasks and
writing parts costs.
"""

import os
import tempfile
import time
from pathlib import Path

from figures import keep
from opir_studies import Study, sweep
from pages import options_of

PERIODS_MS = [100, 200, 400, 800]
SCENE = Path(__file__).parents[1] / "examples" / "first_light.yaml"


def times_of(executor, runs, workers):
    """Return wall and processor time of a study, s."""
    study = Study(
        scene=str(SCENE),
        vary={"sensors[*].scan_period_ms": PERIODS_MS},
        runs=runs // len(PERIODS_MS),
        executor=executor,
        metrics=("latency",),
    )
    with tempfile.TemporaryDirectory() as folder:
        before = os.times()
        sweep(study, folder, workers=workers)
        wall_s = os.times().elapsed - before.elapsed
        time.sleep(1.0)  # until the workers have ended and their times are known
        used_s = sum(os.times()[:4]) - sum(before[:4])
        return wall_s, used_s


def main():
    """Measure each executor in turn and print ratios to serial."""
    options = options_of(__doc__, runs=1000, workers=2, executors=("serial", "processes", "dask"))
    times = {name: times_of(name, options.runs, options.workers) for name in options.executors}
    serial_wall_s, serial_s = times["serial"]
    for name, (wall_s, used_s) in times.items():
        figures = {
            "wall_s": wall_s,
            "processor_s": used_s,
            "efficiency": serial_wall_s / wall_s / (1 if name == "serial" else options.workers),
            "processor_ratio": used_s / serial_s,
        }
        print(name, figures)
        for figure, value in figures.items():
            keep(f"{name}: {figure}", value)


if __name__ == "__main__":
    main()
