"""Contradictions of the paper to itself or to known physics: words, and the pages of the
documentation.
"""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files

from opir_paper.check import Check

_FIGURES_HEAD = "| § | figure | paper | formula | simulated | verdict |\n|---|---|---|---|---|---|"

#: The chapters of the paper that share a table.
_CHAPTERS = {
    "Signal and sensors": "23",
    "Looks, detection, confidence": "4",
    "Tracks": "5",
    "Validation": "89",
}

Erratum = Mapping[str, str]


@cache
def errata() -> Sequence[Erratum]:
    """Return the errata in the paper's order by `section`, `says`, `gives` and `does`: the claim, its
    consequence, and the choice of opir.
    """
    rows: Sequence[Erratum] = json.loads(text_of("errata.json"))
    return rows


def text_of(name: str) -> str:
    """Return the text of a data file of this package."""
    return files("opir_paper").joinpath(name).read_text(encoding="utf-8")


def errata_page() -> str:
    """Return the page of the errata, Markdown."""
    return text_of("errata.md").format(
        rows="\n".join(_row(*erratum.values()) for erratum in errata())
    )


def figures_page(checks: Sequence[Check]) -> str:
    """Return the page of all checks, Markdown."""
    tables = []
    for title, chapters in _CHAPTERS.items():
        rows = [
            _row(*check.cells()) for check in checks if check.section.partition(".")[0] in chapters
        ]
        tables.append("\n".join([f"## {title}", "", _FIGURES_HEAD, *rows]))
    return text_of("figures.md").format(tables="\n\n".join(tables))


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"
