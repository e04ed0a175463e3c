"""Executors of studies: wall and processor time of the same 1 000 runs, serial, with processes and
with Dask.

    python benchmarks/studies.py --runs 1000 --workers 2

Wall times are ratios only where the computer is idle. The ratio of processor times (of this process
and its workers) does not depend on other load: it is what starting workers, sending tasks and
writing parts costs.
"""

import argparse
import json
import resource
import sys
import tempfile
import time
from pathlib import Path

from figures import keep
from opir_studies import Study, sweep

PERIODS_MS = [100, 200, 400, 800]
SCENE = Path(__file__).parents[1] / "examples" / "first_light.yaml"


def processor_s() -> float:
    """Return the processor time of this process and of its workers that have ended, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def measured(executor: str, runs: int, workers: int) -> dict[str, float]:
    """Return wall and processor time of a study."""
    study = Study(
        scene=str(SCENE),
        vary={"sensors[*].scan_period_ms": PERIODS_MS},
        runs=runs // len(PERIODS_MS),
        executor=executor,
        metrics=("latency",),
    )
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        used = processor_s()
        sweep(study, folder, workers=workers)
        wall_s = time.perf_counter() - start
        time.sleep(1.0)  # until the workers have ended and their times are known
        return {"wall_s": wall_s, "processor_s": processor_s() - used}


def main() -> None:
    """Measure each executor in turn and print ratios to serial."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--executors", nargs="+", default=["serial", "processes", "dask"])
    chosen = parser.parse_args()
    found = {name: measured(name, chosen.runs, chosen.workers) for name in chosen.executors}
    serial = found["serial"]
    for name, row in found.items():
        row["efficiency"] = (
            serial["wall_s"] / row["wall_s"] / (1 if name == "serial" else chosen.workers)
        )
        row["processor_ratio"] = serial["processor_s"] / row["processor_s"]
        for what, value in row.items():
            keep(f"{name}: {what}", value)
    json.dump(found, sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()
