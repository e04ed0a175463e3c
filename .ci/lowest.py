"""Print pip constraints: the lowest version that each pyproject.toml of this repository allows of
each dependency.

python .ci/lowest.py > lowest.txt
"""

import re
import sys
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
REQUIREMENT = re.compile(r"(?P<name>[\w.-]+)(\[[\w,-]+\])?\s*(?P<bounds>[^;]*)")
TOOLS = ("hypothesis", "pytest", "pytest-timeout", "pytest-xdist")
LOWER = re.compile(r">=\s*(?P<version>[\w.]+)")


def lowest() -> dict[str, str]:
    """Return the lower bound of each requirement by name; if several files bound it, the highest of
    these.
    """
    bounds: dict[str, str] = {}
    for path in (ROOT / "pyproject.toml", *sorted((ROOT / "plugins").glob("*/pyproject.toml"))):
        project = tomllib.loads(path.read_text(encoding="utf-8"))["project"]
        tools = [line for line in extras(project, "test") if line.startswith(TOOLS)]
        for requirement in (
            *project.get("dependencies", ()),
            *extras(project, "sgp4", "compression"),
            *tools,
        ):
            parts = REQUIREMENT.match(requirement)
            lower = LOWER.search(parts["bounds"]) if parts else None
            if parts and lower and not parts["name"].startswith("opir"):
                name = parts["name"].lower()
                bounds[name] = max(bounds.get(name, "0"), lower["version"], key=numbers)
    return bounds


def extras(project: dict[str, Any], *names: str) -> list[str]:
    """Return the requirements of a project's extras."""
    return [
        line for name in names for line in project.get("optional-dependencies", {}).get(name, ())
    ]


def numbers(version: str) -> tuple[int, ...]:
    """Return the numbers of a version, to compare it by."""
    return tuple(int(part) for part in re.findall(r"\d+", version))


if __name__ == "__main__":
    sys.stdout.writelines(f"{name}=={version}\n" for name, version in sorted(lowest().items()))
