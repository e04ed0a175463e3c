"""Replicates of one launch: how many in an hour, with what memory, and how the error of their mean
falls.

    python benchmarks/replicates.py --runs 20000 --workers 2 --write docs/benchmarks

Replicate k has the seed of the scene plus k. Each worker compiles the scene once and runs its own
share of them.
"""

import argparse
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
from attrs import evolve
from figures import keep

import opir_core as opir

SCENE = Path(__file__).parents[1] / "examples" / "first_light.yaml"
SCENES = {
    "first_light": (),
    "first_light, snr in the air": (
        "detection=snr",
        "classification=paper",
        "atmosphere=lowtran",
        "sensors[0].model=SBIRS-GEO",
        "sensors[0].scan_period_ms=280",
    ),
}
MILLION = 1_000_000
HOUR_S = 3600.0
#: Parts of a worker's runs after which its memory is taken.
PARTS = 4
#: Numbers of runs whose means are compared with the mean of all.
NUMBERS = (10, 100, 1000)

PAGE = """# Replicates of one launch

How long do a million replicates of one launch take, and how exact is what they say?

{answer}

| scene | runs | detections | processor ms a run | a million on {workers} cores, min | memory, MiB, after each quarter |
|---|---|---|---|---|---|
{rows}

Processor time of each worker, compiling included, over its runs; a million is that rate times a million: this page runs
fewer. Memory is the peak of a worker after each quarter of its runs.

## Error against the number of runs

The mean latency of the first detection of `first_light`: the root mean square, over blocks of equally many runs, of the
difference between the block's mean and the mean of all {runs} runs; beside it σ/√n, with the σ of single runs.

| runs | error, ms | σ/√n, ms |
|---|---|---|
{errors}

A million runs would give the mean to {million_us:.1f} µs.
"""


class Share(NamedTuple):
    """What a worker found: latencies, s, detections a run, processor time, s, and peaks of memory,
    MiB.
    """

    latency_s: np.ndarray
    detections: float
    processor_s: float
    peak_mib: list[float]


def share(overrides: tuple[str, ...], first: int, runs: int) -> Share:
    """Run some replicates."""
    start = time.process_time()
    scene = opir.load_scene(SCENE, overrides=overrides)
    latency_s = np.full(runs, np.nan)
    detections = 0
    peak_mib = list[float]()
    for number, run in enumerate(opir.replicates(evolve(scene, seed=scene.seed + first), runs)):
        found = run.detections
        detections += len(found)
        if len(found):
            latency_s[number] = found.time_ns[0] * 1e-9 - run.plan.targets.ignition_s[0]
        if (number + 1) * PARTS % runs < PARTS:
            peak_mib.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
    return Share(latency_s, detections / runs, time.process_time() - start, peak_mib)


def measured(overrides: tuple[str, ...], runs: int, workers: int) -> list[Share]:
    """Return the shares of all workers."""
    each = runs // workers
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        parts = [pool.submit(share, overrides, number * each, each) for number in range(workers)]
        return [part.result() for part in parts]


def block_errors(latency_s: np.ndarray) -> list[tuple[int, float, float]]:
    """Return numbers of runs, root-mean-square errors of their means, s, and σ/√n, s."""
    known = latency_s[np.isfinite(latency_s)]
    rows = []
    for number in NUMBERS:
        blocks = len(known) // number
        if blocks < 2:
            continue
        means = known[: blocks * number].reshape(blocks, number).mean(axis=1)
        rows.append(
            (
                number,
                float(np.sqrt(np.mean((means - known.mean()) ** 2))),
                float(known.std() / number**0.5),
            )
        )
    return rows


def main() -> None:
    """Measure all scenes, print the page, and write it where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", type=Path)
    chosen = parser.parse_args()
    rows = []
    first = None
    for name, overrides in SCENES.items():
        parts = measured(overrides, chosen.runs, chosen.workers)
        runs = sum(len(part.latency_s) for part in parts)
        spent_s = sum(part.processor_s for part in parts) / runs
        first = first or (parts, spent_s)
        peaks = ", ".join(
            f"{max(each):.0f}" for each in zip(*(part.peak_mib for part in parts), strict=True)
        )
        minutes = spent_s * MILLION / chosen.workers / 60.0
        rows.append(
            f"| {name} | {runs} | {parts[0].detections:.0f} | {1e3 * spent_s:.2f} | {minutes:.0f} |"
            f" {peaks} |"
        )
        keep(f"{name}: a run", 1e3 * spent_s, "ms")
        keep(
            f"{name}: memory after all over that after a quarter",
            parts[0].peak_mib[-1] / parts[0].peak_mib[0],
        )
    assert first is not None
    latency_s = np.concatenate([part.latency_s for part in first[0]])
    hours = first[1] * MILLION / chosen.workers / HOUR_S
    grown = max(part.peak_mib[-1] - part.peak_mib[0] for part in first[0])
    page = PAGE.format(
        answer=f"At the rate of this page a million replicates of `first_light` take"
        f" {60.0 * hours:.0f} minutes on"
        f" {chosen.workers} cores.\nFrom the first quarter of its runs to the last a worker grows"
        f" by {grown:.1f} MiB.",
        workers=chosen.workers,
        rows="\n".join(rows),
        runs=len(latency_s),
        errors="\n".join(
            f"| {n} | {1e3 * off:.2f} | {1e3 * due:.2f} |"
            for n, off, due in block_errors(latency_s)
        ),
        million_us=1e6 * float(np.nanstd(latency_s)) / MILLION**0.5,
    )
    print(page)
    if chosen.write:
        (chosen.write / "replicates.md").write_text(page.rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
