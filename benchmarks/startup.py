"""What does starting cost: processor time and modules of a few commands, above bare Python?"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from figures import keep
from pages import options_of

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "first_light.yaml"
COMMANDS = {
    "bare python": ["-c", "pass"],
    "import numpy": ["-c", "import numpy"],
    "opir --version": ["-m", "opir_core", "--version"],
    "opir plugins": ["-m", "opir_core", "plugins"],
    "opir run first_light": ["-m", "opir_core", "run", str(EXAMPLE)],
}


def process_s(command, folder):
    """Return the processor time of a whole process in a folder."""
    before = os.times()
    subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    after = os.times()
    used = after.children_user + after.children_system
    return used - before.children_user - before.children_system


def modules(arguments, folder):
    """Return the number of modules that a process imports."""
    command = [sys.executable, "-X", "importtime", *arguments]
    process = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    return process.stderr.count("import time:") - 1


def main():
    """Measure in turn, so that a slow spell of the machine meets all alike, and print medians."""
    repeat = options_of(__doc__, repeat=9).repeat
    with tempfile.TemporaryDirectory() as folder:
        turns = [
            [process_s([sys.executable, *words], folder) for words in COMMANDS.values()]
            for _ in range(repeat)
        ]
        medians = [sorted(times)[repeat // 2] for times in zip(*turns, strict=True)]
        print(f"{'':22} {'ms':>7} {'over bare':>10} {'modules':>8}")
        for (name, words), taken_s in zip(COMMANDS.items(), medians, strict=True):
            over_ms = (taken_s - medians[0]) * 1e3
            imported = modules(words, folder)
            print(f"{name:22} {taken_s * 1e3:7.0f} {over_ms:+10.0f} {imported:8d}")
            keep(name, taken_s * 1e3, "ms")
            keep(name, imported, "modules")


if __name__ == "__main__":
    main()
