"""Conditions of a measurement: processor, load, versions."""

import os
import platform
import subprocess
import time
from importlib.metadata import distributions
from pathlib import Path

#: Distributions whose versions change times or results, beside those of opir.
MEASURED_WITH = frozenset(
    {
        *("aiokafka", "boinor", "dask", "filterpy", "heyoka", "litestar", "matplotlib", "mpmath"),
        *("msgspec", "numba", "numpy", "pyarrow", "pykep", "scipy", "stonesoup", "uvicorn"),
    }
)


def machine():
    """Return the machine and the versions."""
    return {
        "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "processor": processor(),
        "cores": len(os.sched_getaffinity(0)),
        "load": os.getloadavg()[0],
        "system": platform.platform(terse=True),
        "python": platform.python_version(),
        "commit": commit(),
        "versions": versions(),
    }


def versions():
    """Return the versions of opir, its plugins and what it is compared with."""
    installed = {
        distribution.name.lower(): distribution.version for distribution in distributions()
    }
    return {
        name: installed[name]
        for name in sorted(installed)
        if name in MEASURED_WITH or name.startswith("opir-")
    }


def processor():
    """Return the name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())


def commit():
    """Return the commit of the checkout, with a + if it has changes, or nothing."""
    command = ["git", "describe", "--always", "--dirty=+"]
    folder = Path(__file__).parent
    output = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return output.stdout.strip()
