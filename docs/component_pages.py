"""The page of all components: their settings, those that a kind shares once."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from attrs import asdict, evolve, fields, frozen

from opir_core.host.components import CATALOGUE, Component, Constellation, plural
from opir_core.host.host import Host
from opir_core.scene.field_rows import FieldRow, field_rows, named_values, shown
from opir_core.scene.target_classes import TargetClass

HEAD = "| key | default | unit, range | meaning | source of the default |\n|---|---|---|---|---|"
SHORT_HEAD = "| key | default here | source of the default |\n|---|---|---|"
#: So many satellites of a fleet are listed one by one.
_FEW = 6
#: A setting that so many components of a kind, and half of them, have is listed once for all.
_MANY = 3

PHOTONS = ("classification", "detection", "imagers", "movers", "radiometry")
PLUGINS = [
    *PHOTONS,
    "dsp",
    "sbirs",
    "nextgen",
    "heo",
    "leo",
    "trackers",
    "readers",
    "export",
    "displays",
    "studies",
    "dask",
    "render",
    "report",
    "coverage",
]


def components_page() -> str:
    """Return the page of all components of the core and of the constellations beside it."""
    host = Host.discover(PLUGINS)
    parts = [
        "# Components",
        "",
        (
            "What the core and the constellations beside it offer, by kind. Defaults whose source is"
            " *notional* are"
        ),
        "made up, plausible, and no real system's.",
    ]
    for hook, kind in CATALOGUE.items():
        names = host.names(hook)
        if names:
            shared = shared_of([host.component(hook, name) for name in names])
            parts += [
                "",
                f"## {plural(kind.kind).capitalize()}",
                *shared_lines(plural(kind.kind), shared),
                *(line for name in names for line in entry(host, hook, name, shared)),
            ]
    return "\n".join([*parts, ""])


@frozen
class Shared:
    """What components of a kind have in common: table rows by key, and what values stand for."""

    rows: Mapping[str, str]
    values: Sequence[str]


def shared_of(offered: Sequence[object]) -> Shared:
    """Return the settings that many components of a kind have with one meaning.

    Each has the default that most of them give it.
    """
    variants: dict[str, list[FieldRow]] = {}
    settings = [rows for each in offered if (rows := settings_of(each))]
    for row in chain.from_iterable(settings):
        variants.setdefault(row.key, []).append(row)
    most = max(_MANY, len(settings) / 2)
    values = Counter(chain.from_iterable(map(value_lines, offered)))
    return Shared(
        {
            key: Counter(map(table_row, rows)).most_common(1)[0][0]
            for key, rows in variants.items()
            if len(rows) >= most and len({(row.bounds, row.help) for row in rows}) == 1
        },
        [line for line, count in values.items() if count >= most],
    )


def shared_lines(kinds: str, shared: Shared) -> Iterator[str]:
    """Yield the table of shared settings, once for all components of a kind."""
    if shared.rows:
        yield from (
            "",
            (
                f"{kinds.capitalize()} share these settings. Below, each lists its own, and those that"
                " have another default."
            ),
            "",
            HEAD,
            *shared.rows.values(),
            *chain.from_iterable(("", line) for line in shared.values),
        )


def value_lines(offered: object) -> Iterator[str]:
    """Yield what texts in a component's settings stand for."""
    if isinstance(offered, Component) and settings_of(offered):
        for text, value in named_values(offered.config).items():
            yield f"`{text}` stands for `{shown(value)}`."


def settings_of(offered: object) -> Sequence[FieldRow]:
    """Return the settings of a component, nested ones below their parent."""
    if isinstance(offered, Component) and not isinstance(offered, Constellation | TargetClass):
        rows = list(field_rows(offered.config))
        parents = {row.key.rpartition(".")[0] for row in rows}
        return [
            evolve(row, default="as below") if row.key in parents and row.default else row
            for row in rows
        ]
    return []


def placed(satellite: Mapping[str, Any]) -> str:
    """Return where a satellite is, in a few words."""
    if "orbital_slot_deg" in satellite:
        return f"at {satellite['orbital_slot_deg']:g}°"
    ((kind, elements),) = satellite["orbit"].items()
    if kind == "walker":
        return (
            f"({elements['total']}/{elements['planes']}/{elements['phasing']}, no."
            f" {elements['satellite']})"
        )
    return f"({kind}, " + ", ".join(f"{name}: {value:g}" for name, value in elements.items()) + ")"


def entry(host: Host, hook: str, name: str, shared: Shared) -> Iterator[str]:
    """Yield the lines of one component, without the settings that are as shared."""
    offered = host.component(hook, name)
    yield from (
        "",
        f"### `{name}`",
        "",
        f"{offered.summary}. From `{host.provenance(hook, name).distribution}`.",
    )
    if isinstance(offered, Constellation):
        satellites = [f"{row['id']} {placed(row)}" for row in offered.satellites]
        few = satellites if len(satellites) <= _FEW else [*satellites[:2], "…", satellites[-1]]
        slots = ", ".join(few)
        yield from ("", f"{len(satellites)} satellites with the model `{offered.model}`: {slots}.")
    elif isinstance(offered, TargetClass):
        yield from ("", *class_lines(offered))
    elif isinstance(offered, Component) and fields(offered.config):
        yield from setting_lines(settings_of(offered), shared.rows)
        for preset, values in offered.presets.items():
            settings = ", ".join(f"`{key}: {shown(value)}`" for key, value in values.items())
            yield from ("", f"Preset `{preset}`: {settings}.")
        for line in value_lines(offered):
            if line not in shared.values:
                yield from ("", line)


def setting_lines(settings: Sequence[FieldRow], shared: Mapping[str, str]) -> Iterator[str]:
    """Yield what a component has beside the shared settings, without, and with another default."""
    keys = {row.key for row in settings}
    lacking = [f"`{key}`" for key in shared if key not in keys and "." not in key]
    if lacking:
        yield from ("", f"It has no {', '.join(lacking)}.")
    own = [table_row(row) for row in settings if row.key not in shared]
    if own:
        yield from ("", HEAD, *own)
    differing = [row for row in settings if row.key in shared and shared[row.key] != table_row(row)]
    if differing:
        yield from ("", SHORT_HEAD)
        yield from (f"| `{row.key}` | {default_of(row)} | {row.source} |" for row in differing)


def class_lines(kind: TargetClass) -> Iterator[str]:
    """Yield what is reported of a target class, what follows burnout, and its profiles."""
    settings = asdict(kind.after_burnout)
    resembled = "" if kind.resembles == kind.reported_type else f" It resembles {kind.resembles}."
    yield (
        f"Reported type: {kind.reported_type}.{resembled} After burnout:"
        f" `{kind.after_burnout.model}`" + (f" {shown(settings)}." if settings else ".")
    )
    yield from (
        "",
        "| profile | burn time | burnout speed | range | peak | stages |",
        "|---|---|---|---|---|---|",
    )
    for profile in kind.profiles:
        limits = f"{profile.minimum_range_m / 1e3:g} to {profile.maximum_range_m / 1e3:g} km"
        plume = kind.plumes[profile.name]
        peaks = f"{shown(plume.peak_w_sr)} W/sr"
        cells = (
            profile.name,
            f"{profile.burn_time_s:g} s",
            f"{profile.burnout_speed_m_s:g} m/s",
            limits,
            peaks,
        )
        yield f"| {' | '.join(cells)} | {plume.stages} |"


def rows(config: type) -> Iterator[str]:
    """Yield a table row for each field of a configuration class, nested ones below their parent."""
    yield from map(table_row, field_rows(config))


def table_row(row: FieldRow) -> str:
    """Return the table row of a setting."""
    cells = (f"`{row.key}`", default_of(row), row.bounds, row.help, row.source)
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def default_of(row: FieldRow) -> str:
    """Return a setting's default as Markdown."""
    return row.default_text if row.is_required else f"`{row.default_text}`"
