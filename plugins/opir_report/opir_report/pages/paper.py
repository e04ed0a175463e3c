"""Figures and tables of a report as files for papers: PNG, SVG and PDF; tables as LaTeX and
Markdown.
"""

import re
from collections.abc import Sequence
from pathlib import Path

from opir_core.output import OutputFiles
from opir_report.canvas import print_bytes
from opir_report.pages.page import ReportPage, ReportTable

FORMS = ("png", "svg", "pdf")
_LATEX = {
    **{mark: f"\\{mark}" for mark in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "°": r"\textdegree{}",
    "µ": r"\textmu{}",
    "²": r"\textsuperscript{2}",
    "≥": r"$\geq$",
    "≤": r"$\leq$",
    "\N{NARROW NO-BREAK SPACE}": r"\,",
}
_NAME = re.compile(r"[^A-Za-z0-9]+")


def write_figures(page: ReportPage, folder: Path, forms: Sequence[str] = FORMS) -> list[Path]:
    """Write a report's figures and tables into a folder, all or none; return the files. `SinkError`
    if that fails.
    """
    contents = {
        f"{figure.name}.{form}": print_bytes(figure.draw, figure.height_in, form)
        for figure in page.figures()
        for form in forms
        if figure.draw is not None
    }
    for number, table in enumerate(page.tables(), start=1):
        name = f"table-{number}-{_file_words(table.caption)}"
        contents |= {
            f"{name}.md": markdown_table(table).encode(),
            f"{name}.tex": latex_table(table).encode(),
        }
    with OutputFiles() as files:
        files.make_folder(folder, parents=True)
        for name, content in contents.items():
            files.write(folder / name, content, "figure's")
    return [folder / name for name in contents]


def _file_words(caption: str) -> str:
    """Return up to 40 letters of a caption for the name of a file."""
    return _NAME.sub("-", caption.split(":")[0].lower()).strip("-")[:40]


def markdown_table(table: ReportTable) -> str:
    """Return a table as Markdown (GitHub's), with its caption above."""
    rows = [[cell.replace("|", r"\|") for cell in row] for row in (table.head, *table.rows)]
    lines = [f"| {' | '.join(row)} |" for row in rows]
    rule = f"|{'|'.join(['---', *['---:'] * (len(table.head) - 1)])}|"
    return "\n".join([table.caption, "", lines[0], rule, *lines[1:]]) + "\n"


def latex_table(table: ReportTable) -> str:
    r"""Return a table for LaTeX with the package `booktabs`, `\input` as it is."""
    head, *lines = (" & ".join(map(_latex, row)) + r" \\" for row in (table.head, *table.rows))
    columns = "l" + "r" * (len(table.head) - 1)
    return "\n".join(
        [
            r"\begin{table}",
            rf"\caption{{{_latex(table.caption)}}}",
            rf"\begin{{tabular}}{{{columns}}}",
            r"\toprule",
            head,
            r"\midrule",
            *lines,
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
            "",
        ]
    )


def _latex(text: str) -> str:
    """Return a text with its special characters escaped."""
    return "".join(_LATEX.get(character, character) for character in text)
