"""Which test files import libraries of the extra `peers`, and which of those libraries are not
installed.

Files are searched as text: an import at the beginning of a line is one of the module itself.
"""

import re
from functools import cache
from importlib.util import find_spec
from pathlib import Path

#: The packages that the distributions of the extra install, as they are imported.
NAMES = (
    "SALib",
    "astropy",
    "axe_playwright_python",
    "boinor",
    "ccsds_ndm",
    "czml3",
    "duckdb",
    "erfa",
    "fastkml",
    "geojson_validator",
    "numba",
    "oem",
    "openapi_python_client",
    "optuna",
    "pandas",
    "playwright",
    "polars",
    "pyproj",
    "schemathesis",
    "scoringrules",
    "shapely",
    "skyfield",
    "xarray",
)
IMPORT = re.compile(r"^(?:import|from) (\w+)", re.MULTILINE)


def imported_by(file):
    """Return the libraries of NAMES that a file of tests imports, itself or through a module of
    tests/support.
    """
    modules = set(IMPORT.findall(file.read_text(encoding="utf-8")))
    return modules.intersection(NAMES).union(*(of_support().get(module, ()) for module in modules))


@cache
def of_support():
    """Return the libraries of NAMES that each module beside this one imports itself."""
    return {
        file.stem: set(IMPORT.findall(file.read_text(encoding="utf-8"))).intersection(NAMES)
        for file in Path(__file__).parent.glob("*.py")
    }


@cache
def missing():
    """Return the libraries of NAMES that cannot be imported here."""
    return frozenset(name for name in NAMES if find_spec(name) is None)
