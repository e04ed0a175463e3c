"""The package of a component: its modules, what importing it costs, and which settings its code
mentions.
"""

import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

#: A plugin module that imports more modules than this, other than those of opir, delays each
#: command; PyYAML and cattrs together are 50, `scipy.special` 230, pandas 400.
MOST_MODULES = 150

_COUNT = """
import sys
import attrs, numpy
from opir_core.plugin import *
before = set(sys.modules)
import {module}
sys.stdout.write("\\n" + " ".join(sorted(set(sys.modules) - before)) + "\\n")
"""


def build_module(component: Any) -> str:
    """Return the name of the module that defines what builds a component."""
    build = component.build
    return str(getattr(getattr(build, "func", build), "__module__", "") or "builtins")


@cache
def foreign_modules(module: str) -> tuple[int, str]:
    """Return how many modules of other packages than opir's importing a module imports, and the
    package of most of them, "" for none.
    """
    done = subprocess.run(
        [sys.executable, "-c", _COUNT.format(module=module)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    words = done.stdout.split("\n")[-2].split()
    roots = [name.partition(".")[0] for name in words if not name.startswith("opir_")]
    return len(roots), max(sorted(set(roots)), key=roots.count, default="")


def is_mentioned(component: Any, setting: str) -> bool:
    """Return whether the package of a component mentions a setting as an attribute of something
    else than `self`, or in a text.
    """
    mention = re.compile(rf"(?<!\bself)\.{setting}\b|[\"']{setting}[\"']")
    roots = {build_module(component), component.config.__module__}
    return any(mention.search(text) for root in roots for text in _texts(root.partition(".")[0]))


@cache
def _texts(package: str) -> tuple[str, ...]:
    """Return the texts of the modules of a package."""
    file = Path(getattr(sys.modules.get(package), "__file__", None) or "-")
    paths = sorted(file.parent.rglob("*.py")) if file.name == "__init__.py" else [file]
    return tuple(path.read_text(encoding="utf-8") for path in paths if path.is_file())
