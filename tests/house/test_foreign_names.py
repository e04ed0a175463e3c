"""What other libraries keep to themselves may change in any version: opir does not use it."""

import ast

import pytest
from repository import ROOT

SOURCES = sorted(
    [*(ROOT / "opir_core").rglob("*.py"), *(ROOT / "plugins").glob("*/opir_*/**/*.py")]
)

#: Public despite the underscore: documented by Python.
DOCUMENTED = {"_asdict", "_fields", "_replace", "_current_frames", "_exit", "_repr_html_"}

#: Without a public way: argparse's arguments of a parser, the workers of a pool before Python 3.14,
#: and Stone Soup's set of tracks (a plain set has another order in each process). It only gets
#: shorter.
WITHOUT_PUBLIC_WAY = {
    "cli/main.py": {"_actions"},
    "opir_stonesoup/tracker.py": {"_tracks"},
    "opir_studies/executors.py": {"_processes"},
}


def is_private(name):
    return name.startswith("_") and not name.startswith("__")


def own_names(tree):
    """Yield the private names that a module of opir defines: functions, classes, variables and
    attributes of self.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif (
            isinstance(node, ast.Attribute)
            and isinstance(node.ctx, ast.Store)
            and is_of(node, "self")
        ):
            yield node.attr


def foreign_names(tree):
    """Yield the private names that a module imports from other libraries or gets from any object
    but its own.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (module for name in node.names for module in name.name.split("."))
        elif (
            isinstance(node, ast.ImportFrom)
            and node.level == 0
            and not str(node.module).startswith("opir")
        ):
            yield from (*str(node.module).split("."), *(name.name for name in node.names))
        elif isinstance(node, ast.Attribute) and not is_of(node, "self", "cls"):
            yield node.attr


def is_of(node, *names):
    return isinstance(node.value, ast.Name) and node.value.id in names


def test_no_private_name_of_another_library_is_used():
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in SOURCES}
    opir_names = {name for tree in trees.values() for name in own_names(tree)} - {"_tracks"}
    uses = {}
    for path, tree in trees.items():
        private = (
            {name for name in foreign_names(tree) if is_private(name)} - opir_names - DOCUMENTED
        )
        if private:
            uses["/".join(path.parts[-2:])] = private
    assert uses == WITHOUT_PUBLIC_WAY


@pytest.mark.parametrize(
    "code",
    [
        "import scipy.integrate._ivp",
        "from numpy._core import umath",
        "from numpy import _globals",
        "parser._actions",
    ],
)
def test_a_private_name_is_seen(code):
    assert any(map(is_private, foreign_names(ast.parse(code))))
