"""Which plugins there are, and what they advertise; nothing of them is imported here.

A distribution names its plugins in the entry-point group `opir` (`dsp = "opir_dsp.plugin"`). In the group
`opir.components` it may list what they offer, as hook and name with the same value
(`"sensor_models.DSP" = "opir_dsp.plugin"`): such a plugin is imported only when a name it lists is asked for. In the
group `opir.api` it says which versions of the plugin interface it is written for (`opir_core.plugin.api`).

Installed distributions and their entry points, read from metadata files; nothing of them is imported.

`importlib.metadata` says the same, but importing and asking it costs several times what reading the files does (the
measurement is `docs/design/discovery_cost.py`). Directories are therefore read here, and it is asked only about what is
not a directory: archives, eggs, and finders other than Python's own.
"""

import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from importlib import import_module
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

from attrs import frozen

from opir_core._version import __version__
from opir_core.plugin.api import API_GROUP, API_VERSION, complaint_about, version_text
from opir_core.plugin.components import CATALOGUE, Provenance

_METADATA_FOLDERS = (".dist-info", ".egg-info")
_METADATA_FILES = ("METADATA", "PKG-INFO")

#: Returns the text of a metadata file by its name, "" where there is none.
_Reader = Callable[[str], str]


@frozen
class Distribution:
    """An installed distribution: entry points are (name, value) pairs by group, in the order of the file."""

    name: str
    version: str
    entry_points: Mapping[str, Sequence[tuple[str, str]]]


def distributions_with(groups: Collection[str]) -> list[Distribution]:
    """Return the distributions that have entry points in any of the groups, sorted by name.

    Of several with one name (an editable install and a checkout on `PYTHONPATH`, say) the first on `sys.path` counts,
    as it does for imports.
    """
    found: dict[str, Distribution] = {}
    for folder_name, read in _readers():
        sections = _sections(read("entry_points.txt"))
        entry_points = {group: sections[group] for group in groups if group in sections}
        if entry_points:
            name, version = _name_and_version(read, folder_name)
            found.setdefault(_canonical(name), Distribution(name, version, entry_points))
    return [found[key] for key in sorted(found)]


def _readers() -> Iterator[tuple[str, _Reader]]:
    for entry in dict.fromkeys(map(str, sys.path)):
        if entry.endswith(".egg") or Path(entry).is_file():
            yield from _readers_by_importlib(path=[entry])
        else:
            yield from _readers_in_directory(Path(entry))
    if any(hasattr(finder, "find_distributions") for finder in sys.meta_path if finder is not PathFinder):
        yield from _readers_by_importlib()


def _readers_in_directory(directory: Path) -> Iterator[tuple[str, _Reader]]:
    try:
        names = sorted(path.name for path in directory.iterdir() if path.name.endswith(_METADATA_FOLDERS))
    except OSError:
        return
    for name in names:
        yield name, _reader(directory / name)


def _reader(folder: Path) -> _Reader:
    def read(file_name: str) -> str:
        try:
            return (folder / file_name).read_text(encoding="utf-8", errors="replace")
        except OSError:
            return ""

    return read


def _readers_by_importlib(**where: Any) -> Iterator[tuple[str, _Reader]]:
    from importlib import metadata

    for distribution in metadata.distributions(**where):
        yield "", partial(_text, distribution.read_text)


def _text(read: Callable[[str], str | None], file_name: str) -> str:
    return read(file_name) or ""


def _sections(text: str) -> dict[str, list[tuple[str, str]]]:
    sections: dict[str, list[tuple[str, str]]] = {}
    group = ""
    for line in _lines(text):
        if line.startswith("[") and line.endswith("]"):
            group = line[1:-1].strip()
        elif "=" in line:
            name, _, value = line.partition("=")
            sections.setdefault(group, []).append((name.strip(), value.strip()))
    return sections


def _lines(text: str) -> Iterable[str]:
    stripped = (line.strip() for line in text.splitlines())
    return (line for line in stripped if line and not line.startswith("#"))


def _name_and_version(read: _Reader, folder_name: str) -> tuple[str, str]:
    text = next(filter(None, map(read, _METADATA_FILES)), "")
    headers: dict[str, str] = {}
    for line in text.partition("\n\n")[0].splitlines():
        key, colon, value = line.partition(":")
        if colon and not key[:1].isspace():
            headers[key.lower()] = value.strip()
    stem_name, _, stem_version = folder_name.rpartition(".")[0].partition("-")
    return headers.get("name") or stem_name, headers.get("version") or stem_version


def _canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


PLUGIN_GROUP = "opir"
COMPONENT_GROUP = "opir.components"
COMMAND_HOOK = "opir_add_commands"

#: A hook and a name that a plugin offers under it.
Offer = tuple[str, str]

#: An entry point: its name and its value.
Entry = tuple[str, str]

#: The hooks by the names that advertisements use.
HOOK_OF_KIND: Mapping[str, str] = {
    **{hook.removeprefix("opir_"): hook for hook in CATALOGUE},
    "commands": COMMAND_HOOK,
}

#: Core's own plugins, which no allow-list leaves out: the module and, where it is to be imported only for what a scene
#: asks of it, what it offers.
CORE_PLUGINS: Mapping[str, tuple[str, frozenset[Offer] | None]] = {
    "builtin": ("opir_core.builtin.plugin", None),
    "scanner": ("opir_core.builtin.scanner", frozenset({("opir_sensor_models", "generic-scanner")})),
    "radiometry": (
        "opir_core.radiometry.plugin",
        frozenset(
            {
                ("opir_signature_models", "plume"),
                ("opir_atmosphere_models", "lowtran"),
                ("opir_background_models", "earth"),
                *(("opir_source_models", name) for name in ("fires", "flares", "glints", "bolides")),
            }
        ),
    ),
    "detection": ("opir_core.detection.plugin", frozenset({("opir_detection_models", "snr")})),
    "classification": ("opir_core.classification.plugin", frozenset({("opir_classifiers", "spectral")})),
}

_VALUE = re.compile(r"(?P<module>\w+(?:\.\w+)*)\s*(?::\s*(?P<attribute>\w+(?:\.\w+)*))?\s*(?:\[.*\])?")


@frozen(eq=False, kw_only=True)
class Source:
    """A plugin as its metadata describe it.

    `advertised` is None where it lists nothing and only importing it can tell what it offers. `api` is the range of
    plugin interfaces that it declares, "" where it declares none. `fault` is what is wrong with the metadata
    themselves, "" where nothing is.
    """

    provenance: Provenance
    load: Callable[[], object]
    advertised: frozenset[Offer] | None = None
    api: str = ""
    fault: str = ""


@frozen
class Selection:
    """The plugins there are, parted by an allow-list.

    `unknown` are names on the list that no distribution offers; `rule` is how messages call the list, "" where there
    is none.
    """

    allowed: Sequence[Source]
    hidden: Sequence[Source] = ()
    unknown: Sequence[str] = ()
    rule: str = ""


def core_sources() -> list[Source]:
    """Return core's own plugins, which no allow-list leaves out."""
    return [
        Source(
            provenance=Provenance(name, "opir-core", __version__),
            load=partial(_imported, module),
            advertised=offers,
            api=version_text(API_VERSION),
        )
        for name, (module, offers) in CORE_PLUGINS.items()
    ]


def installed_sources() -> list[Source]:
    """Return the plugins of all installed distributions, sorted by distribution and name."""
    distributions = distributions_with((PLUGIN_GROUP, COMPONENT_GROUP, API_GROUP))
    return [source for distribution in distributions for source in sources_of(distribution)]


def sources_of(distribution: Distribution) -> list[Source]:
    """Return the plugins of one distribution, sorted by name.

    An advertisement that fits none of them is a fault of the distribution, and so of each.
    """
    plugins = sorted(set(distribution.entry_points.get(PLUGIN_GROUP, ())))
    adverts = sorted(set(distribution.entry_points.get(COMPONENT_GROUP, ())))
    declared = sorted(set(distribution.entry_points.get(API_GROUP, ())))
    faults = _faults(plugins, adverts) + _strays(plugins, declared)
    return [_source(distribution, name, value, adverts, declared, faults) for name, value in plugins or [("", "")]]


def selected(sources: Iterable[Source], allowed: Iterable[str] | None, rule: str) -> Selection:
    """Return the sources parted by the names that are allowed (None allows all); core's own plugins always are."""
    known = list(sources)
    if allowed is None:
        return Selection(known)
    wanted = {name.strip() for name in allowed} - {""} | set(CORE_PLUGINS)
    names = {source.provenance.plugin for source in known}
    return Selection(
        allowed=[source for source in known if source.provenance.plugin in wanted],
        hidden=[source for source in known if source.provenance.plugin not in wanted],
        unknown=sorted(wanted - names),
        rule=rule,
    )


def _source(
    distribution: Distribution,
    name: str,
    value: str,
    adverts: Sequence[Entry],
    declared: Sequence[Entry],
    faults: Sequence[str],
) -> Source:
    offers = frozenset(_offer(entry) for entry, target in adverts if target == value or not name)
    ranges = [written for written, target in declared if target == value]
    return Source(
        provenance=Provenance(name, distribution.name, distribution.version),
        load=partial(_imported, value),
        advertised=offers or None,
        api=" and ".join(ranges),
        fault="; ".join([*faults, *_own_faults(distribution, name, ranges)]),
    )


def _own_faults(distribution: Distribution, name: str, ranges: Sequence[str]) -> list[str]:
    taken = [f"the plugin name {name!r} belongs to opir-core"] if name in CORE_PLUGINS else []
    if len(ranges) > 1:
        return [*taken, f"declares several plugin APIs, {' and '.join(ranges)}; one range is due"]
    wrong = (complaint_about(written, distribution.name, __version__) for written in ranges)
    return [*taken, *filter(None, wrong)]


def _faults(plugins: Sequence[Entry], adverts: Sequence[Entry]) -> list[str]:
    unreadable = [entry for entry, _ in adverts if _offer(entry)[0] not in HOOK_OF_KIND.values()]
    return [
        *_strays(plugins, adverts),
        *(f"advertises {entry}, which is not a kind of component and a name" for entry in unreadable),
    ]


def _strays(plugins: Sequence[Entry], entries: Sequence[Entry]) -> list[str]:
    values = {value for _, value in plugins}
    return [
        f"advertises {entry} for {value!r}, which is no entry point of it in group opir"
        for entry, value in entries
        if value not in values
    ]


def _offer(entry: str) -> Offer:
    kind, _, name = entry.partition(".")
    return (HOOK_OF_KIND.get(kind, "") if name else "", name)


def _imported(value: str) -> object:
    match = _VALUE.fullmatch(value)
    if match is None:
        raise ImportError(f"the entry point {value!r} is not of the form module or module:object")
    found: object = import_module(match["module"])
    for attribute in (match["attribute"] or "").split(".") if match["attribute"] else ():
        found = getattr(found, attribute)
    return found
