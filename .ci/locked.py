"""Write constraints.txt anew, the versions of all that any extra brings, and locked.txt, the digests of what opir runs
with.

Needs uv. Versions in constraints.txt stay; remove a line there to get the newest.
"""

import subprocess
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
HEAD = (
    "# Versions that the project is tested with, of all that any of its extras brings; .ci/locked.py"
    " writes them.\n# Every dependency works from the lower bound in pyproject.toml on.\n"
)
#: What builds wheels and environments in .ci/run.
TOOLS = ("setuptools", "uv")


def requirements(*, with_extras: bool) -> str:
    """Return opir's distributions, a line each."""
    lines = []
    for folder in (ROOT, *sorted((ROOT / "plugins").glob("opir_*"))):
        project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        extras = sorted(project.get("optional-dependencies", {})) if with_extras else []
        names = f"[{','.join(extras)}]" if extras else ""
        lines.append(f"{project['name']}{names} @ {folder.as_uri()}")
    return "\n".join([*lines, *(TOOLS if with_extras else ())])


def compiled(text: str, *options: str) -> list[str]:
    """Return the lines of the closure of requirements, for all systems, without opir's own."""
    command = ["uv", "pip", "compile", "-", "--universal", "--python-version", "3.11"]
    command += ["--constraint", "constraints.txt", "--no-header", "--no-annotate", *options]
    run = subprocess.run(
        command, cwd=ROOT, input=text, stdout=subprocess.PIPE, text=True, check=True
    )
    return [line for line in run.stdout.splitlines() if "file://" not in line]


if __name__ == "__main__":
    everything = sorted(compiled(requirements(with_extras=True)), key=str.lower)
    (ROOT / "constraints.txt").write_text(HEAD + "\n".join(everything) + "\n", encoding="utf-8")
    locked = compiled(requirements(with_extras=False), "--generate-hashes")
    (ROOT / "locked.txt").write_text("\n".join(locked) + "\n", encoding="utf-8")
