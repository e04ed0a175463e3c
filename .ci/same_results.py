"""Compare the events that two Python environments make of the same scenes; write what differs to
standard output.

    python .ci/same_results.py [--without-simd] PYTHON OTHER_PYTHON [SCENE ...]

Ids, times, sensors, types, bands and everything else that is no measured or estimated number must
be equal, in the same order; numbers must be equal to the tolerances that
docs/reference/reproducibility.md states. Exits with 1 if not. Both interpreters need opir and its
plugins. Without scenes: two examples, and launches with `detection: snr`, a tracker and a spectral
classifier. With `--without-simd` the other interpreter computes as on a processor without AVX:
NumPy's own loops, and the kernels of OpenBLAS.
"""

import json
import math
import os
import platform
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from itertools import zip_longest
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]

SCENES = ("examples/photons.yaml", "examples/first_light.yaml", ".ci/tracked_launches.yaml")

#: Keys of what sensors measure, and the largest differences of numbers by unit: two of the last
#: digit of an event.
MEASURED = {
    "azimuth_deg",
    "elevation_deg",
    "line_of_sight_sigma_urad",
    "snr",
    "sensor_position_ecef_m",
}
MEASURED_TOLERANCE = {"_deg": 2.1e-9, "_m": 2.1e-3, "": 2.1e-2}

#: Largest differences of what trackers and classifiers estimate: angles and probabilities, two of
#: the last digit of an event; lengths, times (texts too).
ESTIMATED_TOLERANCE = {"_deg": 2.1e-4, "_m": 0.1, "_s": 1e-3, "": 2.1e-4}

#: Keys of estimated times in texts; those of detections are exact.
ESTIMATED_TIMES = {"time"}

#: The oldest kernels of OpenBLAS by machine
#: (https://github.com/OpenMathLib/OpenBLAS/blob/develop/TargetList.txt).
OLD_CORES = {"x86_64": "Prescott", "AMD64": "Prescott", "aarch64": "ARMV8", "arm64": "ARMV8"}

#: Differences printed for each scene.
SHOWN = 5

#: One difference: the key, both values, and its size over the tolerance; infinite if the values
#: must be equal.
Difference = tuple[str, Any, Any, float]


def main(first: str, other: str, *scenes: str, without_simd: bool = False) -> int:
    """Run and compare all scenes; return the number of those that differ."""
    failed = 0
    variables = simd_disabled(other) if without_simd else {}
    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(2) as pool:
        for scene in scenes or SCENES:
            one, two = (Path(place) / name for name in ("first.jsonl", "other.jsonl"))
            runs = [
                pool.submit(run, first, ROOT / scene, one),
                pool.submit(run, other, ROOT / scene, two, **variables),
            ]
            for ended in runs:
                ended.result()
            failed += not same(scene, one, two)
    return failed


def run(python: str, scene: Path, path: Path, **variables: str) -> None:
    """Write the events of a scene, computed by an interpreter, to a file."""
    line = [python, "-m", "opir_core", "run", str(scene), "--quiet", "--out", str(path)]
    environment = {**os.environ, "PYTHONHASHSEED": "random", **variables}
    subprocess.run(line, check=True, cwd=path.parent, env=environment)


def simd_disabled(python: str) -> dict[str, str]:
    """Return the environment variables that disable the SIMD code of NumPy beyond its baseline, and
    of its OpenBLAS.
    """
    line = [
        python,
        "-c",
        "import numpy; print(*numpy.show_config(mode='dicts')['SIMD Extensions']['found'])",
    ]
    features = subprocess.run(line, check=True, capture_output=True, text=True).stdout.strip()
    return {
        "NPY_DISABLE_CPU_FEATURES": features,
        "OPENBLAS_CORETYPE": OLD_CORES.get(platform.machine(), ""),
    }


def same(scene: str, first: Path, other: Path) -> bool:
    """Return whether two files of events agree; print how they differ."""
    events = 0
    changed = Counter[str]()
    worst = dict[str, Difference]()
    failures = list[str]()
    with first.open(encoding="utf-8") as lines, other.open(encoding="utf-8") as other_lines:
        for number, (line, other_line) in enumerate(
            zip_longest(lines, other_lines, fillvalue="null"), 1
        ):
            events = number
            if line == other_line:
                continue
            for difference in differences("", json.loads(line), json.loads(other_line), {}):
                key, value, other_value, size = difference
                changed[key] += 1
                worst[key] = max(worst.get(key, difference), difference, key=lambda one: one[3])
                if size > 1.0 and len(failures) < SHOWN:
                    failures.append(f"  event {number}: {key} is {value}, and {other_value}")
    verdict = "DIFFERS" if failures else "same"
    report = [
        f"{scene}: {verdict} ({events} events, {sum(changed.values())} values in other digits)"
    ]
    most = changed.most_common()
    report += [
        f"  {key}: {times} times, at most {worst[key][3]:.2g} of the tolerance"
        for key, times in most
    ]
    sys.stdout.writelines(f"{line}\n" for line in report + failures)
    return not failures


def differences(key: str, value: Any, other: Any, holder: dict[str, Any]) -> Iterator[Difference]:
    """Yield all differences of two values of a key of a mapping."""
    if isinstance(value, dict) and isinstance(other, dict):
        for name in {**value, **other}:
            inner, other_inner = (part.get(name, "absent") for part in (value, other))
            yield from differences(f"{key}.{name}" if key else name, inner, other_inner, value)
    elif isinstance(value, list) and isinstance(other, list) and len(value) == len(other):
        for inner, other_inner in zip(value, other, strict=True):
            yield from differences(key, inner, other_inner, holder)
    elif value != other:
        yield key, value, other, size(key, value, other, holder)


def size(key: str, value: Any, other: Any, holder: dict[str, Any]) -> float:
    """Return the difference of two values over its tolerance; infinite if the values must be
    equal.
    """
    name = key.rpartition(".")[2]
    if name in ESTIMATED_TIMES and isinstance(value, str) and isinstance(other, str):
        apart = datetime.fromisoformat(value) - datetime.fromisoformat(other)
        return abs(apart.total_seconds()) / ESTIMATED_TOLERANCE["_s"]
    if not (isinstance(value, float) and isinstance(other, float)):
        return math.inf
    if name == "bearing_deg":
        # The bearing of a circle is arbitrary: the outline counts.
        apart_m = holder["semi_major_m"] - holder["semi_minor_m"]
        return abs(math.sin(math.radians(value - other))) * apart_m / ESTIMATED_TOLERANCE["_m"]
    tolerance = MEASURED_TOLERANCE if name in MEASURED else ESTIMATED_TOLERANCE
    return abs(value - other) / next(
        most for unit, most in tolerance.items() if name.endswith(unit)
    )


if __name__ == "__main__":
    arguments = [argument for argument in sys.argv[1:] if argument != "--without-simd"]
    sys.exit(1 if main(*arguments, without_simd="--without-simd" in sys.argv) else 0)
