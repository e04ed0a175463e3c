"""The page of the public Python API, from the docstrings of what the public packages export."""

import inspect
import re
import textwrap
from collections.abc import Mapping
from importlib import import_module
from typing import Any

from numpy.typing import ArrayLike

_ARRAY_LIKE = re.compile(re.escape(inspect.formatannotation(ArrayLike)))
_EXAMPLE = re.compile(r"^>>> .*(?:\n.+)*", re.MULTILINE)
_WIDTH = 100
#: Characters of a constant that are shown.
_LONGEST = 400

#: The packages that users import from, in the order of the page, and for whom each is.
PUBLIC = (
    "opir_core",
    "opir_core.plugin",
    "opir_core.arrays",
    "opir_core.constants",
    "opir_core.errors",
    "opir_core.notebook",
    "opir_core.interfaces",
    "opir_core.scene",
    "opir_core.reading",
    "opir_core.host",
    "opir_core.flight",
    "opir_core.geometry",
    "opir_core.orbits",
    "opir_core.estimation",
    "opir_core.sensors",
    "opir_core.planning",
    "opir_core.simulation",
    "opir_core.random_streams",
    "opir_core.output",
    "opir_core.live",
    "opir_core.cli",
    "opir_core.builtin",
    "opir_core.doors",
    "opir_photons.radiometry",
    "opir_photons.detection",
    "opir_estimation",
    "opir_estimation.square_root",
    "opir_coverage",
    "opir_bench",
    "opir_scoring",
    "opir_testing",
)

_HEAD = """# Python API

What may I import, and from where? The names on these pages, from the packages that head them. Everything else is
internal and may change in any release. Arrays are numpy arrays, shapes are in parentheses, and units are in the names:
`_m`, `_s`, `_rad`, `_w_m2`. Frames are `_ecef` and `_eci` ([angles](../angles.md), [glossary](../../glossary.md)).

```python
import opir_core as opir
from opir_core.geometry import geodetic_to_ecef
```

| import from | what it is | names |
|---|---|---|
{rows}

Generated from the docstrings by `python docs/generate.py`.
"""


def api_pages() -> Mapping[str, str]:
    """Return the pages of the public Python API by file name: an index, and one page for each
    package.
    """
    homes = homes_of_names()
    pages = {f"{short(package)}.md": section(package, homes) for package in PUBLIC}
    return {"README.md": _HEAD.format(rows="\n".join(map(index_row, PUBLIC))), **pages}


def short(package: str) -> str:
    """Return the file name of a package's page: its name without `opir_core`, where that is not all
    of it.
    """
    return package.removeprefix("opir_core.").rpartition("opir_photons.")[2]


def summary_of(package: Any) -> str:
    """Return the first paragraph of a package's docstring, on one line."""
    return " ".join((package.__doc__ or "").partition("\n\n")[0].split())


def index_row(package: str) -> str:
    """Return the row of the index for one package."""
    count = len(offered(package))
    return (
        f"| [`{package}`]({short(package)}.md) | {summary_of(import_module(package))} | {count} |"
    )


def homes_of_names() -> Mapping[tuple[str, int], str]:
    """Return by name and identity of a class or function the last package that offers it, whose
    page has its entry.
    """
    return {
        (name, id(value)): package
        for package in PUBLIC
        for name, value in offered(package)
        if inspect.isclass(value) or inspect.isroutine(value)
    }


def offered(package: str) -> list[tuple[str, Any]]:
    """Return the public names of a package, and what they are."""
    door = import_module(package)
    names = [name for name in getattr(door, "__all__", ()) if not name.startswith("__")]
    return [(name, getattr(door, name)) for name in names]


def section(package: str, homes: Mapping[tuple[str, int], str]) -> str:
    """Return the page of one package: its summary, then each of its names.

    A name that another package offers too has its entry on the page of the last of them, `homes`.
    """
    head = [
        f"# {package}",
        "",
        f"{summary_of(import_module(package))} [All packages](README.md).",
        "",
    ]
    rows = [
        (name, value, homes.get((name, id(value)), package)) for name, value in offered(package)
    ]
    elsewhere = [
        f"[{name}]({short(home)}.md#{name.lower()})" for name, _, home in rows if home != package
    ]
    if elsewhere:
        head += [f"Also: {', '.join(elsewhere)}.", ""]
    return "\n".join(
        [*head, *(entry(name, value) for name, value, home in rows if home == package)]
    )


def entry(name: str, value: Any) -> str:
    """Return the entry of one name: its signature and its docstring."""
    if not (inspect.isclass(value) or inspect.isroutine(value)):
        text = re.sub(" at 0x[0-9a-f]+", "", repr(value))
        return (
            f"## {name}\n\nConstant,"
            f" `{text if len(text) <= _LONGEST else f'{text[:_LONGEST]}…'}`.\n"
        )
    text = _EXAMPLE.sub(r"```pycon\n\g<0>\n```", inspect.cleandoc(value.__doc__ or ""))
    return f"## {name}\n\n```text\n{signature(name, value)}\n```\n\n{text}\n{members(value)}"


def signature(name: str, value: Any) -> str:
    """Return a call as a user writes it, without the types' module paths."""
    try:
        call = inspect.signature(value)
    except (TypeError, ValueError):
        return name
    if inspect.isclass(value):
        # The docstrings of records say what their fields are.
        call = call.replace(
            parameters=[row.replace(annotation=row.empty) for row in call.parameters.values()]
        )
    found = str(call)
    found = _ARRAY_LIKE.sub("ArrayLike", found)
    found = re.sub(r"(?:[A-Za-z_]\w*\.)+([A-Za-z_]\w*)", r"\1", found)
    found = re.sub(r"ndarray\[tuple\[[^\]]*\], dtype\[(\w+)\]\]", r"array of \1", found)
    found = re.sub(r"NOTHING|<(?:[^<>]|<[^<>]*>)*>", "...", found).replace("'", "")
    found = f"{name}{found.removesuffix(' -> None') if inspect.isclass(value) else found}"
    if len(found) <= _WIDTH:
        return found
    return _filled(found) if inspect.isclass(value) else _one_a_line(found)


def _filled(call: str) -> str:
    """Return a call on lines of the page's width."""
    return textwrap.fill(
        call, _WIDTH, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )


def _one_a_line(call: str) -> str:
    """Return a call with one argument on each line."""
    parts = []
    depth = 0
    start = 0
    first = call.index("(") + 1
    for place, letter in enumerate(call):
        depth += (letter in "([") - (letter in ")]")
        if (letter == "," and depth == 1) or (letter == ")" and depth == 0):
            parts.append(call[max(start, first) : place].strip())
            start = place + 1
            if letter == ")":
                return "\n".join([call[:first], *(f"    {part}," for part in parts), call[place:]])
    return call


def members(value: Any) -> str:
    """Return a list of the public methods and properties of a class, each with the first line of
    its docstring.
    """
    if not inspect.isclass(value):
        return ""
    rows = []
    for name, member in vars(value).items():
        inner = member.__func__ if isinstance(member, classmethod | staticmethod) else member
        inner = getattr(inner, "fget", inner)
        if name.startswith("_") or not inspect.isfunction(inner) or not inner.__doc__:
            continue
        call = name if hasattr(member, "fget") else f"{name}{arguments(inner)}"
        rows.append(
            f"* `{call}`: {' '.join(inner.__doc__.partition(chr(10) + chr(10))[0].split())}"
        )
    return "\n" + "\n".join(rows) + "\n" if rows else ""


def arguments(function: Any) -> str:
    """Return the names of a method's arguments."""
    names = [name for name in inspect.signature(function).parameters if name not in ("self", "cls")]
    return f"({', '.join(names)})"
