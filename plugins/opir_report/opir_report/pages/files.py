"""The files of a report: the page, and beside it a folder with the data of its figures."""

from pathlib import Path

from opir_core.output import OutputFiles
from opir_report.pages.page import ReportPage


def write_page(page: ReportPage, path: Path, *, with_data: bool) -> list[Path]:
    """Write a page and the data of its figures, all or none; return the files. Raises `SinkError`
    if that fails.
    """
    figures = (
        {each.name: each.data for each in page.figures() if each.data is not None}
        if with_data
        else {}
    )
    folder = path.with_suffix(".data")
    written = [folder / f"{name}.parquet" for name in figures]
    with OutputFiles(folder=folder, is_made_up=True) if figures else OutputFiles() as files:
        for place, data in zip(written, figures.values(), strict=True):
            with files.writing(place, "data", is_made_up=True) as part:
                data.write(part)
        files.write(path, page.html(folder.name if with_data else None).encode(), "report")
    return [path, *written]
