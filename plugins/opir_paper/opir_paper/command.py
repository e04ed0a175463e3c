"""`opir paper`: tables, plain data or a page of the paper's figures, or the scene that is
simulated.
"""

import argparse
import json
import re
import sys
from collections.abc import Sequence
from html import escape

import yaml
from attrs import asdict

from opir_core.cli import table
from opir_core.errors import Problem, SceneError
from opir_paper.check import CORRECTED, HOLDS, NOT_REPRODUCED, NOTIONAL, TAKEN_OVER, Check
from opir_paper.errata import errata
from opir_paper.figure_checks import checks
from opir_paper.simulated import scene

_HEAD = ("§", "figure", "paper", "formula", "simulated", "verdict")
_ERRATA_HEAD = ("§", "the paper says", "its formulas give", "what opir does")

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>The paper, checked</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
:root {{ color-scheme: light dark; }}
body {{ font: 16px/1.45 system-ui, sans-serif; max-width: 74rem; margin: 2rem auto; padding: 0 1rem; }}
table {{ border-collapse: collapse; margin: 1rem 0 2rem; }}
th, td {{ border-bottom: 1px solid color-mix(in srgb, currentColor 25%, transparent); padding: .3rem .7rem;
  text-align: left; vertical-align: top; }}
.corrected td:last-child {{ font-weight: 600; }}
.reproduced td:last-child {{ font-weight: 700; text-decoration: underline; }}
</style></head><body>
<h1>The paper, checked</h1>
<p>{summary} Seed {seed}; intervals of 99.9 %.</p>
<h2>Figures</h2>
{figures}
<h2>Errata</h2>
{errata}
</body></html>
"""


def paper(arguments: argparse.Namespace) -> int:
    """Print what the arguments ask for; the exit code is 1 if a figure is not reproduced."""
    if not 0 <= arguments.seed < 2**63:
        raise SceneError([Problem("--seed", "must be from 0 to 2**63 - 1")], source="command line")
    if arguments.scene:
        sys.stdout.write(yaml.safe_dump(dict(scene(arguments.seed)), sort_keys=False))
        return 0
    found = checks(arguments.seed)
    if arguments.json:
        text = json.dumps([asdict(check) for check in found], indent=2, ensure_ascii=False)
    elif arguments.html:
        text = _page(found, arguments.seed)
    else:
        rows = [check.cells() for check in found]
        text = (
            f"{table(_HEAD, rows)}\n\n{summary(found)} Words and reasons: opir paper --html >"
            f" paper.html"
        )
    sys.stdout.write(text + "\n")
    return int(any(check.verdict == NOT_REPRODUCED for check in found))


def summary(found: Sequence[Check]) -> str:
    """Return how many figures have which verdict, in a sentence."""
    number = {verdict: sum(check.verdict == verdict for check in found) for verdict in _VERDICTS}
    parts = [
        f"{count} {_PLURAL.get(verdict, verdict)}" for verdict, count in number.items() if count
    ]
    return f"{len(found)} figures: {', '.join(parts)}."


_VERDICTS = (HOLDS, CORRECTED, NOTIONAL, TAKEN_OVER, NOT_REPRODUCED)

#: Verdicts in the plural.
_PLURAL = {HOLDS: "hold", NOTIONAL: "differ: notional"}


def _page(found: Sequence[Check], seed: int) -> str:
    figures = _html_table(_HEAD, [check.cells() for check in found])
    words = _html_table(
        _ERRATA_HEAD, [tuple(map(_plain, erratum.values())) for erratum in errata()]
    )
    return _PAGE.format(summary=summary(found), seed=seed, figures=figures, errata=words)


def _plain(markdown: str) -> str:
    """Return text without the marks of Markdown."""
    return re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", markdown).replace("**", "").replace("`", "")


def _html_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [f"<tr>{''.join(f'<th>{escape(cell)}</th>' for cell in head)}</tr>"]
    for row in rows:
        cells = "".join(f"<td>{escape(cell)}</td>" for cell in row)
        lines.append(
            f'<tr class="{escape(row[-1].split()[-1].lower())}">{cells}</tr>'
            if head is _HEAD
            else f"<tr>{cells}</tr>"
        )
    return "<table>\n" + "\n".join(lines) + "\n</table>"
