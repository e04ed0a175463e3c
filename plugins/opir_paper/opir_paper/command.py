"""`opir paper`: tables, plain data or a page of the paper's figures, or the scene that is
simulated.
"""

import argparse
import json
import re
import sys
from collections import Counter
from collections.abc import Sequence
from html import escape

import yaml
from attrs import asdict

from opir_core.cli import table
from opir_core.errors import Problem, SceneError
from opir_paper.check import CORRECTED, HOLDS, NOT_REPRODUCED, NOTIONAL, TAKEN_OVER, Check
from opir_paper.errata import errata, text_of
from opir_paper.figure_checks import checks
from opir_paper.simulated import scene

_HEAD = ("§", "figure", "paper", "formula", "simulated", "verdict")
_ERRATA_HEAD = ("§", "the paper says", "its formulas give", "what opir does")


def paper(arguments: argparse.Namespace) -> int:
    """Print what the arguments ask for; the exit code is 1 if a figure is not reproduced."""
    if not 0 <= arguments.seed < 2**63:
        raise SceneError([Problem("--seed", "must be from 0 to 2**63 - 1")], source="command line")
    if arguments.scene:
        sys.stdout.write(yaml.safe_dump(dict(scene(arguments.seed)), sort_keys=False))
        return 0
    figures = checks(arguments.seed)
    if arguments.json:
        text = json.dumps([asdict(check) for check in figures], indent=2, ensure_ascii=False)
    elif arguments.html:
        text = _page(figures, arguments.seed)
    else:
        rows = [check.cells() for check in figures]
        words = "Words and reasons: opir paper --html > paper.html"
        text = f"{table(_HEAD, rows)}\n\n{summary(figures)} {words}"
    sys.stdout.write(text + "\n")
    return int(any(check.verdict == NOT_REPRODUCED for check in figures))


def summary(figures: Sequence[Check]) -> str:
    """Return how many figures have which verdict, in a sentence."""
    count = Counter(check.verdict for check in figures)
    listed = ", ".join(
        f"{count[verdict]} {_PLURAL.get(verdict, verdict)}"
        for verdict in _VERDICTS
        if count[verdict]
    )
    return f"{len(figures)} figures: {listed}."


_VERDICTS = (HOLDS, CORRECTED, NOTIONAL, TAKEN_OVER, NOT_REPRODUCED)

#: Verdicts in the plural.
_PLURAL = {HOLDS: "hold", NOTIONAL: "differ: notional"}


def _page(figures: Sequence[Check], seed: int) -> str:
    rows = _html_table(_HEAD, [check.cells() for check in figures])
    words = _html_table(
        _ERRATA_HEAD, [tuple(map(_plain, erratum.values())) for erratum in errata()]
    )
    return text_of("page.html").format(
        summary=summary(figures), seed=seed, figures=rows, errata=words
    )


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
