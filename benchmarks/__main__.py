"""All benchmarks in one run: results as JSON, compared with those of another run.

    python -m benchmarks [--quick] [--only NAME ...] [--list] [--rounds N] [--json OUT] [--against
    FILE] [--write DOCS]

Each benchmark runs in a process of its own, one after the other, `--rounds` times in turn; figures
are medians. What is not installed is left out and named. `--quick` takes small sizes: to see that
everything works, never for times.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from benchmarks.figures import ratios
from benchmarks.machine import machine
from benchmarks.registry import BENCHMARKS, Benchmark
from benchmarks.suite import Attempt, kept, rounds_of

#: Figures within this factor of the kept ones are counted, not shown.
ALIKE = 1.1


def chosen(names: Sequence[str] | None) -> list[Benchmark]:
    """Return the benchmarks of these names, in the order of the registry; all without names."""
    known = {each.name: each for each in BENCHMARKS}
    for name in names or ():
        if name not in known:
            near = ", ".join(get_close_matches(name, known)) or "see --list"
            raise SystemExit(f"there is no benchmark {name!r}: {near}")
    return [each for each in BENCHMARKS if not names or each.name in names]


def listed() -> str:
    """Return the table of all benchmarks."""
    lines = []
    for each in BENCHMARKS:
        missing = [f"needs {name}" for name in each.missing()] + [
            f"without {name}" for name in each.absent_peers()
        ]
        note = f"  ({', '.join(missing)})" if missing else ""
        lines.append(f"{each.name:19} {each.question}{note}")
    return "\n".join(lines)


def without_those_missing(benchmarks: Sequence[Benchmark]) -> list[Benchmark]:
    """Return the benchmarks that can run, and say which others cannot, and why."""
    for each in benchmarks:
        if missing := list(each.missing()):
            print(f"{each.name}: left out, needs {', '.join(missing)}")
        elif absent := each.absent_peers():
            print(
                f"{each.name}: without {', '.join(absent)} (not installed: the extra `benchmarks`"
                f" brings peers)"
            )
    return [each for each in benchmarks if not list(each.missing())]


def results(
    benchmarks: Sequence[Benchmark], rounds: int, *, quick: bool, docs: Path | None
) -> dict[str, Any]:
    """Run benchmarks, print a line for each, and return what was found."""
    found: dict[str, list[Attempt]] = {each.name: [] for each in benchmarks}
    with_machine: dict[str, Any] = {"machine": machine(), "quick": quick}
    for benchmark, one in rounds_of(benchmarks, rounds, quick=quick, docs=docs):
        found[benchmark.name].append(one)
        note = one.problem or f"{len(one.figures)} figures"
        print(
            f"{benchmark.name:19} {one.processor_s:8.1f} s {one.peak_mib:7.0f} MiB  {note}",
            flush=True,
        )
        if one.problem:
            print(one.output, file=sys.stderr)
    return with_machine | {
        "benchmarks": {each.name: kept(each, found[each.name]) for each in benchmarks}
    }


def compared(now: Mapping[str, Any], then: Mapping[str, Any]) -> Iterator[str]:
    """Yield lines with what differs from kept results, by benchmark."""
    for what in ("processor", "quick"):
        here, there = ({**each["machine"], "quick": each["quick"]}[what] for each in (now, then))
        if here != there:
            yield f"not the same {what}: {here} now, {there} kept"
    for name, each in now["benchmarks"].items():
        other = then["benchmarks"].get(name)
        if other is None:
            yield f"{name}: not among the kept results"
            continue
        whole = ratios({"processor_s": each["processor_s"]}, other)["processor_s"]
        found = ratios(each["figures"], other["figures"])
        unlike = {key: ratio for key, ratio in found.items() if not 1 / ALIKE <= ratio <= ALIKE}
        yield f"{name}: whole process {whole:.2f}; {len(found) - len(unlike)} of {len(found)} figures alike"
        yield from (
            f"  {ratio:8.3f}  {key}: {each['figures'][key]:g}" for key, ratio in unlike.items()
        )


def main(words: Sequence[str] | None = None) -> int:
    """Run what the command line asks for; return 1 if a benchmark failed."""
    parser = argparse.ArgumentParser("python -m benchmarks", description=__doc__.splitlines()[0])
    parser.add_argument(
        "--quick",
        action="store_true",
        help="small sizes, one round: for correctness, not for times",
    )
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these benchmarks")
    parser.add_argument(
        "--list", action="store_true", help="list the benchmarks and what is missing for them"
    )
    parser.add_argument(
        "--rounds", type=int, metavar="N", help="runs of each, in turn (default: 3; --quick: 1)"
    )
    parser.add_argument("--json", type=Path, metavar="OUT", help="keep the results here")
    parser.add_argument(
        "--against", type=Path, metavar="FILE", help="print ratios to results kept earlier"
    )
    parser.add_argument(
        "--write", type=Path, metavar="DOCS", help="write pages, tables and plots into this folder"
    )
    given = parser.parse_args(words)
    if given.list:
        print(listed())
        return 0
    then = json.loads(given.against.read_text("utf-8")) if given.against else None
    ready = without_those_missing(chosen(given.only))
    now = results(
        ready, given.rounds or (1 if given.quick else 3), quick=given.quick, docs=given.write
    )
    if given.json:
        given.json.write_text(
            json.dumps(now, indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
        )
    if then:
        print("\nRatios to the kept results:", *compared(now, then), sep="\n")
    return int(any(each["problem"] for each in now["benchmarks"].values()))


if __name__ == "__main__":
    sys.exit(main())
