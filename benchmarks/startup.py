"""What starting costs: processor time and modules of whole processes of a few commands, over bare
Python.

python benchmarks/startup.py [--repeat 9]
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage

from figures import keep

ROOT = Path(__file__).resolve().parent.parent
COMMANDS = {
    "bare python": ["-c", "pass"],
    "import numpy": ["-c", "import numpy"],
    "opir --version": ["-m", "opir_core", "--version"],
    "opir plugins": ["-m", "opir_core", "plugins"],
    "opir run first_light": ["-m", "opir_core", "run", str(ROOT / "examples" / "first_light.yaml")],
}


def seconds(arguments: list[str], folder: str) -> float:
    """Return the processor time of one process, of the user and the system."""
    before = getrusage(RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    after = getrusage(RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def modules(arguments: list[str], folder: str) -> int:
    """Return how many modules a process imports."""
    done = subprocess.run(
        [sys.executable, "-X", "importtime", *arguments],
        cwd=folder,
        check=True,
        capture_output=True,
        text=True,
    )
    return sum(line.startswith("import time:") for line in done.stderr.splitlines()) - 1


def main() -> None:
    """Measure in turn, so that a slow spell of the machine meets all alike, and print medians."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--repeat", type=int, default=9)
    repeat = parser.parse_args().repeat
    with tempfile.TemporaryDirectory() as folder:
        times = {name: [] for name in COMMANDS}
        for _ in range(repeat):
            for name, arguments in COMMANDS.items():
                times[name].append(seconds(arguments, folder))
        bare = statistics.median(times["bare python"])
        print(f"{'':22} {'ms':>7} {'over bare':>10} {'modules':>8}")
        for name, arguments in COMMANDS.items():
            taken = statistics.median(times[name])
            imported = modules(arguments, folder)
            print(f"{name:22} {taken * 1e3:7.0f} {(taken - bare) * 1e3:+10.0f} {imported:8d}")
            keep(name, taken * 1e3, "ms")
            keep(name, imported, "modules")


if __name__ == "__main__":
    main()
