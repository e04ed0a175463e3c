"""Replicates of one launch: how many in an hour, with what memory, and how the error of their mean
falls.

Replicate k has the seed of the scene plus k. Each worker compiles the scene once and runs its own
share of them.
"""

import resource
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
from attrs import evolve
from figures import keep
from pages import markdown_table, options_of

import opir_core as opir

SCENE = Path(__file__).parents[1] / "examples" / "first_light.yaml"
#: Light: sensors and classifier are then the defaults.
AIR = ("detection=auto", "atmosphere=lowtran")
SBIRS = (*AIR, "sensors[0].model=SBIRS-GEO")


class Case(NamedTuple):
    """A scene: its name, overrides of the file, and the share of the runs that it gets."""

    name: str
    overrides: tuple[str, ...]
    share: float


CASES = (
    Case("first_light: no light, `detection: constant`", (), 1.0),
    Case("in the air, all else default", AIR, 0.2),
    Case("the same with SBIRS-GEO", SBIRS, 0.05),
    Case(
        "the same with `classification: paper`, which knows the true type",
        (*SBIRS, "classification=paper"),
        0.2,
    ),
)
MILLION = 1_000_000
#: Parts of a worker's runs after which its memory is taken.
PARTS = 4

PAGE = """# Replicates of one launch

How long do a million replicates of one launch take, and how exact is what they say?

With default settings a million replicates of `first_light` in the air take {times[1]} on
{workers} cores with DSP, {times[2]} with SBIRS-GEO ({times[3]} with `classification: paper`);
without light, as the file has it, {times[0]}. From the first quarter of its runs to the last a
worker grows by {grown:.1f} MiB.

{table}

DSP looks every 200 ms without light, every 10 s with it; SBIRS-GEO looks every 100 ms. The latency
that is asked for reads no types: the default classifier, which works from measured irradiances,
computes none. `classification: paper` draws the type from a confusion matrix. A million is the
processor time of a run times a million: this page runs fewer. The first run of a worker, which
compiles the scene, is not counted: it takes {start}.
Memory is the peak of a worker after each quarter of its runs.

## Error against the number of runs

The mean latency of the first detection of `first_light`, without light: the root mean square, over
blocks of equally many runs, of the difference between the block's mean and the mean of all {runs}
runs; beside it σ/√n, with the σ of single runs.

{errors}

A million runs would give the mean to {million_us:.1f} µs.
"""


class Share(NamedTuple):
    """Results of a worker: latencies (runs,), s, detections a run, processor time of the first run
    and of each later one, s, and peaks of memory, MiB.
    """

    latency_s: np.ndarray
    detections: float
    first_s: float
    later_s: float
    peak_mib: list[float]


def share_of(overrides, first, runs):
    """Run replicates from a number on."""
    start = time.process_time()
    scene = opir.load_scene(SCENE, overrides=overrides)
    latency_s = np.full(runs, np.nan)
    detections = 0
    first_s = 0.0
    peak_mib = list[float]()
    for number, run in enumerate(opir.replicates(evolve(scene, seed=scene.seed + first), runs)):
        detections += len(run.detections)
        if len(run.detections):
            seen_s = run.detections.time_ns[0] * 1e-9
            latency_s[number] = seen_s - run.plan.targets.ignition_s[0]
        if number == 0:
            first_s = time.process_time() - start
        if (number + 1) * PARTS % runs < PARTS:
            peak_mib.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
    later_s = (time.process_time() - start - first_s) / (runs - 1)
    return Share(latency_s, detections / runs, first_s, later_s, peak_mib)


def shares_of(case, runs, workers):
    """Return the shares of all workers; keep their figures."""
    count = round(case.share * runs) // workers
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        tasks = [
            pool.submit(share_of, case.overrides, number * count, count)
            for number in range(workers)
        ]
        shares = [task.result() for task in tasks]
    keep(f"{case.name}: a run", 1e3 * mean_s(shares), "ms")
    peak_mib = shares[0].peak_mib
    keep(f"{case.name}: memory after all over that after a quarter", peak_mib[-1] / peak_mib[0])
    return shares


def mean_s(shares):
    """Return the mean processor time of a run."""
    return float(np.mean([share.later_s for share in shares]))


def block_errors(latency_s):
    """Return numbers of runs, root-mean-square errors of their means, ms, and σ/√n, ms."""
    finite = latency_s[np.isfinite(latency_s)]
    rows = []
    for number in (10, 100, 1000):
        blocks = len(finite) // number
        if blocks >= 2:
            means = finite[: blocks * number].reshape(blocks, number).mean(axis=1)
            error_s = np.sqrt(np.mean((means - finite.mean()) ** 2))
            rows.append((number, f"{1e3 * error_s:.2f}", f"{1e3 * finite.std() / number**0.5:.2f}"))
    return rows


def duration(seconds):
    """Return a duration as the page writes it."""
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def page(results):
    """Return the page."""
    workers = len(results[CASES[0]])
    times = {case: duration(mean_s(shares) * MILLION / workers) for case, shares in results.items()}
    lines = []
    for case, shares in results.items():
        peaks = zip(*(share.peak_mib for share in shares), strict=True)
        runs = sum(len(share.latency_s) for share in shares)
        cost_ms = f"{1e3 * mean_s(shares):.2f}"
        memory = ", ".join(f"{max(peak):.0f}" for peak in peaks)
        detections = f"{shares[0].detections:.0f}"
        lines.append((case.name, runs, detections, cost_ms, times[case], memory))
    dark = results[CASES[0]]
    latency_s = np.concatenate([share.latency_s for share in dark])
    cores = f"a million on {workers} cores"
    return PAGE.format(
        times=list(times.values()),
        grown=max(share.peak_mib[-1] - share.peak_mib[0] for share in dark),
        workers=workers,
        table=markdown_table(
            (
                *("scene", "runs", "detections", "processor ms a run", cores),
                "memory, MiB, after each quarter",
            ),
            lines,
        ),
        start=", ".join(f"{shares[0].first_s:.1f} s" for shares in results.values()),
        runs=len(latency_s),
        errors=markdown_table(("runs", "error, ms", "σ/√n, ms"), block_errors(latency_s)),
        million_us=1e6 * float(np.nanstd(latency_s)) / MILLION**0.5,
    )


def main():
    """Measure all scenes, print the page, and write it where asked."""
    options = options_of(__doc__, runs=20_000, workers=2)
    text = page({case: shares_of(case, options.runs, options.workers) for case in CASES})
    print(text)
    if options.write:
        (options.write / "replicates.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
