"""Trackers know no target models: nothing on their side imports a boost, a target model or the
tables of either.

A tracker that knows the flights that the simulator draws is judged on its own answers.
"""

import ast
from functools import cache
from importlib import import_module
from types import ModuleType

import pytest
from public_names import PUBLIC
from repository import ROOT

#: Where trackers and their mathematics live.
FOLDERS = (
    "plugins/opir_forecast/opir_forecast",
    "plugins/opir_trackers/opir_trackers",
    "plugins/opir_stonesoup/opir_stonesoup",
    "plugins/opir_estimation/opir_estimation",
)

#: Boosts, target models and plumes; a module counts with those within it.
TARGET_MODELS = (
    "opir_core.builtin.class_flights",
    "opir_core.builtin.glide_targets",
    "opir_core.builtin.gravity_turn_targets",
    "opir_core.builtin.orbit_targets",
    "opir_core.builtin.plugin",
    "opir_core.builtin.target_classes",
    "opir_core.builtin.targets",
    "opir_core.flight.aiming",
    "opir_core.flight.ascent",
    "opir_core.flight.boost",
    "opir_core.flight.glide",
    "opir_core.flight.orbit_insertion",
    "opir_core.flight.staged",
    "opir_photons",
    "opir_readers",
)

#: Records of classes and profiles, which contexts and the kit for plugins have to name: no tracker
#: imports them itself.
RECORDS = ("opir_core.scene.target_classes",)

#: Their tables, by the beginning of the file's name.
TABLES = ("class_profiles", "stagings", "target_classes")

#: Packages that hand on names of other modules.
DOORS = tuple(sorted(PUBLIC | {"opir_estimation", "opir_forecast", "opir_trackers"}))


def is_among(module, packages):
    return any(module == package or module.startswith(f"{package}.") for package in packages)


def imported(tree):
    """Yield the modules that a source imports or uses by the name of a door, wherever in it, types
    included.
    """
    doors = dict[str, str]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for name in node.names:
                yield name.name
                doors[name.asname or name.name] = name.name
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            for name in node.names:
                yield home_of(node.module, name.name)
                doors[name.asname or name.name] = f"{node.module}.{name.name}"
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            door = doors.get(ast.unparse(node.value))
            if door is not None and door in DOORS:
                yield home_of(door, node.attr)


def home_of(module, name):
    """Return the module that a name of a module comes from: the name itself where it is a
    module.
    """
    if not module.startswith("opir_core"):
        return module
    result = getattr(import_module(module), name, None)
    if result is None or isinstance(result, ModuleType):
        return f"{module}.{name}"
    home = getattr(result, "__module__", None)
    return home if module in DOORS and isinstance(home, str) else module


def texts(tree):
    """Yield the texts of a source that are no docstrings."""
    prose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in prose:
            yield node.value


@cache
def imports_of(module):
    """Return what a module of the core imports; doors, and what is no module of the core, import
    nothing.
    """
    path = ROOT / module.replace(".", "/")
    source = next(
        (
            path_of_module
            for path_of_module in (path.with_suffix(".py"), path / "__init__.py")
            if path_of_module.is_file()
        ),
        None,
    )
    if source is None or module in DOORS or not module.startswith("opir_core"):
        return ()
    return tuple(imported(ast.parse(source.read_text(encoding="utf-8"))))


def reached(modules):
    """Return the modules that modules import in the end, with the way there; the way does not lead
    through doors.
    """
    ways = {module: module for module in modules}
    queue = list(modules)
    while queue:
        module = queue.pop()
        for imported_module in imports_of(module):
            if imported_module not in ways:
                ways[imported_module] = f"{ways[module]} > {imported_module}"
                queue.append(imported_module)
    return ways


def faults(source):
    """Return what a source of the trackers' side knows of target models."""
    tree = ast.parse(source)
    modules = sorted(set(imported(tree)))
    result = [
        f"imports {module}" for module in modules if is_among(module, (*TARGET_MODELS, *RECORDS))
    ]
    ways = {module: way for module, way in reached(modules).items() if module not in modules}
    result += [f"reaches {way}" for module, way in ways.items() if is_among(module, TARGET_MODELS)]
    for text in texts(tree):
        named = [table for table in (*TARGET_MODELS, *RECORDS) if table in text]
        read = [table for table in TABLES if text.startswith(table) or f"/{table}" in text]
        result += [f"names {table}" for table in (*named, *read)]
    return result


@pytest.mark.slow
def test_nothing_on_the_side_of_trackers_knows_target_models():
    sources = {folder: sorted((ROOT / folder).rglob("*.py")) for folder in FOLDERS}
    assert all(sources.values())
    result = {
        str(path.relative_to(ROOT)): wrong
        for paths in sources.values()
        for path in paths
        if (wrong := faults(path.read_text(encoding="utf-8")))
    }
    assert not result, "a tracker must not know the flights that it is judged on"


@pytest.mark.parametrize(
    "source",
    [
        "from opir_core.flight.boost import boost_profile",
        "from opir_core.flight import boost_profile",
        "from opir_core.flight import staged",
        "import opir_core.flight.staged.staging",
        "from opir_core.plugin import BoostProfile",
        "from opir_core.plugin import TargetClass as Kind",
        "import opir_core.plugin as kit\nkit.BoostProfile",
        "import opir_core.flight\nopir_core.flight.aim(1)",
        "from opir_core import flight\nflight.boost_profiles()",
        "from opir_core.scene.target_classes import core_profiles",
        (
            "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from opir_core.flight.aiming"
            " import Aim"
        ),
        "def late():\n    from opir_core.builtin.targets import ballistic_targets",
        "from opir_photons.classification.synthetic_looks import synthetic_launches",
        "from importlib import import_module\nimport_module('opir_core.flight.boost')",
        "open('opir_core/data/class_profiles.json')",
        "path = folder / 'stagings.json'",
    ],
)
def test_each_way_to_a_target_model_is_found(source):
    assert faults(source)


@pytest.mark.parametrize(
    "source",
    [
        '"""Docstrings may name opir_core.flight.boost and class_profiles.json."""',
        "from opir_core.flight import propagate_kepler",
        "from opir_core.flight.kepler import propagate_kepler",
        "from opir_core.plugin import REPORTED_TYPES, Tracks, TrackerModel",
        "from opir_core.interfaces.contexts import TrackerContext",
        "from attrs import frozen\nimport numpy as np\nnp.zeros(3)",
    ],
)
def test_what_trackers_may_use_is_no_fault(source):
    assert not faults(source)
