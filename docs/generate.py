"""Writes the generated pages of the documentation: `python docs/generate.py`; with `--check`, says
which are stale.
"""

import io
import os
import re
import sys
from collections.abc import Mapping
from contextlib import redirect_stdout, suppress
from pathlib import Path
from unittest.mock import patch

from api_reference import api_pages
from claims import claims_page
from component_pages import HEAD, PLUGINS, components_page, rows
from modelled import modelled_pages

from opir_core.cli.main import main as opir
from opir_core.host.host import Host
from opir_core.reading.scene_schema import SceneFile
from opir_core.scene.links import Links
from opir_core.scene.scene import SceneDrag

DOCS = Path(__file__).resolve().parent


def pages() -> Mapping[Path, str]:
    """Return every generated page with its text."""
    from opir_http.reference import reference_page
    from opir_kafka.document import asyncapi_text
    from opir_paper import checks, errata_page, figures_page

    everything = Host.discover([*PLUGINS, "kafka", "stonesoup"])
    return {
        DOCS / "reference" / "scene.md": scene_page(),
        DOCS / "reference" / "components.md": components_page(),
        DOCS / "reference" / "commands.md": commands_page(),
        **{DOCS / "explanation" / name: text for name, text in modelled_pages(everything).items()},
        **{DOCS / "reference" / "api" / name: text for name, text in api_pages().items()},
        DOCS / "explanation" / "paper-errata.md": errata_page(),
        DOCS / "reference" / "paper-figures.md": figures_page(checks()),
        DOCS / "reference" / "claims.md": claims_page(),
        DOCS / "reference" / "http.md": reference_page(),
        DOCS
        / "reference"
        / "asyncapi.yaml": f"# Generated: python docs/generate.py\n{asyncapi_text()}",
    }


def scene_page() -> str:
    """Return the page of a scene file's keys."""
    from opir_readers.orbits.fleet_config import FleetConfig

    return "\n".join(
        [
            "# The scene file",
            "",
            (
                "The keys of a scene, read strictly: an unknown or repeated key, an alias, a tag, a NaN"
                " or a number out of"
            ),
            (
                "its range is refused, all problems in one message, each with its path and line. `--set"
                " path=value`"
            ),
            (
                "sets any of them and goes through the same checks. What a component's block may hold"
                " is on the page of"
            ),
            "[components](components.md).",
            "",
            HEAD,
            *rows(SceneFile),
            "",
            "`links` has the settings of [links](../how-to/links.md):",
            "",
            HEAD,
            *rows(Links),
            "",
            (
                "`forces` is what acts on targets between burnout and impact: `kepler`, or a list out"
                " of `j2`, `j3` and"
            ),
            (
                "`j4` (the zonal harmonics of EGM96) and `drag`: `[j2, drag]`. Aims, impacts and what"
                " trackers predict"
            ),
            (
                "are under these forces. The air turns with the Earth. A target's block may give a"
                " ballistic coefficient"
            ),
            (
                "of its own. Drag has settings, as in `[j2, {drag: {ballistic_coefficient_kg_m2:"
                " 2000}}]`:"
            ),
            "",
            HEAD,
            *rows(SceneDrag),
            "",
            (
                "An item of `sensors` is `{constellation: NAME, ...}`, whose other keys apply to all"
                " its satellites,"
            ),
            "`{model: NAME, fleet: {...}, ...}`, a sensor for each satellite of",
            "[a file](../how-to/import-flights.md#sensors-from-files) or of",
            "[a pattern](../how-to/map-coverage.md#a-constellation-by-its-pattern), or",
            "`{model: NAME, id: ID, ...}`. An item of `targets` is",
            "`{id: ID, type: CLASS, ...}`, where `type` is a",
            (
                "[target class](components.md#target-classes); without `model` it has the target model"
                " of its class. Its"
            ),
            (
                "`signature`, a name or a block of `model` and settings, says how brightly it radiates;"
                " without one it is"
            ),
            (
                "`plume`. An item of `sources` is `{id: ID, model: NAME, ...}`; its emitters are called"
                " ID-1, ID-2 and so"
            ),
            (
                "on. Signatures, atmosphere and background are built where the detection model looks at"
                " them; `constant`"
            ),
            (
                "does not. An item of `outputs` is a sink's name, or `{NAME: {...}}`. Wherever a"
                " component has presets,"
            ),
            "`preset: NAME` starts from one.",
            "",
            (
                "The settings of `fleet`, which `opir-readers` reads: one of `file`, `walker` and"
                " `slots`, and filters:"
            ),
            "",
            HEAD,
            *rows(FleetConfig),
            "",
        ]
    )


def commands_page() -> str:
    """Return the page of the commands: what each prints for `--help`."""
    main = helped()
    names = re.findall(r"^    ([a-z][a-z-]+)(?:  |$)", main, re.MULTILINE)
    head = (
        "# Commands\n\nWhat can I type? `opir COMMAND --help` prints these texts.\n\nGenerated by"
        f" `python docs/generate.py`, with all packages of this project.\n\n```text\n{main}\n```\n"
    )
    return "\n".join([head, *(f"## {name}\n\n```text\n{helped(name)}\n```\n" for name in names)])


def helped(*words: str) -> str:
    """Return the help of `opir`, or of one of its commands."""
    text = io.StringIO()
    settings = {
        "COLUMNS": "100",
        "OPIR_PLUGINS": "bench,coverage,export,http,kafka,paper,readers,report,studies,testing",
    }
    with patch.dict(os.environ, settings), redirect_stdout(text), suppress(SystemExit):
        opir([*words, "--help"])
    return "\n".join(line.rstrip() for line in text.getvalue().strip().splitlines())


def main() -> int:
    """Write the pages, or check them."""
    made = pages()
    stale = [
        path
        for path, text in made.items()
        if not path.exists() or path.read_text(encoding="utf-8") != text
    ]
    for path in stale:
        print(f"{'stale' if '--check' in sys.argv else 'written'}: {path.relative_to(DOCS.parent)}")
        if "--check" not in sys.argv:
            path.parent.mkdir(exist_ok=True)
            path.write_text(made[path], encoding="utf-8")
    return 1 if stale and "--check" in sys.argv else 0


if __name__ == "__main__":
    sys.exit(main())
