"""What a package imports, its installation brings: scenes run where only the README was
followed.
"""

import ast
import re
import sys
import tomllib
from importlib.metadata import distribution, distributions

import pytest
from packaging.requirements import Requirement
from peer_libraries import NAMES, imported_by
from repository import ROOT

#: Distributions whose packages go by other names.
MODULES = {"pyyaml": "yaml", "opir-core": "opir_core"}

#: Imports by those who install an extra, or run tests: the module that asks for each says so
#: itself.
ASKED_FOR = {
    "astropy",
    "fastavro",
    "google",
    "opentelemetry",
    "opir_report",
    "optuna",
    "pyarrow",
    "pytest",
    "sgp4",
    "shtab",
    "xarray",
}


def imported(folder):
    """Return the roots of all that the Python files of a folder import, wherever in them."""
    roots = set()
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                roots |= {name.name.partition(".")[0] for name in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                roots.add(node.module.partition(".")[0])
    return roots - set(sys.stdlib_module_names)


def declared(project):
    """Return the modules that the dependencies of a project bring."""
    with (project / "pyproject.toml").open("rb") as file:
        named = tomllib.load(file)["project"].get("dependencies", [])
    names = (re.match(r"[\w.-]+", requirement)[0].lower() for requirement in named)
    return {MODULES.get(name, name.replace("-", "_")) for name in names}


PACKAGES = [
    (ROOT, ROOT / "opir_core"),
    *((path, path / path.name) for path in sorted((ROOT / "plugins").glob("opir_*"))),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("project", "package"), PACKAGES, ids=[package.name for _, package in PACKAGES]
)
def test_everything_imported_is_installed_with_the_package(project, package):
    result = imported(package)
    assert result
    assert (
        result - declared(project) - declared(ROOT) - ASKED_FOR - {package.name, "opir_core"}
        == set()
    )


def test_the_extra_of_other_peoples_libraries_is_what_tests_leave_out_without_it():
    extra = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "optional-dependencies"
    ]
    names = (re.match(r"[\w.-]+", peer)[0] for peer in extra["peers"])
    assert sorted({"pyerfa": "erfa"}.get(name, name.replace("-", "_")) for name in names) == sorted(
        NAMES
    )


def test_a_file_of_tests_needs_what_it_imports_itself_or_through_a_module_of_support(
    tmp_path,
):
    file = tmp_path / "test_x.py"
    file.write_text(
        "import numpy\nimport astropy.units as u\nfrom page_browser import Page\n    import"
        " polars\n"
    )
    assert imported_by(file) == {"astropy", "playwright"}
    file.write_text("import numpy\n")
    assert imported_by(file) == set()


PIN = re.compile(r"([\w.-]+)==\S+")


def plain(name):
    """Return a distribution's name as the index compares it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def brought_by_opir():
    """Return the installed distributions that opir's own and their installed extras bring."""
    names = [each.name for each in distributions() if each.name.startswith("opir-")]
    reached = {plain(name) for name in names}
    while names:
        for text in distribution(names.pop()).requires or ():
            needed = Requirement(text)
            name = plain(needed.name)
            is_for_us = needed.marker is None or needed.marker.evaluate({"extra": ""})
            if is_for_us and name not in reached and name in INSTALLED:
                reached.add(name)
                names.append(name)
    return {name for name in reached if not name.startswith("opir-")}


INSTALLED = {plain(each.name) for each in distributions()}


def test_every_distribution_that_opir_brings_has_a_version_and_a_digest():
    pins = PIN.findall((ROOT / "constraints.txt").read_text(encoding="utf-8"))
    blocks = re.split(r"\n(?=\S)", (ROOT / "locked.txt").read_text(encoding="utf-8"))
    digests = {plain(PIN.match(block)[1]) for block in blocks if "--hash=sha256:" in block}
    brought = brought_by_opir()
    assert len(brought) > 20
    assert brought <= set(map(plain, pins))
    assert brought <= digests


def test_the_versions_and_the_digests_agree():
    lines = [
        {line.rstrip(" \\").partition(" ;")[0] for line in text.splitlines() if "==" in line}
        for text in (
            (ROOT / name).read_text(encoding="utf-8") for name in ("locked.txt", "constraints.txt")
        )
    ]
    locked, pinned = lines
    assert len(locked) > 50
    assert locked <= pinned
