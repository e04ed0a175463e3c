"""What finding plugins costs: reading metadata files directly, against asking `importlib.metadata`.

Each way is timed in fresh interpreters that have imported what every run imports anyway; medians
are printed. It settled why `opir_core/host/discovery.py` reads directories itself.
"""

import json
import statistics
import subprocess
import sys

ROUNDS = 15

BEFORE = "import sys, time; import numpy, pluggy, attrs, cattrs, yaml, msgspec, argparse, pathlib; "

WAYS = {
    "importlib.metadata": (
        "from importlib.metadata import entry_points; entry_points(group='opir');"
        " entry_points(group='opir.components')"
    ),
    "metadata files": (
        "from opir_core.host.discovery import distributions_with; distributions_with(('opir',"
        " 'opir.components'))"
    ),
}


def cost(way: str) -> tuple[float, int]:
    """Return the time (ms) and the number of modules that one way costs in a fresh interpreter."""
    code = (
        f"{BEFORE}import json; import opir_core.plugin; "
        f"modules = len(sys.modules); start = time.perf_counter(); {way}; "
        "print(json.dumps([(time.perf_counter() - start) * 1e3, len(sys.modules) - modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    milliseconds, modules = json.loads(done.stdout)
    return milliseconds, modules


for name, way in WAYS.items():
    results = [cost(way) for _ in range(ROUNDS)]
    print(
        f"{name}: {statistics.median(time for time, _ in results):.1f} ms, {results[0][1]} modules"
    )
