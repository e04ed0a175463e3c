"""The house stays as it is meant: imports go down, files as long as their subject, plain names, no
prints.
"""

import ast
import re
from functools import cache

import pytest
from public_names import PUBLIC, is_public
from repository import ROOT

from opir_core.host.components import CATALOGUE

CORE = ROOT / "opir_core"
SOURCES = sorted([*CORE.rglob("*.py"), *(ROOT / "plugins").glob("*/opir_*/**/*.py")])

#: Lines of a module, and of a function, above which a reader has looked whether it is one subject, or one thought.
REVIEWED_MODULE = 600
REVIEWED_FUNCTION = 60
LONG_MODULES: dict[str, str] = {}
LONG_FUNCTIONS = {}
VAGUE = {"utils", "util", "helpers", "helper", "manager", "base", "common", "misc"}

#: Modules that may lie flat in the core.
FLAT = {"__init__", "__main__", "_version", "arrays", "constants", "doors", "errors", "notebook"}

#: The floors of the core, from the lowest: a module imports from its own floor and from those
#: below. `reading` is above `host`, for a scene names components.
FLOORS = (
    *(
        "_version",
        "doors",
        "constants",
        "errors",
        "notebook",
        "arrays",
        "geometry",
        "scene",
        "flight",
        "interfaces",
        "orbits",
    ),
    *(
        "random_streams",
        "host",
        "reading",
        "planning",
        "estimation",
        "sensors",
        "simulation",
        "output",
    ),
    *("builtin", "live", "cli", "__main__"),
)

#: The floors of the distributions: a plugin imports from the core and from plugins below its own.
DISTRIBUTIONS = (
    *(
        "opir_core",
        "opir_photons",
        "opir_dsp",
        "opir_sbirs",
        "opir_nextgen",
        "opir_heo",
        "opir_leo",
        "opir_readers",
    ),
    *(
        "opir_estimation",
        "opir_forecast",
        "opir_trackers",
        "opir_stonesoup",
        "opir_render",
        "opir_scoring",
        "opir_export",
        "opir_paper",
        "opir_report",
    ),
    *(
        "opir_studies",
        "opir_dask",
        "opir_coverage",
        "opir_bench",
        "opir_kafka",
        "opir_displays",
        "opir_http",
        "opir_testing",
    ),
)

Function = ast.FunctionDef | ast.AsyncFunctionDef


@cache
def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def module_of(path):
    names = path.relative_to(ROOT).with_suffix("").parts
    names = names[2:] if names[0] == "plugins" else names
    return ".".join(names[:-1] if names[-1] == "__init__" else names)


MODULES = {module_of(path): path for path in SOURCES}
CORE_MODULES = {
    module: path for module, path in MODULES.items() if module.partition(".")[0] == "opir_core"
}


def floor_of(module):
    return module.removeprefix("opir_core.").partition(".")[0]


@cache
def homes_of(door):
    """Return the module of each name that the stub of a package hands on."""
    stub = MODULES[door].with_suffix(".pyi")
    nodes = tree_of(stub).body if stub.is_file() else []
    return {
        name.name: str(node.module)
        for node in nodes
        if isinstance(node, ast.ImportFrom)
        for name in node.names
    }


def imports_of(path):
    """Yield the modules of opir that a file imports, wherever in it; of a door, the homes of the
    names.
    """
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names if name.name in MODULES)
        elif isinstance(node, ast.ImportFrom) and node.module in MODULES:
            inner = (f"{node.module}.{name.name}" for name in node.names)
            homes = homes_of(node.module)
            yield from (
                name if name in MODULES else homes.get(name.rpartition(".")[2], node.module)
                for name in inner
            )


@cache
def graph():
    """Return the modules of opir that each imports."""
    return {module: sorted(set(imports_of(path))) for module, path in MODULES.items()}


def test_every_folder_of_the_core_has_its_floor():
    doors = {"opir_core", "opir_core.plugin"}
    assert {floor_of(module) for module in CORE_MODULES if module not in doors} == set(FLOORS)
    assert {module.partition(".")[0] for module in MODULES} == set(DISTRIBUTIONS)


def test_imports_go_down():
    rank = {name: number for number, name in enumerate(FLOORS)}
    distribution = {name: number for number, name in enumerate(DISTRIBUTIONS)}
    upward = []
    for module, targets in graph().items():
        for target in targets:
            own, its = (each.partition(".")[0] for each in (module, target))
            is_up = distribution[its] > distribution[own]
            if own == its == "opir_core" and module not in ("opir_core", "opir_core.plugin"):
                is_up = rank.get(floor_of(target), len(FLOORS)) > rank[floor_of(module)]
            if is_up:
                upward.append(f"{module} imports {target}")
    assert not upward


def test_no_imports_run_in_a_circle():
    remaining = {module: set(targets) - {module} for module, targets in graph().items()}
    while free := [module for module, targets in remaining.items() if not targets]:
        remaining = {
            module: targets - set(free)
            for module, targets in remaining.items()
            if module not in free
        }
    assert not remaining, "a circle runs through some of these"


def imported_names(path):
    """Yield the module and the name of each import of a file from opir's distributions."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            yield from (
                (name.name, "")
                for name in node.names
                if name.name.partition(".")[0] in DISTRIBUTIONS
            )
        elif (
            isinstance(node, ast.ImportFrom) and str(node.module).partition(".")[0] in DISTRIBUTIONS
        ):
            yield from ((str(node.module), name.name) for name in node.names)


def test_plugins_import_only_public_names_of_other_distributions():
    private = [
        f"{module} imports {name} of {other}"
        for module, path in MODULES.items()
        for other, name in imported_names(path)
        if other.partition(".")[0] != module.partition(".")[0]
        and module not in CORE_MODULES
        and not (is_public(other, name) if name else other in PUBLIC)
    ]
    assert not private


#: Imports inside functions are for what is heavy or optional: the budget only falls.
LAZY_IMPORTS = 50


def test_few_imports_stand_inside_functions():
    lazy = [
        f"{module}:{inner.lineno}"
        for module, path in CORE_MODULES.items()
        for node in functions(path)
        for inner in ast.walk(node)
        if isinstance(inner, ast.Import | ast.ImportFrom)
    ]
    assert len(lazy) <= LAZY_IMPORTS, lazy


def test_no_module_lies_flat_in_the_core():
    assert {path.stem for path in CORE.glob("*.py")} == FLAT


def functions(path):
    for node in ast.walk(tree_of(path)):
        if isinstance(node, Function):
            yield node


def lines_of_code(node):
    """Return the lines of a function without its docstring, which may be as long as it needs."""
    documented = ast.get_docstring(node) is not None
    docstring = node.body[0]
    return (
        (node.end_lineno or 0)
        - node.lineno
        + 1
        - ((docstring.end_lineno or 0) - docstring.lineno + 1 if documented else 0)
    )


def test_long_modules_are_reviewed():
    sizes = {
        path.relative_to(ROOT).as_posix(): len(path.read_text(encoding="utf-8").splitlines())
        for path in SOURCES
    }
    assert {name for name, size in sizes.items() if size > REVIEWED_MODULE} == set(LONG_MODULES)


def test_long_functions_are_reviewed():
    sizes = {
        f"{path.relative_to(ROOT).as_posix()}:{node.name}": lines_of_code(node)
        for path in SOURCES
        for node in functions(path)
    }
    assert {name for name, size in sizes.items() if size > REVIEWED_FUNCTION} == set(LONG_FUNCTIONS)


def test_no_module_has_a_vague_name():
    assert not [path for path in SOURCES if path.stem in VAGUE or path.parent.name in VAGUE]


@pytest.mark.slow
def test_no_class_name_stands_twice():
    homes = {}
    for path in SOURCES:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.ClassDef):
                homes.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    assert not {name: where for name, where in homes.items() if len(where) > 1}


def test_the_library_does_not_print():
    printing = re.compile(r"(?<![\w.])print\(")
    assert not [path for path in SOURCES if printing.search(path.read_text(encoding="utf-8"))]


#: The packages of plugins, and two of other people that only plugins use.
OUTSIDE = {path.name for path in (ROOT / "plugins").glob("opir_*")} | {"litestar", "aiokafka"}


def test_the_core_names_no_plugin():
    named = {
        module: names
        for module, path in CORE_MODULES.items()
        if (names := sorted(packages_named(tree_of(path))))
    }
    assert len(OUTSIDE) > 10
    assert not named


def packages_named(tree):
    """Return the modules of plugins that a module imports, or names in a text other than a
    docstring.

    A text alone (`"opir_trackers"`) may be a hook; it is a package where a function that imports
    gets it.
    """
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    named = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            named |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            named.add(node.module or "")
        elif isinstance(node, ast.Call) and re.search("import|spec", ast.unparse(node.func)):
            named |= {argument.value for argument in node.args if is_text(argument)}
        elif is_text(node) and id(node) not in docstrings and node.value not in CATALOGUE:
            named.add(node.value)
    return {name for name in named if name.partition(".")[0] in OUTSIDE}


def is_text(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


@pytest.mark.parametrize(
    ("code", "is_named"),
    [
        ("from opir_render import render", True),
        ("def lazy():\n    import opir_trackers.imm", True),
        ("import_module('opir_report')", True),
        ("importlib.util.find_spec('opir_trackers')", True),
        ("provided('opir_export', 'tables')", True),
        ("HOME = 'opir_http'", True),
        ("HOME = 'opir_trackers.imm'", True),
        ("host.names('opir_trackers')", False),
        ("def opir_trackers():\n    'Those of opir_trackers.'", False),
        ("PACKAGE = 'opir-export'", False),
    ],
)
def test_a_plugin_that_is_named_is_found(code, is_named):
    assert bool(packages_named(ast.parse(code))) == is_named


@pytest.mark.parametrize("package", ["", ".flight", ".geometry", ".orbits"])
def test_all_is_sorted_and_there(package):
    from importlib import import_module

    door = import_module(f"opir_core{package}")
    assert list(door.__all__) == sorted(door.__all__)
    assert all(hasattr(door, name) for name in door.__all__)
