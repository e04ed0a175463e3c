"""Runs benchmarks in turn, each in a process of its own, and keeps what they find."""

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from attrs import asdict, frozen

from benchmarks.figures import Figures, figures_in, kept_figures
from benchmarks.registry import Benchmark

#: Numerical libraries with one thread: times are those of one core.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@frozen
class Attempt:
    """One run of a benchmark: what its whole process took, what it found, and why it failed (empty
    if it did not).
    """

    wall_s: float
    processor_s: float
    peak_mib: float
    figures: Figures
    problem: str
    output: str


def attempt(benchmark: Benchmark, *, quick: bool, docs: Path | None = None) -> Attempt:
    """Return what one run of a benchmark took and found; what it writes is copied into `docs`, if
    given.
    """
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as own:
        kept = Path(own, "kept.figures")
        log = Path(own, "output.log")
        command = [sys.executable, *benchmark.arguments(quick=quick, folder=Path(folder))]
        settings = {**os.environ, **ONE_THREAD, "OPIR_BENCHMARK_FIGURES": str(kept)}
        start = time.perf_counter()
        with log.open("wb") as output:
            process = subprocess.Popen(
                command, env=settings, stdout=output, stderr=subprocess.STDOUT
            )
            _, status, used = os.wait4(process.pid, 0)
        code = os.waitstatus_to_exitcode(status)
        process.returncode = code
        text = log.read_text(encoding="utf-8", errors="replace")
        figures = figures_in(Path(folder)) | kept_figures(kept)
        if quick and benchmark.judges and figures and code == 1:
            code = 0
        if docs and not code:
            shutil.copytree(folder, docs / benchmark.pages, dirs_exist_ok=True)
        return Attempt(
            wall_s=time.perf_counter() - start,
            processor_s=used.ru_utime + used.ru_stime,
            peak_mib=used.ru_maxrss / 1024,
            figures=figures,
            problem=f"exit code {code}: {last_line(text)}" if code else "",
            output=text,
        )


def last_line(text: str) -> str:
    """Return the last line of an output."""
    return (text.strip().splitlines() or ["no output"])[-1]


def rounds_of(
    benchmarks: Sequence[Benchmark], rounds: int, *, quick: bool, docs: Path | None = None
) -> Iterator[tuple[Benchmark, Attempt]]:
    """Yield every benchmark once a round: so a slow spell of the machine falls on all alike."""
    for _ in range(rounds):
        for benchmark in benchmarks:
            yield benchmark, attempt(benchmark, quick=quick, docs=docs)


def kept(benchmark: Benchmark, attempts: Sequence[Attempt]) -> dict[str, Any]:
    """Return the result of a benchmark: medians over its attempts, and the peers that are not
    installed.
    """
    names = attempts[0].figures
    return {
        "question": benchmark.question,
        "command": " ".join([benchmark.script, *benchmark.full]),
        "runs": len(attempts),
        "problem": next((each.problem for each in attempts if each.problem), ""),
        "peers_left_out": benchmark.absent_peers(),
        **{
            name: statistics.median(asdict(each)[name] for each in attempts)
            for name in ("wall_s", "processor_s", "peak_mib")
        },
        "figures": {
            name: statistics.median(each.figures[name] for each in attempts if name in each.figures)
            for name in names
        },
    }
