"""An HTML page of sections with figures: self-contained, without scripts, light and dark, fit for
print.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from html import escape

from attrs import frozen
from matplotlib.figure import Figure

from opir_report.figure_data import FigureData
from opir_report.pages.html_page import html_page
from opir_report.palette import ROLES

_NUMBER = re.compile(r"-|[-+]?\d+(\.\d+)?(e[-+]\d+)?")
_COLOUR = re.compile("|".join(ROLES))


@frozen(eq=False)
class ReportFigure:
    """A figure: its id, the SVG, a caption that says what it shows, its data, and how to draw it
    anew at a height.
    """

    name: str
    svg: str
    caption: str
    data: FigureData | None = None
    draw: Callable[[Figure], object] | None = None
    height_in: float = 0.0


@frozen(eq=False)
class ReportTable:
    """A table: caption, column heads and rows of text; the first column heads the rows."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


@frozen(eq=False)
class ReportSection:
    """A section: id, title, an introduction as plain text, then figures and tables."""

    name: str
    title: str
    text: str
    parts: Sequence[ReportFigure | ReportTable] = ()


@frozen(eq=False, kw_only=True)
class ReportPage:
    """A page: title, a line below it, sentences that sum it up, sections, and the last line."""

    title: str
    subtitle: str
    summary: Sequence[str]
    sections: Sequence[ReportSection]
    footer: str

    def figures(self) -> list[ReportFigure]:
        """Return all figures of the page."""
        return [part for part in self._parts() if isinstance(part, ReportFigure)]

    def tables(self) -> list[ReportTable]:
        """Return all tables of the page."""
        return [part for part in self._parts() if isinstance(part, ReportTable)]

    def _parts(self) -> Iterator[ReportFigure | ReportTable]:
        for section in self.sections:
            yield from section.parts

    def html(self, data_folder: str | None) -> str:
        """Return the page as HTML; the figures' data are linked in `data_folder`, if there is
        one.
        """
        contents = "".join(
            f'<li><a href="#{section.name}">{escape(section.title)}</a></li>'
            for section in self.sections
        )
        summary = "".join(f"<li>{escape(line)}</li>" for line in self.summary)
        sections = "\n".join(_section(section, data_folder) for section in self.sections)
        body = f"""<nav aria-label="Contents"><ol>{contents}</ol></nav>
<main>
<section id="summary" aria-label="Summary"><ul class="summary">{summary}</ul></section>
{sections}
</main>"""
        return html_page(self.title, self.subtitle, body, self.footer)


def _section(section: ReportSection, data_folder: str | None) -> str:
    parts = "\n".join(
        _figure(part, data_folder) if isinstance(part, ReportFigure) else _table(part)
        for part in section.parts
    )
    text = f"<p>{escape(section.text)}</p>\n" if section.text else ""
    head = f"<h2>{escape(section.title)}</h2>"
    return f'<section id="{section.name}">\n{head}\n{text}{parts}\n</section>'


def _figure(figure: ReportFigure, data_folder: str | None) -> str:
    link = ""
    if data_folder is not None and figure.data is not None:
        path = f"{data_folder}/{figure.name}.parquet"
        link = f' <a href="{escape(path)}">Data: {escape(path)}</a>'
    caption = f"<figcaption>{escape(figure.caption)}{link}</figcaption>"
    scroll = (
        f'<div class="scroll" role="region" aria-label="Figure {escape(figure.name)}" tabindex="0">'
    )
    body = f"{scroll}{themed(figure.svg)}</div>\n{caption}"
    return f'<figure id="figure-{figure.name}">\n{body}\n</figure>'


def _table(table: ReportTable) -> str:
    head = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in table.head)
    rows = "\n".join(_row(row) for row in table.rows)
    return (
        f'<div class="scroll" role="region" aria-label="{escape(table.caption)}"'
        f' tabindex="0"><table>'
        f"<caption>{escape(table.caption)}</caption>\n<thead><tr>{head}</tr></thead>\n<tbody>{rows}</tbody></table></div>"
    )


def _row(row: Sequence[str]) -> str:
    cells = "".join(f"<td{_kind(cell)}>{escape(cell)}</td>" for cell in row[1:])
    return f'<tr><th scope="row">{escape(row[0])}</th>{cells}</tr>'


def _kind(cell: str) -> str:
    """Return the class of a cell that is a number, perhaps with a unit and an interval, or the sign
    for none.
    """
    return ' class="n"' if _NUMBER.fullmatch(cell.partition(" ")[0]) else ""


def themed(svg: str) -> str:
    """Return an SVG with the palette's colours as CSS variables, which differ in dark mode."""
    return _COLOUR.sub(lambda match: f"var(--{ROLES[match[0]][0]}, {match[0]})", svg)
