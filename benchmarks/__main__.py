"""All benchmarks in one run: results as JSON, compared with those of another run.

Each benchmark runs in a process of its own, one after the other, `--rounds` times in turn; figures
are medians. Benchmarks whose requirements are not installed are left out and named. `--quick` takes
small sizes: to see that everything works, never for times.
"""

import argparse
import json
import sys
from difflib import get_close_matches
from pathlib import Path

from benchmarks.figures import ratios
from benchmarks.machine import machine
from benchmarks.registry import BENCHMARKS
from benchmarks.suite import rounds_of, summary

#: Figures within this factor of the stored ones are counted, not shown.
ALIKE = 1.1


def selected(names):
    """Return the benchmarks of these names, in the order of the registry; all without names."""
    known = {benchmark.name: benchmark for benchmark in BENCHMARKS}
    for name in names or ():
        if name not in known:
            near = ", ".join(get_close_matches(name, known)) or "see --list"
            raise SystemExit(f"there is no benchmark {name!r}: {near}")
    return [benchmark for name, benchmark in known.items() if not names or name in names]


def overview():
    """Return the table of all benchmarks."""
    lines = []
    for benchmark in BENCHMARKS:
        notes = [f"needs {name}" for name in benchmark.missing()]
        notes += [f"without {name}" for name in benchmark.absent_peers()]
        note = f"  ({', '.join(notes)})" if notes else ""
        lines.append(f"{benchmark.name:19} {benchmark.question}{note}")
    return "\n".join(lines)


def able_to_run(benchmarks):
    """Yield the benchmarks that can run; print which cannot, and why."""
    for benchmark in benchmarks:
        if missing := list(benchmark.missing()):
            print(f"{benchmark.name}: left out, needs {', '.join(missing)}")
            continue
        if absent := benchmark.absent_peers():
            print(
                f"{benchmark.name}: without {', '.join(absent)} (not installed: the extra"
                " `benchmarks` brings peers)"
            )
        yield benchmark


def results(benchmarks, rounds, *, quick, docs):
    """Run benchmarks, print a line for each run, and return the results."""
    attempts = {benchmark.name: [] for benchmark in benchmarks}
    conditions = {"machine": machine(), "quick": quick}
    for benchmark, run in rounds_of(benchmarks, rounds, quick=quick, docs=docs):
        attempts[benchmark.name].append(run)
        cost = f"{run.processor_s:8.1f} s {run.peak_mib:7.0f} MiB"
        note = run.problem or f"{len(run.figures)} figures"
        print(f"{benchmark.name:19} {cost}  {note}", flush=True)
        if run.problem:
            print(run.output, file=sys.stderr)
    return conditions | {
        "benchmarks": {
            benchmark.name: summary(benchmark, attempts[benchmark.name]) for benchmark in benchmarks
        }
    }


def differences(results, stored):
    """Yield lines on differences from stored results, by benchmark."""
    for name in ("processor", "quick"):
        position, place = ({**run["machine"], **run}[name] for run in (results, stored))
        if position != place:
            yield f"not the same {name}: {position} now, {place} kept"
    for name, result in results["benchmarks"].items():
        reference = stored["benchmarks"].get(name)
        if reference is None:
            yield f"{name}: not among the kept results"
            continue
        process = result["processor_s"] / reference["processor_s"]
        figures = ratios(result["figures"], reference["figures"])
        unlike = {key: ratio for key, ratio in figures.items() if not 1 / ALIKE <= ratio <= ALIKE}
        alike = f"{len(figures) - len(unlike)} of {len(figures)} figures alike"
        yield f"{name}: whole process {process:.2f}; {alike}"
        for key, ratio in unlike.items():
            yield f"  {ratio:8.3f}  {key}: {result['figures'][key]:g}"


def options_of(words):
    """Return the options of the command line."""
    parser = argparse.ArgumentParser("python -m benchmarks", description=__doc__.splitlines()[0])
    option = parser.add_argument
    option("--quick", action="store_true", help="small sizes, one round: not for times")
    option("--only", nargs="+", metavar="NAME", help="these benchmarks")
    option("--list", action="store_true", help="list benchmarks and missing requirements")
    option("--rounds", type=int, metavar="N", help="runs of each (default: 3; --quick: 1)")
    option("--json", type=Path, metavar="OUT", help="keep the results here")
    option("--against", type=Path, metavar="FILE", help="print ratios to results kept earlier")
    option("--write", type=Path, metavar="DOCS", help="write pages and data into this folder")
    return parser.parse_args(words)


def main(words=None):
    """Run the benchmarks; return 1 if one failed."""
    options = options_of(words)
    if options.list:
        print(overview())
        return 0
    stored = json.loads(options.against.read_text("utf-8")) if options.against else None
    rounds = options.rounds or (1 if options.quick else 3)
    benchmarks = list(able_to_run(selected(options.only)))
    outcome = results(benchmarks, rounds, quick=options.quick, docs=options.write)
    if options.json:
        text = json.dumps(outcome, indent=1, ensure_ascii=False)
        options.json.write_text(text + "\n", encoding="utf-8")
    if stored:
        print("\nRatios to the kept results:", *differences(outcome, stored), sep="\n")
    return int(any(result["problem"] for result in outcome["benchmarks"].values()))


if __name__ == "__main__":
    sys.exit(main())
