"""Which plugins there are, and what they advertise; nothing of them is imported here.

A distribution names its plugins in the entry-point group `opir` (`dsp = "opir_dsp.plugin"`). In the group
`opir.components` it may list what they offer, as hook and name with the same value
(`"sensor_models.DSP" = "opir_dsp.plugin"`): such a plugin is imported only when a name it lists is asked for. In the
group `opir.api` it says which versions of the plugin interface it is written for (`opir_core.plugin.api`).
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from importlib import import_module

from attrs import frozen

from opir_core._version import __version__
from opir_core.plugin.api import API_GROUP, API_VERSION, complaint_about, version_text
from opir_core.plugin.components import CATALOGUE
from opir_core.plugin.distributions import Distribution, distributions_with
from opir_core.plugin.provenance import Provenance

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
    "tracking": (
        "opir_core.tracking.plugin",
        frozenset(("opir_trackers", name) for name in ("kepler-arc", "stereo-filter", "boost-profile")),
    ),
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
