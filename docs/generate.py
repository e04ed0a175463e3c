"""Writes the generated pages of the documentation: `python docs/generate.py`; with `--check`, says which are stale."""

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from api_reference import api_pages
from attrs import fields
from modelled import modelled_pages

from opir_core.plugin.components import CATALOGUE, Component, Constellation
from opir_core.plugin.description import field_rows, shown
from opir_core.plugin.host import Host
from opir_core.scene.reading.scene_schema import SceneFile
from opir_core.scene.scene import SceneDrag

DOCS = Path(__file__).resolve().parent
HEAD = "| key | default | unit, range | meaning | source of the default |\n|---|---|---|---|---|"
#: So many satellites of a fleet are told one by one.
_FEW = 6

PLUGINS = ["dsp", "sbirs", "nextgen", "heo", "leo", "trackers"]


def pages() -> Mapping[Path, str]:
    """Return every generated page with its text."""
    from opir_http.reference import reference_page
    from opir_kafka.document import asyncapi_text

    everything = Host.discover([*PLUGINS, "kafka", "stonesoup"])
    return {
        DOCS / "reference" / "scene.md": scene_page(),
        DOCS / "reference" / "components.md": components_page(),
        **{DOCS / "explanation" / name: text for name, text in modelled_pages(everything).items()},
        **{DOCS / "reference" / "api" / name: text for name, text in api_pages().items()},
        DOCS / "reference" / "http.md": reference_page(),
        DOCS / "reference" / "asyncapi.yaml": f"# Generated: python docs/generate.py\n{asyncapi_text()}",
    }


def scene_page() -> str:
    """Return the page of a scene file's keys."""
    return "\n".join(
        [
            "# The scene file",
            "",
            "The keys of a scene, read strictly: an unknown or repeated key, an alias, a tag, a NaN or a number out of",
            "its range is refused, all problems in one message, each with its path and line. `--set path=value`",
            "sets any of them and goes through the same checks. What a component's block may hold is on the page of",
            "[components](components.md).",
            "",
            HEAD,
            *rows(SceneFile),
            "",
            "`forces` is what acts on targets between burnout and impact: `kepler`, or a list out of `j2`, `j3` and",
            "`j4` (the zonal harmonics of EGM96) and `drag`: `[j2, drag]`. Aims, impacts and what trackers predict",
            "are under these forces. The air turns with the Earth. A target's block may give a ballistic coefficient",
            "of its own. Drag has settings, as in `[j2, {drag: {ballistic_coefficient_kg_m2: 2000}}]`:",
            "",
            HEAD,
            *rows(SceneDrag),
            "",
            "An item of `sensors` is `{constellation: NAME, ...}`, whose other keys apply to all its satellites, or",
            "`{model: NAME, id: ID, ...}`. An item of `targets` is `{id: ID, model: NAME, ...}`; without `model` it is",
            "`ballistic`. Its `signature`, a name or a block of `model` and settings, says how brightly it radiates;",
            "without one it is `plume`. An item of `sources` is `{id: ID, model: NAME, ...}`; its emitters are called",
            "ID-1, ID-2 and so on. Signatures, atmosphere and background are built where the detection model looks at",
            "them; `constant` does not. An item of `outputs` is a sink's name, or `{NAME: {...}}`. Wherever a",
            "component has presets, `preset: NAME` starts from one.",
            "",
        ]
    )


def components_page() -> str:
    """Return the page of all components of the core and of the constellations beside it."""
    host = Host.discover(PLUGINS)
    parts = [
        "# Components",
        "",
        "What the core and the constellations beside it offer, by kind. Defaults whose source is *notional* are",
        "made up, plausible, and no real system's.",
    ]
    for hook, kind in CATALOGUE.items():
        names = host.names(hook)
        if names:
            parts += [
                "",
                f"## {kind.kind.capitalize()}s",
                *(line for name in names for line in entry(host, hook, name)),
            ]
    return "\n".join([*parts, ""])


def placed(satellite: Mapping[str, Any]) -> str:
    """Return where a satellite is, in a few words."""
    if "orbital_slot_deg" in satellite:
        return f"at {satellite['orbital_slot_deg']:g}°"
    ((kind, elements),) = satellite["orbit"].items()
    if kind == "walker":
        return f"({elements['total']}/{elements['planes']}/{elements['phasing']}, no. {elements['satellite']})"
    return f"({kind}, " + ", ".join(f"{name}: {value:g}" for name, value in elements.items()) + ")"


def entry(host: Host, hook: str, name: str) -> Iterator[str]:
    """Yield the lines of one component."""
    offered = host.component(hook, name)
    yield from ("", f"### `{name}`", "", f"{offered.summary}. From `{host.provenance(hook, name).distribution}`.")
    if isinstance(offered, Constellation):
        satellites = [f"{row['id']} {placed(row)}" for row in offered.satellites]
        few = satellites if len(satellites) <= _FEW else [*satellites[:2], "…", satellites[-1]]
        slots = ", ".join(few)
        yield from ("", f"{len(satellites)} satellites with the model `{offered.model}`: {slots}.")
    elif isinstance(offered, Component) and fields(offered.config):
        yield from ("", HEAD, *rows(offered.config))
        for preset, values in offered.presets.items():
            told = ", ".join(f"`{key}: {shown(value)}`" for key, value in values.items())
            yield from ("", f"Preset `{preset}`: {told}.")


def rows(config: type) -> Iterator[str]:
    """Yield a table row for each field of a configuration class, nested ones below their parent."""
    for row in field_rows(config):
        default = row.default_text if row.is_required else f"`{row.default_text}`"
        cells = (f"`{row.key}`", default, row.bounds, row.help, row.source)
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def main() -> int:
    """Write the pages, or check them."""
    stale = [path for path, text in pages().items() if not path.exists() or path.read_text(encoding="utf-8") != text]
    for path in stale:
        print(f"{'stale' if '--check' in sys.argv else 'written'}: {path.relative_to(DOCS.parent)}")
    if "--check" not in sys.argv:
        for path in stale:
            path.write_text(pages()[path], encoding="utf-8")
    return 1 if stale and "--check" in sys.argv else 0


if __name__ == "__main__":
    sys.exit(main())
