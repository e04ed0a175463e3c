"""Discovery: which plugins are installed and which components they list. No plugin is imported
here.

A distribution names its plugin modules in the entry-point group `opir` (`dsp = "opir_dsp.plugin"`).
In the group `opir.components` it may list its components by hook and name (`"sensor_models.DSP" =
"opir_dsp.plugin"`): then the plugin is imported only when one of them is requested.

The versions of opir-core that a plugin requires are those of its dependency (`dependencies =
["opir-core>=0.1,<0.2"]`, PEP 440). pip checks them at installation. The host checks them again,
because opir-core may have been replaced since, and rejects the plugin without importing it. Only
release numbers are compared; a clause that cannot be read is ignored, for rejecting it is the
installer's task.

The metadata files are read directly: importing and querying `importlib.metadata` costs several
times as much (measured in `docs/design/discovery_cost.py`). It is used only for what is not a
directory: archives, eggs, and finders other than Python's own.
"""

import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from importlib import import_module
from importlib.machinery import PathFinder
from operator import attrgetter
from pathlib import Path
from typing import Any

from attrs import frozen

from opir_core._version import __version__
from opir_core.host.components import CATALOGUE, Provenance

_CORE = re.compile(
    r"opir[-_.]+core\s*(?:\[[^]]*\])?\s*\(?((?:[~=!<>][^;@()]*)?)\)?\s*(?:;(.*))?", re.IGNORECASE
)
_CLAUSE = re.compile(r"(~=|==|!=|<=|>=|<|>)\s*v?(\d+(?:\.\d+)*)(\.\*)?")


def core_specifier(requirements: Iterable[str]) -> str:
    """Return the specifier of opir-core among requirements (the values of `Requires-Dist`),
    `>=0.1,<0.2`; "" for none.

    Requirements of extras do not count.
    """
    matches = (_CORE.fullmatch(requirement.strip()) for requirement in requirements)
    clauses = {
        "".join(clause.split())
        for match in matches
        if match and "extra" not in (match[2] or "")
        for clause in match[1].split(",")
    }
    return ",".join(sorted(clauses - {""}, reverse=True))


def error_of_requirement(specifier: str, distribution: str, core_version: str) -> str:
    """Return why a plugin that requires `specifier` cannot be used with this core, or "" where it
    can.
    """
    if all(_admits(clause, core_version) for clause in specifier.split(",")):
        return ""
    return (
        f"requires opir-core {specifier}, and opir-core {core_version} is installed; install an"
        f" opir-core in that"
        f" range, or a release of {distribution} for opir-core {core_version}"
    )


def _admits(clause: str, version: str) -> bool:
    match = _CLAUSE.fullmatch(clause)
    if match is None:
        return True
    operator = match[1]
    bound = _release(match[2])
    is_prefix = bool(match[3])
    installed = _release(version)
    if operator == "~=":
        return _padded(installed, bound) >= _padded(bound, installed) and _starts(
            installed, bound[:-1]
        )
    is_equal = (
        _starts(installed, bound)
        if is_prefix
        else _padded(installed, bound) == _padded(bound, installed)
    )
    if operator in ("==", "!="):
        return is_equal == (operator == "==")
    is_less = _padded(installed, bound) < _padded(bound, installed)
    return ("=" in operator and is_equal) or (not is_equal and is_less == operator.startswith("<"))


def _release(version: str) -> tuple[int, ...]:
    """Return the numbers of a version's release, (0, 1, 0) of `0.1.0rc1`."""
    match = re.match(r"\d+(?:\.\d+)*", version)
    return tuple(map(int, match[0].split("."))) if match else ()


def _padded(release: tuple[int, ...], pattern: tuple[int, ...]) -> tuple[int, ...]:
    return release + (0,) * (len(pattern) - len(release))


def _starts(release: tuple[int, ...], prefix: tuple[int, ...]) -> bool:
    return _padded(release, prefix)[: len(prefix)] == prefix


_METADATA_FOLDERS = (".dist-info", ".egg-info")
_METADATA_FILES = ("METADATA", "PKG-INFO")

#: Returns the text of a metadata file by its name, "" where there is none.
_Reader = Callable[[str], str]


@frozen
class Distribution:
    """An installed distribution.

    `requires_core` is the specifier of its dependency on opir-core, "" for none. Entry points are
    (name, value) pairs by group, in the order of the file. `read` returns another metadata file.
    """

    name: str
    version: str
    requires_core: str
    entry_points: Mapping[str, Sequence[tuple[str, str]]]
    read: _Reader


def distributions_with(groups: Collection[str]) -> list[Distribution]:
    """Return the distributions that have entry points in any of the groups, sorted by name.

    Of several with one name (for example an editable install and a checkout on `PYTHONPATH`) the
    first on `sys.path` counts, as for imports.
    """
    distributions: dict[str, Distribution] = {}
    for folder_name, read in _readers():
        sections = _sections(read("entry_points.txt"))
        entry_points = {group: sections[group] for group in groups if group in sections}
        if entry_points:
            name, version, requires_core = _headers(read, folder_name)
            canonical = re.sub(r"[-_.]+", "-", name).lower()
            distributions.setdefault(
                canonical, Distribution(name, version, requires_core, entry_points, read)
            )
    return [distributions[key] for key in sorted(distributions)]


def _readers() -> Iterator[tuple[str, _Reader]]:
    for entry in dict.fromkeys(map(str, sys.path)):
        if entry.endswith(".egg") or Path(entry).is_file():
            yield from _readers_by_importlib(path=[entry])
        else:
            yield from _readers_in_directory(Path(entry))
    if any(
        hasattr(finder, "find_distributions")
        for finder in sys.meta_path
        if finder is not PathFinder
    ):
        # Finders of other packages may find again what lies in folders that are read already.
        yield from _readers_by_importlib(excluded={Path(entry).resolve() for entry in sys.path})


def _readers_in_directory(directory: Path) -> Iterator[tuple[str, _Reader]]:
    try:
        names = sorted(
            path.name for path in directory.iterdir() if path.name.endswith(_METADATA_FOLDERS)
        )
    except OSError:
        return
    for name in names:
        yield name, partial(_content, directory / name)


def _content(folder: Path, file_name: str) -> str:
    try:
        return (folder / file_name).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _readers_by_importlib(
    excluded: Collection[Path] = (), **where: Any
) -> Iterator[tuple[str, _Reader]]:
    from importlib import metadata

    for distribution in metadata.distributions(**where):
        if not excluded or Path(str(distribution.locate_file(""))).resolve() not in excluded:
            yield "", partial(_text_of, distribution)


def _text_of(distribution: Any, file_name: str) -> str:
    try:
        return distribution.read_text(file_name) or ""
    except (OSError, UnicodeError):
        return ""


def _sections(text: str) -> dict[str, list[tuple[str, str]]]:
    sections: dict[str, list[tuple[str, str]]] = {}
    group = ""
    for line in map(str.strip, text.splitlines()):
        if line.startswith("[") and line.endswith("]"):
            group = line[1:-1].strip()
        elif "=" in line and not line.startswith("#"):
            name, _, value = line.partition("=")
            sections.setdefault(group, []).append((name.strip(), value.strip()))
    return sections


def _headers(read: _Reader, folder_name: str) -> tuple[str, str, str]:
    """Return name, version and required versions of opir-core; the folder's name stands in for
    missing headers.
    """
    text = next(filter(None, map(read, _METADATA_FILES)), "")
    headers: dict[str, list[str]] = {}
    for line in text.partition("\n\n")[0].splitlines():
        key, colon, value = line.partition(":")
        if colon and not key[:1].isspace():
            headers.setdefault(key.lower(), []).append(value.strip())
    stem_name, _, stem_version = folder_name.rpartition(".")[0].partition("-")
    name, version = (headers.get(key, [""])[-1] for key in ("name", "version"))
    return (
        name or stem_name,
        version or stem_version,
        core_specifier(headers.get("requires-dist", ())),
    )


PLUGIN_GROUP = "opir"
COMPONENT_GROUP = "opir.components"
COMMAND_HOOK = "opir_add_commands"

#: A hook and a name that a plugin offers under it.
Offer = tuple[str, str]

#: An entry point: its name and its value.
Entry = tuple[str, str]

#: The hooks by their names in the group `opir.components`.
HOOK_OF_KIND: Mapping[str, str] = {
    **{hook.removeprefix("opir_"): hook for hook in CATALOGUE},
    "commands": COMMAND_HOOK,
}

#: The core's own plugins, which no allow-list excludes: the module and, where it is imported on
#: demand, its components.
CORE_PLUGINS: Mapping[str, tuple[str, frozenset[Offer] | None]] = {
    "builtin": ("opir_core.builtin.plugin", None),
    "target-models": (
        "opir_core.builtin.target_models",
        frozenset(
            ("opir_target_models", name)
            for name in ("gravity-turn", "orbit", "glide", "air-launch")
        ),
    ),
    "scanner": (
        "opir_core.builtin.scanner",
        frozenset(("opir_sensor_models", f"generic-{name}") for name in ("scanner", "pointed")),
    ),
    "directors": (
        "opir_core.builtin.director_models",
        frozenset(
            ("opir_directors", name) for name in ("operator", "round-robin", "cue", "information")
        ),
    ),
    "target-classes": (
        "opir_core.builtin.target_classes",
        frozenset(
            ("opir_target_classes", name)
            for name in ("ICBM", "IRBM", "SRBM", "MRBM", "SLBM", "HGV", "SLV")
        ),
    ),
}

_VALUE = re.compile(
    r"(?P<module>\w+(?:\.\w+)*)\s*(?::\s*(?P<attribute>\w+(?:\.\w+)*))?\s*(?:\[.*\])?"
)


@frozen(eq=False, kw_only=True, repr=False)
class Source:
    """A plugin, from its metadata.

    `advertised` are the components that it lists, None where it lists none and has to be imported
    to know them. `requires_core` is the specifier of its dependency on opir-core, "" for none.
    `fault` is the error in the metadata, "" for none. `direct_url` returns the record of the folder
    that the distribution was installed from (PEP 610), "" for none.
    """

    provenance: Provenance
    load: Callable[[], object]
    advertised: frozenset[Offer] | None = None
    requires_core: str = ""
    fault: str = ""
    direct_url: Callable[[], str] = str

    def editable_folder(self) -> str:
        """Return the folder of an editable install; "" for any other."""
        record = self.direct_url()
        url = re.search(r'"url": *"file://([^"]+)"', record)
        if url is None or not re.search(r'"editable": *true', record):
            return ""
        # Not by `urllib.parse`, which this module would import at every start.
        escape = rb"%([0-9A-Fa-f]{2})"
        path = re.sub(escape, lambda code: bytes.fromhex(code[1].decode()), url[1].encode())
        return path.decode(errors="replace")


@frozen
class Selection:
    """The installed plugins, divided by an allow-list.

    `unknown` are names on the list that no distribution provides. `rule` is the list's name in
    messages, "" without one.
    """

    allowed: Sequence[Source]
    hidden: Sequence[Source] = ()
    unknown: Sequence[str] = ()
    rule: str = ""


def core_sources() -> list[Source]:
    """Return the core's own plugins."""
    return [
        Source(
            provenance=Provenance(name, "opir-core", __version__),
            load=partial(_imported, module),
            advertised=offers,
        )
        for name, (module, offers) in CORE_PLUGINS.items()
    ]


def installed_sources() -> list[Source]:
    """Return the plugins of all installed distributions, sorted by distribution and name.

    An entry of `opir.components` that belongs to none of a distribution's plugins is an error of
    each of them.
    """
    sources = []
    for distribution in distributions_with((PLUGIN_GROUP, COMPONENT_GROUP)):
        plugins = sorted(set(distribution.entry_points.get(PLUGIN_GROUP, ())))
        adverts = sorted(set(distribution.entry_points.get(COMPONENT_GROUP, ())))
        faults = _faults(plugins, adverts)
        sources += [
            _source(distribution, name, value, adverts, faults)
            for name, value in plugins or [("", "")]
        ]
    return sources


def selected(sources: Iterable[Source], allowed: Iterable[str] | None, rule: str) -> Selection:
    """Return the sources divided by the allowed names (None allows all); the core's own plugins are
    always allowed.
    """
    installed = list(sources)
    if allowed is None:
        return Selection(installed)
    selected_names = {name.strip() for name in allowed} - {""} | set(CORE_PLUGINS)
    names = {source.provenance.plugin for source in installed}
    return Selection(
        allowed=[source for source in installed if source.provenance.plugin in selected_names],
        hidden=[source for source in installed if source.provenance.plugin not in selected_names],
        unknown=sorted(selected_names - names),
        rule=rule,
    )


def _source(
    distribution: Distribution,
    name: str,
    value: str,
    adverts: Sequence[Entry],
    faults: Sequence[str],
) -> Source:
    offers = frozenset(_offer(entry) for entry, target in adverts if target == value or not name)
    taken = f"the plugin name {name!r} belongs to opir-core" if name in CORE_PLUGINS else ""
    unmet = error_of_requirement(distribution.requires_core, distribution.name, __version__)
    return Source(
        provenance=Provenance(name, distribution.name, distribution.version),
        load=partial(_imported, value),
        advertised=offers or None,
        requires_core=distribution.requires_core,
        fault="; ".join(filter(None, [*faults, taken, unmet])),
        direct_url=partial(distribution.read, "direct_url.json"),
    )


def _faults(plugins: Sequence[Entry], adverts: Sequence[Entry]) -> list[str]:
    values = {value for _, value in plugins}
    unreadable = [entry for entry, _ in adverts if _offer(entry)[0] not in HOOK_OF_KIND.values()]
    undeclared = [(entry, value) for entry, value in adverts if value not in values]
    words = "which is not one of its entry points in group opir"
    return [
        *(f"advertises {entry} for {value!r}, {words}" for entry, value in undeclared),
        *(
            f"advertises {entry}, which is not a kind of component and a name"
            for entry in unreadable
        ),
    ]


def _offer(entry: str) -> Offer:
    kind, _, name = entry.partition(".")
    return (HOOK_OF_KIND.get(kind, "") if name else "", name)


def _imported(value: str) -> object:
    match = _VALUE.fullmatch(value)
    if match is None:
        raise ImportError(f"the entry point {value!r} is not of the form module or module:object")
    module: object = import_module(match["module"])
    return attrgetter(match["attribute"])(module) if match["attribute"] else module
