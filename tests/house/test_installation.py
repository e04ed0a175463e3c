"""What messages and pages say about installing this project: nothing of it is on a package
index.
"""

import re
import tomllib

import pytest
from repository import ROOT

from opir_core.errors import install_command

PROJECTS = [ROOT / "pyproject.toml", *sorted((ROOT / "plugins").glob("*/pyproject.toml"))]
FILES = sorted(
    path
    for folder in ("opir_core", "plugins", "docs", "examples", "benchmarks")
    for path in (ROOT / folder).rglob("*")
    if "build" not in path.parts
    and path.suffix in {".py", ".md", ".js", ".html", ".json", ".yaml", ".toml"}
)

#: A name of this project as an index would be asked for it: "install opir-kafka", "pip install -q
#: 'opir-core[sgp4]'".
FROM_AN_INDEX = re.compile(r"""\binstall(?:\s+-\S+)*\s+["'`]?opir[-_]\w""")


def test_nothing_is_installed_by_a_name_that_anybody_may_register():
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *FILES]
    result = [
        f"{path.relative_to(ROOT)}: {match.group()}"
        for path in pages
        for match in FROM_AN_INDEX.finditer(path.read_text(encoding="utf-8", errors="replace"))
    ]
    assert not result


@pytest.mark.parametrize("path", PROJECTS, ids=lambda path: path.parent.name)
def test_the_command_names_the_folder_and_extras_of_each_distribution(path):
    project = tomllib.loads(path.read_text(encoding="utf-8"))["project"]
    for extra in ("", *project.get("optional-dependencies", {})):
        place = install_command(project["name"], extra).removeprefix(
            "from a clone of opir: python -m pip install "
        )
        *needed, place = place.split()
        folder = place.strip("'").partition("[")[0]
        assert all((ROOT / each / "pyproject.toml").is_file() for each in needed)
        assert (ROOT / folder).resolve() == path.parent


@pytest.mark.parametrize("path", PROJECTS, ids=lambda path: path.parent.name)
def test_each_distribution_carries_the_licence(path):
    project = tomllib.loads(path.read_text(encoding="utf-8"))["project"]
    assert project["license-files"] == ["LICENSE"]
    assert (path.parent / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
