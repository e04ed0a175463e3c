"""Docstrings of public names refer, in backticks, to public names only: what a reader meets there
can be imported.
"""

import ast
import inspect
import re
from functools import cache
from importlib import import_module

import pytest
from public_names import PUBLIC, is_public
from repository import ROOT

from opir_core.host.contributions import HOOKS

SOURCES = sorted(
    [*(ROOT / "opir_core").rglob("*.py"), *(ROOT / "plugins").glob("*/opir_*/**/*.py")]
)
#: A name in backticks, with the names before its dots, and perhaps a call.
NAME = re.compile(r"`([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)(?:\([^`]*\))?`")


@cache
def defined():
    """Return the names of all classes and functions that stand at the top of a module."""
    trees = (ast.parse(path.read_text(encoding="utf-8")) for path in SOURCES)
    kinds = (ast.ClassDef, ast.FunctionDef)
    names = (node.name for tree in trees for node in tree.body if isinstance(node, kinds))
    return frozenset(name for name in names if not name.startswith("__"))


def documented():
    """Yield each public class and function, and each public member of such a class, by its name."""
    for package in sorted(PUBLIC):
        door = import_module(package)
        for name in door.__all__:
            value = getattr(door, name)
            if inspect.isclass(value) or inspect.isroutine(value):
                yield f"{package}.{name}", value
            if inspect.isclass(value):
                members = [member for member in vars(value) if not member.startswith("_")]
                yield from (
                    (f"{package}.{name}.{each}", inspect.getattr_static(value, each))
                    for each in members
                )


@cache
def known():
    """Return the public names, with the members of public classes and the parameters of public
    functions.
    """
    names = {name for package in PUBLIC for name in import_module(package).__all__}
    for place, value in documented():
        names.add(place.rpartition(".")[2])
        if callable(value) and (inspect.isclass(value) or inspect.isroutine(value)):
            names |= parameters(value)
    return frozenset({*names, *HOOKS})


def parameters(value):
    try:
        return set(inspect.signature(value).parameters)
    except (TypeError, ValueError):
        return set()


def unpublished(text):
    """Return the names in backticks in a text that are opir's own and cannot be imported from a
    public package.
    """
    return [name for name in NAME.findall(text) if not is_published(name)]


def is_published(name):
    head, *remainder = name.split(".")
    if head.isalpha() and head.islower():  # a word, such as the value of a setting
        return True
    if not head.startswith("opir_") or not remainder:
        return head in known() or head not in defined()
    cuts_of_name = [head, *remainder]
    cuts = (".".join(cuts_of_name[:cut]) for cut in range(len(cuts_of_name), 0, -1))
    package = next((each for each in cuts if each in PUBLIC), "")
    tail = name.removeprefix(package).lstrip(".").split(".")[0]
    return bool(package) and (not tail or is_public(package, tail))


@pytest.mark.parametrize("package", sorted(PUBLIC))
def test_docstrings_of_public_names_refer_to_public_names(package):
    texts = {place: doc_of(value) for place, value in documented() if is_of(package, place)}
    private = {place: names for place, text in texts.items() if (names := unpublished(text))}
    assert not private


def is_of(package, place):
    """Return whether a place is a name of a package, or a member of one."""
    return place.startswith(f"{package}.") and place.removeprefix(f"{package}.").split(".")[
        0
    ] in dir(import_module(package))


def doc_of(value):
    inner = value.__func__ if isinstance(value, classmethod | staticmethod) else value
    inner = getattr(inner, "fget", None) or inner
    return (inner.__doc__ or "") if inspect.isclass(inner) or inspect.isroutine(inner) else ""


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("Return what `impact_states_eci` returns, `nan` where `height_m` is.", []),
        ("As `opir_core.Run`, `Run.plan` and `opir_core.plugin.Tracker`.", []),
        ("As `sensor_fault` says.", ["sensor_fault"]),
        (
            "As `opir_core.planning.built_parts.sensor_fault`.",
            ["opir_core.planning.built_parts.sensor_fault"],
        ),
    ],
)
def test_a_name_that_is_not_published_is_found(text, names):
    assert unpublished(text) == names
