"""Packages of npm that tests run, installed once into the cache of this machine."""

import hashlib
import os
import shutil
import subprocess
from pathlib import Path

import pytest


def installed(sources, name):
    """Return the folder with the packages of `package.json` in a folder; skips the test without
    npm.
    """
    if missing := [program for program in ("node", "npm") if shutil.which(program) is None]:
        pytest.skip(f"{name} is left out: there is no {' and no '.join(missing)}")
    package = sources / "package.json"
    mark = hashlib.sha256(package.read_bytes()).hexdigest()[:16]
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    stored = cache / "opir-tests" / f"{sources.name}-{mark}"
    if not (stored / "complete").is_file():
        stored.mkdir(parents=True, exist_ok=True)
        shutil.copy(package, stored)
        words = ["npm", "install", "--ignore-scripts", "--no-audit", "--no-fund"]
        done = subprocess.run(
            words, cwd=stored, capture_output=True, text=True, timeout=300, check=False
        )
        if done.returncode:
            why = done.stderr[-200:]
            pytest.skip(f"{name} is left out: npm does not get the packages: {why}")
        (stored / "complete").touch()
    return stored
