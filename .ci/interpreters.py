"""Print the path of a Python interpreter of this machine; nothing if there is none.

    python .ci/interpreters.py newest
    python .ci/interpreters.py oldest

`newest` is the newest release that is newer than the interpreter that runs this, `oldest` one of
the lowest version that pyproject.toml allows. Looked at are the interpreter that runs this,
`python3.N` on the path, the versions of pyenv, and those that uv has installed; it must be a
CPython with a GIL, able to make environments.
"""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

#: Printed by an interpreter if it will do: its path (a shim's is another) and version. Fails
#: without the module `venv`.
QUESTION = """
import ensurepip, sys, sysconfig, venv
is_usual = sys.version_info.releaselevel == "final" and sys.implementation.name == "cpython"
if is_usual and not sysconfig.get_config_var("Py_GIL_DISABLED"):
    print(*sys.version_info[:3], sys.executable)
"""


def candidates() -> Iterator[Path]:
    """Yield the paths of all interpreters, and of some files that are none that works."""
    yield Path(sys.executable)
    for folder in os.get_exec_path():
        yield from (
            path
            for path in Path(folder).glob("python3.*")
            if re.fullmatch(r"python3\.\d+", path.name)
        )
    yield from Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")).glob(
        "versions/*/bin/python3"
    )
    if shutil.which("uv"):
        listed = subprocess.run(
            ["uv", "python", "dir"], capture_output=True, text=True, check=False
        )
        if listed.returncode == 0:
            yield from Path(listed.stdout.strip()).glob("*/bin/python3")


def answer(path: Path) -> tuple[tuple[int, ...], str] | None:
    """Return version and path of an interpreter, None if it does not work or will not do."""
    try:
        asked = subprocess.run(
            [path, "-c", QUESTION], capture_output=True, text=True, check=False, timeout=60
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    *numbers, executable = asked.stdout.strip().split(" ", 3)
    return (tuple(map(int, numbers)), executable) if executable else None


def oldest_allowed() -> tuple[int, ...]:
    """Return the lowest version that pyproject.toml allows, as (3, 11)."""
    required = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "requires-python"
    ]
    return tuple(map(int, required.removeprefix(">=").split(".")))


def chosen(wanted: str) -> str:
    """Return the path of the interpreter that is `newest` or `oldest`, "" if this machine has
    none.
    """
    known = [found for found in map(answer, dict.fromkeys(candidates())) if found]
    if wanted == "newest":
        fitting = [(version, path) for version, path in known if version[:2] > sys.version_info[:2]]
    else:
        fitting = [(version, path) for version, path in known if version[:2] == oldest_allowed()]
    return max(fitting)[1] if fitting else ""


if __name__ == "__main__":
    sys.stdout.write(f"{chosen(sys.argv[1])}\n")
