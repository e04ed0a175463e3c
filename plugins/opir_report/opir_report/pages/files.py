"""The files of a report: the page, and beside it a folder with the data of its figures."""

from pathlib import Path

from opir_core.output import OutputFiles
from opir_report.pages.page import ReportPage


def write_page(page: ReportPage, path: Path, *, with_data: bool) -> list[Path]:
    """Write a page and the data of its figures, all or none; return the files. Raises `SinkError`
    if that fails.
    """
    data = {
        figure.name: figure.data
        for figure in page.figures()
        if figure.data is not None and with_data
    }
    folder = path.with_suffix(".data")
    paths = [folder / f"{name}.parquet" for name in data]
    with OutputFiles(folder=folder, is_made_up=True) if data else OutputFiles() as files:
        for place, columns in zip(paths, data.values(), strict=True):
            with files.writing(place, "data", is_made_up=True) as temporary:
                columns.write(temporary)
        files.write(path, page.html(folder.name if with_data else None).encode(), "report")
    return [path, *paths]
