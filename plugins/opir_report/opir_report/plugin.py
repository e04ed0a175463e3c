"""The command `opir report` and views of runs; matplotlib is imported when one is used."""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from opir_core.plugin import RunView, deferred, hookimpl

_SUMMARY = "write a report of a run or a study, one HTML file with plots"


@hookimpl
def opir_run_views() -> Iterable[RunView]:
    """Yield `plot`, `map` and `report`."""
    yield RunView(
        name="plot",
        summary="plots of a run with matplotlib, `run.plot.map()` for instance",
        build=deferred("opir_report.run_plots.RunPlots"),
    )
    yield RunView(
        name="map",
        summary="the map of a run's launches, an svg element for notebooks",
        build=deferred("opir_report.run_plots.map_svg"),
    )
    yield RunView(
        name="report",
        summary="a function that writes the report of a run, which `run.report(PATH)` calls",
        build=_report_writer,
    )


def _report_writer(run: Any) -> Callable[..., Any]:
    from opir_report.pages.run_report import report_of

    return partial(report_of, run)


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir report`."""
    parser = commands.add_parser("report", help=_SUMMARY)
    parser.add_argument(
        "paths",
        metavar="RUN_OR_STUDY",
        nargs="+",
        help="the events or the folder of a run, or the folder of a study; several studies are put"
        " side by side",
    )
    parser.add_argument(
        "-o",
        "--out",
        metavar="PATH",
        default="report.html",
        help="the report (default report.html; data beside it)",
    )
    parser.add_argument(
        "--no-data", action="store_true", help="do not write the data of the figures"
    )
    parser.add_argument(
        "--figures",
        metavar="FOLDER",
        help="write each figure for a paper, 7.2 inches wide, and the tables as LaTeX and Markdown",
    )
    parser.add_argument(
        "--formats",
        metavar="LIST",
        default="png,svg,pdf",
        help="formats of the figures (default png,svg,pdf)",
    )
    parser.set_defaults(run=deferred("opir_report.command.report"), group="look")
