"""The house stays as it is meant: imports go down, files as long as their subject, plain names, no prints."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from repository import ROOT

CORE = ROOT / "opir_core"
SOURCES = sorted([*CORE.rglob("*.py"), *(ROOT / "plugins").glob("*/opir_*/**/*.py")])

LONGEST_MODULE = 500
LONGEST_FUNCTION = 40
VAGUE = {"utils", "util", "helpers", "helper", "manager", "base", "common", "misc"}

#: Modules that may lie flat in the core.
FLAT = {"__init__", "__main__", "_version", "arrays", "constants", "errors"}

#: The floors of the core, from the lowest: a module imports from its own floor and from those below. `reading` is above
#: `host`, for a scene names components; the door for plugin authors, `plugin`, only re-exports.
FLOORS = (
    *("_version", "constants", "errors", "arrays", "geometry", "scene", "flight", "interfaces", "orbits"),
    *("random_streams", "host", "radiometry", "reading", "planning", "detection", "classification"),
    *("estimation", "sensors", "simulation", "output", "scoring", "builtin", "live", "testing", "cli"),
)

#: Doors only re-export, so that users import from one place.
DOORS = {"opir_core", "opir_core.plugin", "opir_core.__main__"}

Function = ast.FunctionDef | ast.AsyncFunctionDef


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


CORE_MODULES = {module_of(path): path for path in sorted(CORE.rglob("*.py"))}


def floor_of(module: str) -> str:
    return module.removeprefix("opir_core.").partition(".")[0]


def imports_of(path: Path) -> Iterator[str]:
    """Yield the modules of the core that a file imports, wherever in it, types included."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names if name.name in CORE_MODULES)
        elif isinstance(node, ast.ImportFrom) and node.module in CORE_MODULES:
            inner = (f"{node.module}.{name.name}" for name in node.names)
            yield from (name if name in CORE_MODULES else node.module for name in inner)


@cache
def graph() -> dict[str, list[str]]:
    """Return the modules of the core that each imports."""
    return {module: sorted(set(imports_of(path))) for module, path in CORE_MODULES.items()}


@pytest.mark.slow
def test_every_folder_of_the_core_has_its_floor() -> None:
    assert {floor_of(module) for module in graph() if module not in DOORS} == set(FLOORS)


@pytest.mark.slow
def test_imports_of_the_core_go_down() -> None:
    rank = {name: number for number, name in enumerate(FLOORS)}
    upward = [
        f"{module} imports {other}"
        for module, others in graph().items()
        if module not in DOORS
        for other in others
        if other in DOORS or rank[floor_of(other)] > rank[floor_of(module)]
    ]
    assert not upward


def test_no_imports_run_in_a_circle() -> None:
    left = {module: set(others) - {module} for module, others in graph().items()}
    while free := [module for module, others in left.items() if not others]:
        left = {module: others - set(free) for module, others in left.items() if module not in free}
    assert not left, "a circle runs through some of these"


#: Imports inside functions are for what is heavy or optional: the budget only falls.
LAZY_IMPORTS = 50


def test_few_imports_stand_inside_functions() -> None:
    lazy = [
        f"{module}:{inner.lineno}"
        for module, path in CORE_MODULES.items()
        for node in functions(path)
        for inner in ast.walk(node)
        if isinstance(inner, ast.Import | ast.ImportFrom)
    ]
    assert len(lazy) <= LAZY_IMPORTS, lazy


def test_no_module_lies_flat_in_the_core() -> None:
    assert {path.stem for path in CORE.glob("*.py")} == FLAT


def functions(path: Path) -> Iterator[Function]:
    for node in ast.walk(tree_of(path)):
        if isinstance(node, Function):
            yield node


def lines_of_code(node: Function) -> int:
    """Return the lines of a function without its docstring, which may be as long as it needs."""
    documented = ast.get_docstring(node) is not None
    first = node.body[0]
    return (node.end_lineno or 0) - node.lineno + 1 - ((first.end_lineno or 0) - first.lineno + 1 if documented else 0)


def test_modules_are_as_long_as_one_subject() -> None:
    sizes = {str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines()) for path in SOURCES}
    assert not {name: size for name, size in sizes.items() if size > LONGEST_MODULE}


def test_functions_are_short() -> None:
    assert not [
        f"{path.relative_to(ROOT)}:{node.name}"
        for path in SOURCES
        for node in functions(path)
        if lines_of_code(node) > LONGEST_FUNCTION
    ]


def test_no_module_has_a_vague_name() -> None:
    assert not [path for path in SOURCES if path.stem in VAGUE or path.parent.name in VAGUE]


@pytest.mark.slow
def test_no_class_name_stands_twice() -> None:
    homes: dict[str, list[str]] = {}
    for path in SOURCES:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.ClassDef):
                homes.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    assert not {name: where for name, where in homes.items() if len(where) > 1}


def test_the_library_does_not_print() -> None:
    printing = re.compile(r"(?<![\w.])print\(")
    assert not [path for path in SOURCES if printing.search(path.read_text(encoding="utf-8"))]


@pytest.mark.slow
def test_the_core_names_no_constellation_no_tracker_package_no_web_and_no_broker() -> None:
    outside = "dsp|sbirs|nextgen|heo|leo|trackers|http|kafka|stonesoup"
    forbidden = re.compile(rf"\b(opir_({outside})\b(?!\()|import litestar|import aiokafka)")
    named = {module for module, path in CORE_MODULES.items() if forbidden.search(code_of(path))}
    assert not named - WHERE_HOOKS_ARE_NAMED


#: The hook `opir_trackers` has the name of a package.
WHERE_HOOKS_ARE_NAMED = {
    "opir_core.host.components",
    "opir_core.host.hookspecs",
    "opir_testing.contracts",
    "opir_core.builtin.plugin",
    "opir_core.reading.scene_schema",
}


def code_of(path: Path) -> str:
    """Return a module's source without its docstrings and comments, which may give examples."""
    tree = tree_of(path)
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            node.value.value = ""
    return ast.unparse(tree)


@pytest.mark.parametrize("package", ["", ".detection", ".flight", ".geometry", ".orbits", ".radiometry"])
def test_all_is_sorted_and_there(package: str) -> None:
    from importlib import import_module

    door = import_module(f"opir_core{package}")
    assert list(door.__all__) == sorted(door.__all__)
    assert all(hasattr(door, name) for name in door.__all__)
