"""Whether this environment can judge mutants: the libraries that tests import, and this checkout,
editable.
"""

import json
import subprocess
import sys
from pathlib import Path

import peer_libraries

INSTALL = "Install this checkout, editable, with the libraries that its tests import: make install"
#: Where Python finds each package; null if it is not installed.
ORIGINS = """
import json, sys
from importlib.util import find_spec
found = {name: find_spec(name) for name in sys.argv[1:]}
print(json.dumps({name: spec and spec.origin for name, spec in found.items()}))
"""


class UnfitEnvironment(SystemExit):
    """The unmutated tests fail here, so that every mutant would look killed."""

    def __init__(self, reason):
        super().__init__(f"Mutants cannot be judged in this environment: {reason}\n{INSTALL}")


def packages_of(files):
    """Return the packages of modules (paths relative to the root of the checkout)."""
    paths = [Path(file).parts for file in files]
    return sorted({names[2] if names[0] == "plugins" else names[0] for names in paths})


def check_libraries():
    """Raise `UnfitEnvironment` if a library of the extra `peers` is missing."""
    if missing := sorted(peer_libraries.missing()):
        raise UnfitEnvironment(f"the extra `peers` is missing: {', '.join(missing)}.")


def check_installation(root, packages, variables=None):
    """Raise `UnfitEnvironment` if packages are not imported from below `root`.

    Without `variables`, as they are installed; with them, as a process with these variables imports
    them.
    """
    settings = {
        "env": variables,
        "capture_output": True,
        "text": True,
        "check": True,
    }
    isolated = [] if variables else ["-I"]
    done = subprocess.run(
        [sys.executable, *isolated, "-c", ORIGINS, *packages], cwd=root / "tests", **settings
    )
    origins = json.loads(done.stdout)
    elsewhere = {
        name: at
        for name, at in origins.items()
        if not (at and Path(at).resolve().is_relative_to(root))
    }
    if elsewhere:
        (name, at), *others = elsewhere.items()
        more = f" and {len(others)} more packages" if others else ""
        raise UnfitEnvironment(f"not imported from {root}: {name} ({at or 'not installed'}){more}.")
