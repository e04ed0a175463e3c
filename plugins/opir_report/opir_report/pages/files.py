"""The files of a report: the page, and beside it a folder with the data of its figures."""

from pathlib import Path

from opir_core.errors import unwritable
from opir_report.pages.page import ReportPage


def write_page(page: ReportPage, path: Path, *, with_data: bool) -> list[Path]:
    """Write a page and the data of its figures; return the files. Raises `SinkError` where one cannot be written."""
    folder = path.with_suffix(".data")
    try:
        path.write_text(page.html(folder.name if with_data else None), encoding="utf-8")
    except OSError as error:
        raise unwritable("the report", path, error) from error
    written = [path]
    figures = [figure for figure in page.figures() if figure.data is not None] if with_data else []
    if figures:
        try:
            folder.mkdir(exist_ok=True)
        except OSError as error:
            raise unwritable("the data of the figures", folder, error) from error
    for figure in figures:
        place = folder / f"{figure.name}.parquet"
        assert figure.data is not None
        figure.data.write(place)
        written.append(place)
    return written
