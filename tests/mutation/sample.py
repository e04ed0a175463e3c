"""Draw mutants of opir_core and the plugins, each different in one token, and print those that no
test detects.

`python tests/mutation/sample.py --draws 100 --seed 1 --jobs 2 --out mutants.json`

All tokens that may change are equally likely. Each mutant is made in a copy of the checkout and
meets the quick tests of its folder, then the slow ones, then the other quick tests that import it,
nearest first, and those of the documentation, then the other slow ones. The first test that fails
kills it. So does a hang: a test that does not end within a limit, if it ends within a tenth of it
without the mutant. A mutant survives if no test fails within the time limit of each of the four.

Each test that kills runs again without the mutant. If it fails then too, the environment is
refused: nothing that it says of mutants is true. So is one without the libraries of the extra
`peers`, or where this checkout is not installed editable.
"""

import argparse
import json
import math
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
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from attrs import asdict, evolve, frozen

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from import_distances import distances, imports_of, source_files  # noqa: E402
from mutation_environment import UnfitEnvironment, check_installation, check_libraries, packages_of  # noqa: E402
from one_token_mutants import mutated, sites  # noqa: E402

#: Folders of tests that import the code, and tests of tests/house that run it without an import of
#: their own.
RUNNING = ("core", "plugins", "contracts", "against", "journeys")
DOCUMENTED = ("tests/house/test_documentation.py", "tests/house/test_modelled_pages.py")
PYTEST = ("-q", "-x", "-n", "0", "-p", "no:cacheprovider", "--tb=line", "-rfE")
PROPERTIES = ("--hypothesis-profile=unshrunk", "--hypothesis-seed=0")
#: A mutant may allocate without end. The test that was started last is the one that failed or
#: hangs; beside its name is how long it took.
MOST_BYTES = 16 << 30
LAST_TEST = "last_test.json"
START = f"""
import json, pathlib, resource, sys, time, pytest
resource.setrlimit(resource.RLIMIT_AS, ({MOST_BYTES}, {MOST_BYTES}))
class Watch:
    path = pathlib.Path("{LAST_TEST}").resolve()
    def pytest_runtest_logstart(self, nodeid):
        self.began = time.monotonic()
        self.path.write_text(json.dumps([nodeid, None]))
    def pytest_runtest_logfinish(self, nodeid):
        self.path.write_text(json.dumps([nodeid, time.monotonic() - self.began]))
sys.exit(pytest.main(sys.argv[1:], plugins=[Watch()]))
"""
PASSED = {0, 5}
#: As pytest allows slow tests in tests/conftest.py and others in pyproject.toml.
SLOWER = 600 / 120
#: A hang is a kill if the test ends within this part of its limit without the mutant.
QUICK_PART = 0.1
POLL_S = 0.2
OUT_OF_TIME = "tests left out at the time limit"


@frozen
class Mutant:
    """A change of one token: file, line number, the token and what it becomes, and the line before
    and after.
    """

    file: str
    line: int
    token: str
    choice: str
    before: str
    after: str


@frozen
class Result:
    """What became of a mutant: killed, hang or survived; the test that failed, or how far the tests
    came.
    """

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
    """Tests of a mutant that run together: files, which of their tests by an expression of `-m`,
    and which not.
    """

    files: list[str]
    selected: str
    left_out: tuple[str, ...] = ()
    collected_only: bool = False

    def words(self):
        """Return these tests as arguments of pytest."""
        left_out = (f"--deselect={test}" for test in self.left_out)
        return [
            "-m",
            self.selected,
            *left_out,
            *["--collect-only"] * self.collected_only,
            *self.files,
        ]


@frozen
class Outcome:
    """What tests say: killed, hang or survived; the line that says so; the test started last, and
    its time.

    `test` is empty if none was started, as of files that cannot be collected: `seconds` is then the
    time of all. `seconds` is infinite if the test did not end.
    """

    kind: str
    by: str
    test: str = ""
    seconds: float = math.inf


@frozen
class Work:
    """A mutant to run, its source and its stages."""

    mutant: Mutant
    source: str
    stages: list[Stage]


def main():
    """Draw the mutants, run their tests and print the survivors."""
    options = _arguments()
    check_libraries()
    packages = packages_of(source_files(ROOT))
    check_installation(ROOT, packages)
    limits = Limits(options.test_limit_s, options.limit_s)
    work = _work(options.draws, options.seed, options.deselect)
    results = list[Result]()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(options.jobs) as pool:
        copies = queue.SimpleQueue()
        for job in range(options.jobs):
            copy = _copy(Path(folder, str(job)).resolve())
            check_installation(copy, packages, _variables(copy))
            copies.put(copy)
        running = [pool.submit(_result, task, copies, limits) for task in work]
        for done in as_completed(running):
            results.append(_judged(done, pool))
            print(f"{len(results)}/{len(work)} {_words(results[-1])}", flush=True)
            if options.out:
                options.out.write_text(
                    json.dumps([asdict(result) for result in results], indent=1) + "\n"
                )
    _print_summary(results)


def _arguments():
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--draws", type=int, default=20, help="mutants to draw (default 20)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the draw (default 1)")
    parser.add_argument("--jobs", type=int, default=2, help="mutants at a time (default 2)")
    parser.add_argument(
        "--test-limit-s", type=float, default=90.0, help="a longer test is a hang (default 90)"
    )
    parser.add_argument(
        "--limit-s", type=float, default=240.0, help="time for each stage of tests (default 240)"
    )
    parser.add_argument(
        "--deselect", action="append", default=[], help="a test that fails without a mutant as well"
    )
    parser.add_argument("--out", type=Path, help="write the results to this JSON file")
    return parser.parse_args()


def _work(draws, seed, left_out):
    files = source_files(ROOT)
    tests = [path for folder in RUNNING for path in (ROOT / "tests" / folder).rglob("*.py")]
    processes = [
        str(path.relative_to(ROOT)) for path in [*tests, *(ROOT / "tests" / "support").glob("*.py")]
    ]
    imports = imports_of(ROOT, [*files, *processes])
    drawn = draw({file: (ROOT / file).read_text(encoding="utf-8") for file in files}, draws, seed)
    return [
        Work(mutant, source, stages_of(mutant.file, imports, left_out)) for mutant, source in drawn
    ]


def draw(sources, draws, seed):
    """Return mutants of different tokens of `sources` (by file), all equally likely, with their
    sources.
    """
    rng = random.Random(seed)
    places = [(file, site) for file, source in sources.items() for site in sites(source)]
    selected = rng.sample(places, min(draws, len(places)))
    return [_mutant(file, sources[file], site, rng.choice(site.choices)) for file, site in selected]


def _mutant(file, source, site, choice):
    changed = mutated(source, site, choice)
    lines = (text.split("\n")[site.line - 1].strip() for text in (source, changed))
    return Mutant(file, site.line, source[site.start : site.end], choice, *lines), changed


def stages_of(file, imports, left_out=()):
    """Return the stages of a module's mutants that have files."""
    folder_tests, other_tests = tests_of(file, imports)
    stages = [
        (folder_tests, "not slow"),
        (folder_tests, "slow"),
        ([*other_tests, *DOCUMENTED], "not slow"),
        (other_tests, "slow"),
    ]
    return [Stage(files, selected, tuple(left_out)) for files, selected in stages if files]


def tests_of(file, imports):
    """Return the test files of a module's folder, and the others that import the module; in each,
    the nearest first.
    """
    steps = distances(file, imports)
    users = {test for test in steps if Path(test).name.startswith("test_")}
    folder = mirror(file)
    own = {str(path.relative_to(ROOT)) for path in folder.rglob("test_*.py")} if folder else set()

    def nearness(test):
        return Path(file).stem not in test, steps.get(test, len(imports)), test

    return sorted(own, key=nearness), sorted(users - own, key=nearness)


def mirror(file):
    """Return the folder of tests that mirrors a module's folder, or the nearest one above it."""
    names = Path(file).parts[:-1]
    if names == ("plugins", "opir_testing", "opir_testing", "contracts"):
        return ROOT / "tests" / "contracts"
    top = ("core",) if names[0] == "opir_core" else ("plugins", names[1].removeprefix("opir_"))
    inner = names[1:] if names[0] == "opir_core" else names[3:]
    least = 1 if names[0] == "opir_core" else 0
    folders = (
        Path(ROOT, "tests", *top, *inner[:depth]) for depth in range(len(inner), least - 1, -1)
    )
    return next((folder for folder in folders if folder.is_dir()), None)


def _copy(place):
    """Copy the files that git knows."""
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, place / name)
    return place


def _judged(done, pool):
    """Return the result of a mutant; begin no others if the environment is refused."""
    try:
        return done.result()
    except UnfitEnvironment:
        pool.shutdown(wait=False, cancel_futures=True)
        raise


def _result(work, copies, limits):
    copy = copies.get()
    start = time.monotonic()
    place = copy / work.mutant.file
    original = place.read_text(encoding="utf-8")
    outcome = Outcome("survived", "")
    reported = list[str]()
    try:
        for stage in work.stages:
            _write(place, work.source)
            outcome = _outcome(copy, stage, limits)
            _write(place, original)
            outcome = _confirmed(copy, stage, outcome, limits)
            reported.append(outcome.by)
            if outcome.kind != "survived":
                break
    finally:
        _write(place, original)
        copies.put(copy)
    by = reported[-1] if outcome.kind != "survived" else "; ".join(reported) or "no test imports it"
    return Result(work.mutant, outcome.kind, by, round(time.monotonic() - start, 1))


def _confirmed(copy, stage, outcome, limits):
    """Return the outcome of a stage, or "survived" for a hang of a test that takes its time without
    the mutant too.

    Runs the test again in `copy`, unmutated, or collects the stage's files if none was started.
    Raises `UnfitEnvironment` if that fails.
    """
    if outcome.kind == "survived":
        return outcome
    files = [outcome.test] if outcome.test else stage.files
    second_stage = evolve(stage, files=files, selected="", collected_only=not outcome.test)
    longest = _longest(stage, limits)
    unmutated = _outcome(
        copy, second_stage, evolve(longest, all_s=max(longest.test_s, longest.all_s))
    )
    if unmutated.kind == "killed":
        raise UnfitEnvironment(
            f"this fails without a mutant too (or else leave it out, --deselect): {unmutated.by}"
        )
    if outcome.kind == "hang" and unmutated.seconds > QUICK_PART * longest.test_s:
        test = outcome.test or "collecting the tests"
        return Outcome(
            "survived",
            f"no kill: {test} takes over {QUICK_PART:.0%} of its limit without the mutant too",
        )
    return outcome


def _write(path, source):
    """Write a module, and remove what Python compiled: the size and the second of a change may be
    the same.
    """
    path.write_text(source, encoding="utf-8")
    for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
        compiled.unlink()


def _longest(stage, limits):
    return evolve(limits, test_s=limits.test_s * (SLOWER if stage.selected == "slow" else 1.0))


def _outcome(copy, stage, limits):
    """Return what the tests of a stage say of a copy."""
    output = copy / "output.txt"
    log = copy / LAST_TEST
    log.unlink(missing_ok=True)
    start = time.monotonic()
    with output.open("wb") as stream:
        command = [sys.executable, "-c", START, *PYTEST, *PROPERTIES, *stage.words()]
        settings = {"cwd": copy, "env": _variables(copy), "start_new_session": True}
        process = subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT, **settings)
        stopped = _stopped(process, output, _longest(stage, limits))
    kind, by = stopped or _said(process.returncode, output, stage)
    whole_s = math.inf if stopped else time.monotonic() - start
    test, seconds = json.loads(log.read_text(encoding="utf-8")) if log.exists() else ("", whole_s)
    return Outcome(kind, by, test, math.inf if seconds is None else seconds)


def _said(code, output, stage):
    """Return what tests that have ended say, and the line of the first that failed."""
    lines = output.read_text(encoding="utf-8", errors="replace").split("\n")
    if code in PASSED:
        return "survived", f"all {stage.selected} passed"
    failed = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
    return "killed", (failed or [line for line in lines if line] or ["no output"])[0]


def _variables(copy):
    path = os.pathsep.join(
        [str(copy), *(str(folder) for folder in sorted((copy / "plugins").iterdir()))]
    )
    return {**os.environ, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1", "PYTHONHASHSEED": "0"}


def _stopped(process, output, limits):
    """Wait until the tests end; stop them at a limit and return what that means: silence is a
    hang.
    """
    start = time.monotonic()
    while process.poll() is None:
        silent_s = time.time() - output.stat().st_mtime
        if silent_s > limits.test_s or time.monotonic() - start > limits.all_s:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            hang = silent_s > limits.test_s
            return (
                ("hang", f"no test ended in {limits.test_s:g} s")
                if hang
                else ("survived", OUT_OF_TIME)
            )
        time.sleep(POLL_S)
    return None


def _words(result):
    mutant = result.mutant
    place = f"{result.outcome} {mutant.file}:{mutant.line}"
    if result.outcome == "survived":
        return f"{place} ({result.by})\n  - {mutant.before}\n  + {mutant.after}"
    return f"{place} `{mutant.token}` -> `{mutant.choice}`: {result.by}"


def _print_summary(results):
    counts = Counter(result.outcome for result in results)
    killed = counts["killed"] + counts["hang"]
    print(
        f"\n{killed} of {len(results)} mutants were killed, {counts['hang']} of them by a hang."
        f" Survivors:"
    )
    for result in sorted(results, key=lambda result: (result.mutant.file, result.mutant.line)):
        if result.outcome == "survived":
            print(_words(result))


if __name__ == "__main__":
    main()
