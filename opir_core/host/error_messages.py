"""The messages about a component that is missing, has several owners or whose plugin failed, each
with the remedy.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import PurePath
from sys import stdlib_module_names
from types import FrameType

from attrs import frozen

from opir_core.errors import install_command, nearest, nearest_names, with_article
from opir_core.host.components import CATALOGUE, PluginFailure, Provenance, plural
from opir_core.host.discovery import COMMAND_HOOK, CORE_PLUGINS, Offer, Selection
from opir_core.scene.fields import LIGHT

_LONGEST_WORDS = 300
_CORE = PurePath(__file__).parent.parent
_LIBRARIES = frozenset({"numpy", "scipy"})
_MACHINERY = (PurePath(__file__).parent.parts[-2:], ("importlib",))

#: The packages of this project and what they advertise, for messages about what is not installed. A
#: test compares this table with the packages' metadata.
PACKAGES: Mapping[str, Sequence[str]] = {
    "opir-bench": ("commands.physics",),
    "opir-coverage": ("commands.coverage", "metrics.coverage"),
    "opir-dask": ("executors.dask",),
    "opir-dsp": ("constellations.DSP", "sensor_models.DSP"),
    "opir-export": (
        "commands.export",
        *("event_encoders.forge-c2", "event_encoders.udl"),
        *(
            "exporters.arrow",
            "exporters.csv",
            "exporters.czml",
            "exporters.geojson",
            "exporters.kml",
        ),
        *("exporters.oem", "exporters.parquet", "exporters.tdm", "sinks.parquet"),
        *("run_views.pandas", "run_views.polars", "run_views.tables"),
    ),
    "opir-heo": ("constellations.HEO-MOLNIYA", "constellations.HEO-TUNDRA", "sensor_models.HEO"),
    "opir-http": ("commands.doctor", "commands.serve", "commands.view"),
    "opir-kafka": ("commands.spool", "sinks.kafka"),
    "opir-leo": (
        *("constellations.LEO-MEDIUM", "constellations.LEO-WIDE"),
        *("sensor_models.LEO-MEDIUM", "sensor_models.LEO-WIDE"),
    ),
    "opir-nextgen": ("constellations.NEXTGEN-GEO", "sensor_models.NEXTGEN-GEO"),
    "opir-paper": ("commands.paper",),
    "opir-photons": (
        "atmosphere_models.lowtran",
        "background_models.earth",
        *("classifiers.spectral", "confidence_models.posterior"),
        "detection_models.snr",
        *("sensor_models.AHI", "sensor_models.GOES-ABI"),
        "signature_models.plume",
        *(
            "source_models.bolides",
            "source_models.fires",
            "source_models.flares",
            "source_models.glints",
        ),
    ),
    "opir-readers": (
        *("commands.import", "commands.track", "target_models.ascent", "target_models.table"),
        *("readers.csv", "readers.events", "readers.gpx"),
        *(
            "readers.kml",
            "readers.oem",
            "readers.oem-xml",
            "readers.omm",
            "readers.openrocket",
            "readers.rasaero",
        ),
        *(
            "readers.rocketpy",
            "readers.sights",
            "readers.sp3",
            "readers.stk",
            "readers.tdm",
            "readers.tle",
        ),
        "readers.webcast",
    ),
    "opir-render": ("renderers.compiled",),
    "opir-report": ("commands.report", "run_views.map", "run_views.plot"),
    "opir-sbirs": ("constellations.SBIRS-GEO", "sensor_models.SBIRS-GEO"),
    "opir-scoring": ("commands.score",),
    "opir-stonesoup": ("trackers.stonesoup",),
    "opir-studies": (
        *("commands.compare", "commands.optimise", "commands.sweep", "commands.tune"),
        *("executors.processes", "executors.serial"),
        *(
            "metrics.accuracy",
            "metrics.detection_by_time",
            "metrics.false_events",
            "metrics.impact_region",
        ),
        *("metrics.latency", "metrics.launch_error", "metrics.tracks", "metrics.warning_time"),
    ),
    "opir-testing": ("commands.check", "commands.new-plugin"),
    "opir-trackers": ("commands.prior", "trackers.imm", "trackers.kepler-arc"),
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
    hook = "opir_commands" if search.hook == COMMAND_HOOK else search.hook
    entry = f"{hook.removeprefix('opir_')}.{search.name}"
    for package, entries in PACKAGES.items():
        if entry in entries:
            yield way_to_install(package)


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


def unknown_plugin(name: str, selection: Selection) -> str:
    """Return the message about a name on the allow-list that no distribution provides."""
    known = {source.provenance.plugin for source in (*selection.allowed, *selection.hidden)}
    return (
        f"{selection.rule} names {name!r}, but no installed distribution has such a"
        f" plugin{nearest(name, known)}"
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
    path = PurePath(frame.f_code.co_filename)
    root = str(frame.f_globals.get("__name__", "")).partition(".")[0]
    if (
        not _LIBRARIES.isdisjoint(path.parent.parts)
        or str(path).startswith("<frozen ")
        or root in stdlib_module_names
    ):
        return False
    return not path.is_relative_to(_CORE)


def _place_among(lines: Iterable[tuple[FrameType, int]]) -> str:
    """Return the innermost line of the first package outside the core, else the innermost line of
    the core.

    Lines of the host, of Python's own library, of numpy and scipy do not count.
    """
    of_core = ""
    of_plugin = ""
    package = None
    for frame, number in lines:
        path = PurePath(frame.f_code.co_filename)
        line = f"{'/'.join(path.parts[-2:])}, line {number}"
        folder = path.parent.parts
        root = str(frame.f_globals.get("__name__", "")).partition(".")[0]
        if (
            not _LIBRARIES.isdisjoint(folder)
            or str(path).startswith("<frozen ")
            or root in stdlib_module_names
        ):
            continue
        if any(folder[-len(own) :] == own for own in _MACHINERY):
            continue
        if path.is_relative_to(_CORE):
            of_core = line
            continue
        package = package or root
        of_plugin = line if root == package else of_plugin
    return of_plugin or of_core
