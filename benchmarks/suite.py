"""Runs benchmarks in turn, each in a process of its own, and keeps their figures."""

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from attrs import frozen

from benchmarks.figures import Figures, figures_in, kept_figures

#: Numerical libraries with one thread: times are those of one core.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@frozen
class Attempt:
    """One run of a benchmark: cost of the process, figures, and why it failed (else empty)."""

    wall_s: float
    processor_s: float
    peak_mib: float
    figures: Figures
    problem: str
    output: str


def attempt(benchmark, *, quick, docs=None):
    """Run a benchmark; copy the files that it writes into `docs`, if given."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place, "written")
        folder.mkdir()
        figure_file = Path(place, "figures")
        log = Path(place, "output.log")
        command = [sys.executable, *benchmark.arguments(quick=quick, folder=folder)]
        settings = {**os.environ, **ONE_THREAD, "OPIR_BENCHMARK_FIGURES": str(figure_file)}
        start = time.perf_counter()
        with log.open("wb") as output:
            process = subprocess.Popen(command, env=settings, stdout=output, stderr=output)
            _, status, usage = os.wait4(process.pid, 0)
        process.returncode = code = os.waitstatus_to_exitcode(status)
        text = log.read_text(encoding="utf-8", errors="replace")
        figures = figures_in(folder) | kept_figures(figure_file)
        if quick and benchmark.judges and figures and code == 1:
            code = 0
        if docs and not code:
            shutil.copytree(folder, docs / benchmark.pages, dirs_exist_ok=True)
        last_line = (text.strip().splitlines() or ["no output"])[-1]
        return Attempt(
            wall_s=time.perf_counter() - start,
            processor_s=usage.ru_utime + usage.ru_stime,
            peak_mib=usage.ru_maxrss / 1024,
            figures=figures,
            problem=f"exit code {code}: {last_line}" if code else "",
            output=text,
        )


def rounds_of(benchmarks, rounds, *, quick, docs=None):
    """Yield every benchmark once a round: so a slow spell of the machine falls on all alike."""
    for _ in range(rounds):
        for benchmark in benchmarks:
            yield benchmark, attempt(benchmark, quick=quick, docs=docs)


def summary(benchmark, attempts):
    """Return medians over attempts, and the peers that are not installed."""
    return {
        "question": benchmark.question,
        "command": " ".join([benchmark.script, *benchmark.full]),
        "runs": len(attempts),
        "problem": next((run.problem for run in attempts if run.problem), ""),
        "peers_left_out": benchmark.absent_peers(),
        **{
            name: statistics.median(getattr(run, name) for run in attempts)
            for name in ("wall_s", "processor_s", "peak_mib")
        },
        "figures": {
            name: statistics.median(run.figures[name] for run in attempts if name in run.figures)
            for name in attempts[0].figures
        },
    }
