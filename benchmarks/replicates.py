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
#: Light: how it is seen, and by what classifier, is then chosen by the defaults.
AIR = ("detection=auto", "atmosphere=lowtran")
SBIRS = (*AIR, "sensors[0].model=SBIRS-GEO")


class Case(NamedTuple):
    """A scene: its name, what differs from the file, and the share of the runs that it gets."""

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
HOUR_S = 3600.0
#: Parts of a worker's runs after which its memory is taken.
PARTS = 4
#: Numbers of runs whose means are compared with the mean of all.
NUMBERS = (10, 100, 1000)

PAGE = """# Replicates of one launch

How long do a million replicates of one launch take, and how exact is what they say?

{answer}

| scene | runs | detections | processor ms a run | a million on {workers} cores | memory, MiB, after each quarter |
|---|---|---|---|---|---|
{rows}

DSP looks every 200 ms without light, every 10 s with it; SBIRS-GEO looks every 100 ms, and the default classifier,
which works from measured irradiances, weighs each detection. `classification: paper` draws the type from a confusion
matrix: what the default costs is the row above it. A million is the processor time of a run times a million: this page
runs fewer. The first run of a worker, which compiles the scene and trains the classifier, is not counted: it takes
{start}. Memory is the peak of a worker after each quarter of its runs.

## Error against the number of runs

The mean latency of the first detection of `first_light`, without light: the root mean square, over blocks of equally
many runs, of the difference between the block's mean and the mean of all {runs} runs; beside it σ/√n, with the σ of
single runs.

| runs | error, ms | σ/√n, ms |
|---|---|---|
{errors}

A million runs would give the mean to {million_us:.1f} µs.
"""


class Share(NamedTuple):
    """What a worker found: latencies, s, detections a run, processor time of the first run and of
    each later one, s, and peaks of memory, MiB.
    """

    latency_s: np.ndarray
    detections: float
    first_s: float
    later_s: float
    peak_mib: list[float]


def share(overrides: tuple[str, ...], first: int, runs: int) -> Share:
    """Run some replicates."""
    start = time.process_time()
    scene = opir.load_scene(SCENE, overrides=overrides)
    latency_s = np.full(runs, np.nan)
    detections = 0
    first_s = 0.0
    peak_mib = list[float]()
    for number, run in enumerate(opir.replicates(evolve(scene, seed=scene.seed + first), runs)):
        found = run.detections
        detections += len(found)
        if len(found):
            latency_s[number] = found.time_ns[0] * 1e-9 - run.plan.targets.ignition_s[0]
        if number == 0:
            first_s = time.process_time() - start
        if (number + 1) * PARTS % runs < PARTS:
            peak_mib.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
    later_s = (time.process_time() - start - first_s) / (runs - 1)
    return Share(latency_s, detections / runs, first_s, later_s, peak_mib)


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


def duration(seconds: float) -> str:
    """Return a duration as the page writes it."""
    return f"{seconds / 60.0:.0f} min" if seconds < 2.0 * HOUR_S else f"{seconds / HOUR_S:.1f} h"


def table_row(case: Case, parts: list[Share], million_s: float) -> str:
    """Return the line of a scene."""
    later_ms = 1e3 * np.mean([part.later_s for part in parts])
    runs = sum(len(part.latency_s) for part in parts)
    peaks = zip(*(part.peak_mib for part in parts), strict=True)
    memory = ", ".join(f"{max(each):.0f}" for each in peaks)
    return (
        f"| {case.name} | {runs} | {parts[0].detections:.0f} | {later_ms:.2f} |"
        f" {duration(million_s)} | {memory} |"
    )


def main() -> None:
    """Measure all scenes, print the page, and write it where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20_000, help="of the scene without light")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", type=Path)
    chosen = parser.parse_args()
    found = {}
    for case in CASES:
        parts = measured(case.overrides, round(case.share * chosen.runs), chosen.workers)
        later_s = float(np.mean([part.later_s for part in parts]))
        found[case] = (parts, later_s * MILLION / chosen.workers)
        keep(f"{case.name}: a run", 1e3 * later_s, "ms")
        keep(
            f"{case.name}: memory after all over that after a quarter",
            parts[0].peak_mib[-1] / parts[0].peak_mib[0],
        )
    dark, air, sbirs, paper = (million_s for _, million_s in found.values())
    shipped = found[CASES[0]][0]
    latency_s = np.concatenate([part.latency_s for part in shipped])
    grown = max(part.peak_mib[-1] - part.peak_mib[0] for part in shipped)
    page = PAGE.format(
        answer=f"With default settings a million replicates of `first_light` in the air take"
        f" {duration(air)} on {chosen.workers} cores with DSP,\n{duration(sbirs)} with SBIRS-GEO"
        f" ({duration(paper)} with `classification: paper`); without light, as the file has it,"
        f" {duration(dark)}.\nFrom the first quarter of its runs to the last a worker grows by"
        f" {grown:.1f} MiB.",
        workers=chosen.workers,
        rows="\n".join(table_row(case, *of_case) for case, of_case in found.items()),
        start=", ".join(f"{parts[0].first_s:.1f} s" for parts, _ in found.values()),
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
