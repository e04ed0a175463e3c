"""The messages about a component that is missing, has several owners or whose plugin failed, each
with the remedy.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path, PurePath
from sys import stdlib_module_names
from types import FrameType

from attrs import frozen

from opir_core.errors import install_command, nearest, nearest_names, with_article
from opir_core.host.components import CATALOGUE, PluginFailure, Provenance, plural
from opir_core.host.discovery import COMMAND_HOOK, CORE_PLUGINS, Offer, Selection, Source
from opir_core.scene.fields import LIGHT

_LONGEST_WORDS = 300
_CORE = PurePath(__file__).parent.parent
_PACKAGES = Path(__file__).parent.parent / "data" / "packages.txt"
_LIBRARIES = frozenset({"numpy", "scipy"})
_MACHINERY = (PurePath(__file__).parent.parts[-2:], ("importlib",))

#: The packages of this project and the components that they advertise, for messages about packages
#: that are not installed. A test compares the file with the packages' metadata.
PACKAGES: Mapping[str, Sequence[str]] = {
    name: tuple(entry for entry in entries if not entry.startswith("+"))
    for name, *entries in map(str.split, _PACKAGES.read_text("utf-8").splitlines())
}

#: What of the packages above reads a subject, by subject. A test compares it with what the
#: components declare.
READERS: Mapping[str, str] = {LIGHT: "detection_models.snr"}

#: Every name that is claimed under a hook, with its owners.
Claims = Mapping[Offer, Sequence[Provenance]]


@frozen
class Search:
    """A request for a component: the hook, the name and its path in the scene ("" outside a
    scene).
    """

    hook: str
    name: str
    path: str = ""

    @property
    def kind(self) -> str:
        """Return the kind of component in words."""
        return "command" if self.hook == COMMAND_HOOK else CATALOGUE[self.hook].kind

    @property
    def offer(self) -> Offer:
        """Return the hook and the name."""
        return (self.hook, self.name)

    @property
    def prefix(self) -> str:
        """Return the beginning of a message: the path in the scene."""
        return f"{self.path}: " if self.path else ""


def missing(
    search: Search, claims: Claims, failures: Iterable[PluginFailure], selection: Selection
) -> str:
    """Return the message about a name that no usable plugin offers: similar and installed names,
    failures, remedy.
    """
    kind = search.kind
    name = search.name
    installed = {
        offered: owners for (hook, offered), owners in sorted(claims.items()) if hook == search.hook
    }
    close = nearest_names(name, installed)
    lines = [
        f"{search.prefix}no {kind} is named {name!r}",
        *(
            [f"nearest: {_listed({offered: installed[offered] for offered in close})}"]
            if close
            else []
        ),
        *installable(search),
        f"{plural(kind)} installed: {_listed(installed) or 'none'}",
        *_of_other_kinds(search, claims),
        *(f"failed: {failure}" for failure in sorted(failures)),
        *_left_out(search, selection),
    ]
    return "\n  ".join(lines)


def installable(search: Search) -> Iterable[str]:
    """Yield which package of this project provides what was requested, and how to install it."""
    entry = _entry_point(search.offer)
    for package, entries in PACKAGES.items():
        if entry in entries:
            yield way_to_install(package)


def _entry_point(offer: Offer) -> str:
    """Return the entry point that lists a component, `trackers.imm`."""
    hook, name = offer
    return f"{'commands' if hook == COMMAND_HOOK else hook.removeprefix('opir_')}.{name}"


def way_to_read(subject: str) -> str:
    """Return how to install the package of this project that reads a subject."""
    return next(
        way_to_install(package)
        for package, entries in PACKAGES.items()
        if READERS[subject] in entries
    )


def way_to_install(package: str) -> str:
    """Return how to install a package of this project."""
    return f"{package} provides it; {install_command(package)}"


def contested(search: Search, owners: Collection[Provenance]) -> str:
    """Return the message about a name with several owners."""
    ranked = sorted(owners)
    count = "two" if len(ranked) == 2 else str(len(ranked))
    return (
        f"{search.prefix}{count} plugins offer the {search.kind} {search.name!r}: "
        f"{' and '.join(map(str, ranked))}\n  {_way_out(ranked)}"
    )


def unusable(search: Search, failure: PluginFailure) -> str:
    """Return the message about a name whose only owner failed."""
    return (
        f"{search.prefix}the {search.kind} {search.name!r} cannot be used, because its plugin"
        f" failed\n"
        f"  failed: {failure}"
    )


#: How a plugin and its installed entry points may differ in a component.
NOT_LISTED = "offers it, but its installed entry points do not list it"
NOT_OFFERED = "lists it in its installed entry points, but does not offer it"


def stale(search: Search, source: Source, difference: str) -> str:
    """Return the message about a name in which a plugin differs from its installed entry points."""
    return (
        f"{search.prefix}the {search.kind} {search.name!r} cannot be used: {source.provenance}"
        f" {difference}\n  {_way_to_install_again(source)}"
    )


def stale_plugin(source: Source, offers: Iterable[Offer]) -> str:
    """Return the message about all components in which a plugin differs from its installation."""
    names = ", ".join(map(_entry_point, offers))
    return (
        f"its installed entry points differ from what it offers: {names};"
        f" {_way_to_install_again(source)}"
    )


def _way_to_install_again(source: Source) -> str:
    """Return how to install a distribution again, from where it was installed."""
    distribution = source.provenance.distribution
    if folder := source.editable_folder():
        return f"install again: python -m pip install -e '{folder}'"
    if distribution in PACKAGES:
        return f"install again {install_command(distribution)}"
    return f"install again: python -m pip install --force-reinstall {distribution}"


def unknown_plugin(name: str, selection: Selection) -> str:
    """Return the message about a name on the allow-list that no distribution provides."""
    installed = {source.provenance.plugin for source in (*selection.allowed, *selection.hidden)}
    return (
        f"{selection.rule} names {name!r}, but no installed distribution has such a"
        f" plugin{nearest(name, installed)}"
    )


def _left_out(search: Search, selection: Selection) -> Iterable[str]:
    for source in selection.hidden:
        if source.advertised and (search.hook, search.name) in source.advertised:
            owner = source.provenance
            yield f"{owner} offers it, but {selection.rule} does not allow {owner.plugin}"
    if selection.hidden:
        owners = ", ".join(str(source.provenance) for source in selection.hidden)
        yield f"hidden, because {selection.rule} does not allow them: {owners}"
    yield from (unknown_plugin(name, selection) for name in selection.unknown)


def _of_other_kinds(search: Search, claims: Claims) -> Iterable[str]:
    for (hook, name), owners in sorted(claims.items()):
        if name == search.name and hook not in (search.hook, COMMAND_HOOK):
            yield f"{name!r} is {with_article(CATALOGUE[hook].kind)} of {owners[0]}, not {with_article(search.kind)}"


def _listed(owners_by_name: Mapping[str, Sequence[Provenance]]) -> str:
    return ", ".join(
        f"{name} of {' and '.join(map(str, owners))}" for name, owners in owners_by_name.items()
    )


def _way_out(owners: Sequence[Provenance]) -> str:
    registered = [owner.plugin for owner in owners if not owner.distribution]
    if registered:
        return f"leave out {' or '.join(registered)}, which this program registered"
    plugins = {owner.plugin for owner in owners}
    if len(plugins) < len(owners):
        return "uninstall all of them but one"
    without = " or ".join(sorted(plugins - set(CORE_PLUGINS)))
    return (
        f"uninstall all of them but one, or set OPIR_PLUGINS to the plugins to use, without"
        f" {without}"
    )


def described_error(error: BaseException) -> str:
    """Return an exception as one line: its class, its message, and the line of the plugin that
    raised it.
    """
    try:
        words = one_line(str(error))
    except Exception:
        words = ""
    place = _place(error)
    return f"{type(error).__name__}{f': {words}' if words else ''}{f' ({place})' if place else ''}"


def one_line(text: str) -> str:
    """Return a text in one line, cut after 300 characters, with control characters escaped."""
    line = "".join(
        char if char.isprintable() else repr(char)[1:-1] for char in " ".join(text.split())
    )
    return line if len(line) <= _LONGEST_WORDS else f"{line[:_LONGEST_WORDS]}…"


def place_of_frame(frame: FrameType) -> str:
    """Return the line that a thread executes, from its innermost frame, chosen as for a raised
    exception.
    """
    lines = []
    outer: FrameType | None = frame
    while outer is not None:
        lines.append((outer, outer.f_lineno))
        outer = outer.f_back
    return _place_among(reversed(lines))


def _place(error: BaseException) -> str:
    """Return the line of the traceback that is shown."""
    lines = []
    trace = error.__traceback__
    while trace is not None:
        lines.append((trace.tb_frame, trace.tb_lineno))
        trace = trace.tb_next
    return _place_among(lines)


def is_of_plugin(frame: FrameType) -> bool:
    """Return whether a frame is of a package outside the core, Python's own library, numpy and
    scipy.
    """
    return not _is_of_library(frame) and not _path_of(frame).is_relative_to(_CORE)


def _is_of_library(frame: FrameType) -> bool:
    """Return whether a frame is of Python's own library, numpy or scipy."""
    path = _path_of(frame)
    return (
        not _LIBRARIES.isdisjoint(path.parent.parts)
        or str(path).startswith("<frozen ")
        or _root_of(frame) in stdlib_module_names
    )


def _path_of(frame: FrameType) -> PurePath:
    return PurePath(frame.f_code.co_filename)


def _root_of(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__", "")).partition(".")[0]


def _place_among(lines: Iterable[tuple[FrameType, int]]) -> str:
    """Return the innermost line of the first package outside the core, else the innermost line of
    the core.

    Lines of the host, of Python's own library, of numpy and scipy do not count.
    """
    of_core = ""
    of_plugin = ""
    package = None
    for frame, number in lines:
        path = _path_of(frame)
        folder = path.parent.parts
        is_machinery = any(folder[-len(names) :] == names for names in _MACHINERY)
        if _is_of_library(frame) or is_machinery:
            continue
        line = f"{'/'.join(path.parts[-2:])}, line {number}"
        if path.is_relative_to(_CORE):
            of_core = line
            continue
        package = package or _root_of(frame)
        of_plugin = line if _root_of(frame) == package else of_plugin
    return of_plugin or of_core
