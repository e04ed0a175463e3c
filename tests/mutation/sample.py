"""Draw mutants of opir_core and the plugins, each different in one token, and print those that no test detects.

`python tests/mutation/sample.py --draws 100 --seed 1 --jobs 2 --out mutants.json`

All tokens that may change are equally likely. Each mutant is made in a copy of the checkout and meets the quick tests
of its folder, then the slow ones, then the other quick tests that import it, nearest first, and those of the
documentation, then the other slow ones. The first test that fails kills it. So does a hang: a test that does not end
within a limit. A mutant survives if no test fails within the time limit of each of the four.
"""

import argparse
import json
import os
import queue
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from attrs import asdict, frozen

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from import_distances import distances, imports_of, source_files  # noqa: E402
from one_token_mutants import Site, mutated, sites  # noqa: E402

#: Folders of tests that import the code, and tests of tests/house that run it without an import of their own.
RUNNING = ("core", "plugins", "contracts", "against", "journeys")
DOCUMENTED = ("tests/house/test_documentation.py", "tests/house/test_modelled_pages.py")
PYTEST = ("-q", "-x", "-n", "0", "-p", "no:cacheprovider", "--tb=line", "-rfE")
PROPERTIES = ("--hypothesis-profile=unshrunk", "--hypothesis-seed=0")
#: A mutant may allocate without end.
MOST_BYTES = 16 << 30
START = f"""
import resource, sys, pytest
resource.setrlimit(resource.RLIMIT_AS, ({MOST_BYTES}, {MOST_BYTES}))
sys.exit(pytest.main(sys.argv[1:]))
"""
PASSED = {0, 5}
#: As pytest allows slow tests in tests/conftest.py and others in pyproject.toml.
SLOWER = 600 / 120
POLL_S = 0.2
OUT_OF_TIME = "tests left out at the time limit"
COPY_TEST = """
import opir_core
def test_copy(): assert opir_core.__file__.startswith({place!r})
"""


@frozen
class Mutant:
    """A change of one token: file, line number, the token and what it becomes, and the line before and after."""

    file: str
    line: int
    token: str
    choice: str
    before: str
    after: str


@frozen
class Result:
    """What became of a mutant: killed, hang or survived; the test that failed, or how far the tests came."""

    mutant: Mutant
    outcome: str
    by: str
    seconds: float


@frozen
class Limits:
    """The time of one test, and that of all tests of a stage."""

    test_s: float
    all_s: float


@frozen
class Stage:
    """Tests of a mutant that run together: files, which of their tests by an expression of `-m`, and which not."""

    files: list[str]
    chosen: str
    left_out: tuple[str, ...] = ()

    def words(self) -> list[str]:
        """Return these tests as arguments of pytest."""
        return ["-m", self.chosen, *(f"--deselect={test}" for test in self.left_out), *self.files]


@frozen
class Work:
    """A mutant to run, its source and its stages."""

    mutant: Mutant
    source: str
    stages: list[Stage]


def main() -> None:
    """Draw the mutants, run their tests and print the survivors."""
    asked = _arguments()
    limits = Limits(asked.test_limit_s, asked.limit_s)
    work = _work(asked.draws, asked.seed, asked.deselect)
    results = list[Result]()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(asked.jobs) as pool:
        copies: queue.SimpleQueue[Path] = queue.SimpleQueue()
        for job in range(asked.jobs):
            copies.put(_checked(_copy(Path(folder, str(job)).resolve()), limits))
        running = [pool.submit(_result, each, copies, limits) for each in work]
        for done in as_completed(running):
            results.append(done.result())
            print(f"{len(results)}/{len(work)} {_words(results[-1])}", flush=True)
            if asked.out:
                asked.out.write_text(json.dumps([asdict(result) for result in results], indent=1) + "\n")
    _print_summary(results)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--draws", type=int, default=20, help="mutants to draw (default 20)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the draw (default 1)")
    parser.add_argument("--jobs", type=int, default=2, help="mutants at a time (default 2)")
    parser.add_argument("--test-limit-s", type=float, default=90.0, help="a longer test is a hang (default 90)")
    parser.add_argument("--limit-s", type=float, default=240.0, help="time for each stage of tests (default 240)")
    parser.add_argument("--deselect", action="append", default=[], help="a test that fails without a mutant as well")
    parser.add_argument("--out", type=Path, help="write the results to this JSON file")
    return parser.parse_args()


def _work(draws: int, seed: int, left_out: Sequence[str]) -> list[Work]:
    files = source_files(ROOT)
    tests = [path for folder in RUNNING for path in (ROOT / "tests" / folder).rglob("*.py")]
    others = [str(path.relative_to(ROOT)) for path in [*tests, *(ROOT / "tests" / "support").glob("*.py")]]
    imports = imports_of(ROOT, [*files, *others])
    drawn = draw({file: (ROOT / file).read_text(encoding="utf-8") for file in files}, draws, seed)
    return [Work(mutant, source, stages_of(mutant.file, imports, left_out)) for mutant, source in drawn]


def draw(sources: dict[str, str], draws: int, seed: int) -> list[tuple[Mutant, str]]:
    """Return mutants of different tokens of `sources` (by file), all equally likely, with their sources."""
    rng = random.Random(seed)
    places = [(file, site) for file, source in sources.items() for site in sites(source)]
    chosen = rng.sample(places, min(draws, len(places)))
    return [_mutant(file, sources[file], site, rng.choice(site.choices)) for file, site in chosen]


def _mutant(file: str, source: str, site: Site, choice: str) -> tuple[Mutant, str]:
    changed = mutated(source, site, choice)
    before, after = (text.split("\n")[site.line - 1].strip() for text in (source, changed))
    return Mutant(file, site.line, source[site.start : site.end], choice, before, after), changed


def stages_of(file: str, imports: dict[str, set[str]], left_out: Sequence[str] = ()) -> list[Stage]:
    """Return the stages of a module's mutants that have files."""
    own, others = tests_of(file, imports)
    stages = [(own, "not slow"), (own, "slow"), ([*others, *DOCUMENTED], "not slow"), (others, "slow")]
    return [Stage(files, chosen, tuple(left_out)) for files, chosen in stages if files]


def tests_of(file: str, imports: dict[str, set[str]]) -> tuple[list[str], list[str]]:
    """Return the test files of a module's folder, and the others that import the module; in each, the nearest first."""
    steps = distances(file, imports)
    users = {test for test in steps if Path(test).name.startswith("test_")}
    folder = mirror(file)
    own = {str(path.relative_to(ROOT)) for path in folder.rglob("test_*.py")} if folder else set()

    def nearness(test: str) -> tuple[bool, int, str]:
        return Path(file).stem not in test, steps.get(test, len(imports)), test

    return sorted(own, key=nearness), sorted(users - own, key=nearness)


def mirror(file: str) -> Path | None:
    """Return the folder of tests that mirrors a module's folder, or the nearest one above it."""
    parts = Path(file).parts[:-1]
    if parts == ("opir_core", "testing", "contracts"):
        return ROOT / "tests" / "contracts"
    top = ("core",) if parts[0] == "opir_core" else ("plugins", parts[1].removeprefix("opir_"))
    inner = parts[1:] if parts[0] == "opir_core" else parts[3:]
    least = 1 if parts[0] == "opir_core" else 0
    folders = (Path(ROOT, "tests", *top, *inner[:depth]) for depth in range(len(inner), least - 1, -1))
    return next((folder for folder in folders if folder.is_dir()), None)


def _copy(place: Path) -> Path:
    """Copy the files that git knows."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, place / name)
    return place


def _checked(copy: Path, limits: Limits) -> Path:
    """Return a copy whose tests run, with its own modules; raise `SystemExit` if they do not."""
    test = copy / "tests" / "core" / "test_copy.py"
    test.write_text(COPY_TEST.format(place=str(copy)))
    outcome, by = _outcome(copy, Stage([str(test)], "not slow"), limits)
    test.unlink()
    if outcome != "survived":
        raise SystemExit(f"the tests do not run in a copy of this checkout: {by}")
    return copy


def _result(work: Work, copies: "queue.SimpleQueue[Path]", limits: Limits) -> Result:
    copy, start = copies.get(), time.monotonic()
    place = copy / work.mutant.file
    original = place.read_text(encoding="utf-8")
    outcome, told = "survived", list[str]()
    try:
        _write(place, work.source)
        for stage in work.stages:
            outcome, by = _outcome(copy, stage, limits)
            told.append(by)
            if outcome != "survived":
                break
    finally:
        _write(place, original)
        copies.put(copy)
    by = told[-1] if outcome != "survived" else "; ".join(told) or "no test imports it"
    return Result(work.mutant, outcome, by, round(time.monotonic() - start, 1))


def _write(path: Path, source: str) -> None:
    """Write a module, and remove what Python compiled: the size and the second of a change may be the same."""
    path.write_text(source, encoding="utf-8")
    for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
        compiled.unlink()


def _outcome(copy: Path, stage: Stage, limits: Limits) -> tuple[str, str]:
    """Return what the tests say of a copy, and the test that failed or how far they came."""
    output = copy / "output.txt"
    with output.open("wb") as stream:
        command = [sys.executable, "-c", START, *PYTEST, *PROPERTIES, *stage.words()]
        settings: dict[str, Any] = {"cwd": copy, "env": _variables(copy), "start_new_session": True}
        process = subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT, **settings)
        longest = Limits(limits.test_s * (SLOWER if stage.chosen == "slow" else 1.0), limits.all_s)
        stopped = _stopped(process, output, longest)
    if stopped:
        return stopped
    lines = output.read_text(encoding="utf-8", errors="replace").split("\n")
    if process.returncode in PASSED:
        return "survived", f"all {stage.chosen} passed"
    failed = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
    return "killed", (failed or [line for line in lines if line] or ["no output"])[0]


def _variables(copy: Path) -> dict[str, str]:
    path = os.pathsep.join([str(copy), *(str(folder) for folder in sorted((copy / "plugins").iterdir()))])
    return {**os.environ, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1", "PYTHONHASHSEED": "0"}


def _stopped(process: "subprocess.Popen[bytes]", output: Path, limits: Limits) -> tuple[str, str] | None:
    """Wait until the tests end; stop them at a limit and return what that means: silence is a hang."""
    start = time.monotonic()
    while process.poll() is None:
        silent_s = time.time() - output.stat().st_mtime
        if silent_s > limits.test_s or time.monotonic() - start > limits.all_s:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            hang = silent_s > limits.test_s
            return ("hang", f"no test ended in {limits.test_s:g} s") if hang else ("survived", OUT_OF_TIME)
        time.sleep(POLL_S)
    return None


def _words(result: Result) -> str:
    mutant = result.mutant
    place = f"{result.outcome} {mutant.file}:{mutant.line}"
    if result.outcome == "survived":
        return f"{place} ({result.by})\n  - {mutant.before}\n  + {mutant.after}"
    return f"{place} `{mutant.token}` -> `{mutant.choice}`: {result.by}"


def _print_summary(results: Sequence[Result]) -> None:
    counts = Counter(result.outcome for result in results)
    killed = counts["killed"] + counts["hang"]
    print(f"\n{killed} of {len(results)} mutants were killed, {counts['hang']} of them by a hang. Survivors:")
    for result in sorted(results, key=lambda result: (result.mutant.file, result.mutant.line)):
        if result.outcome == "survived":
            print(_words(result))


if __name__ == "__main__":
    main()
