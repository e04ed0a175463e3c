"""The command `opir report`; matplotlib is imported when it runs."""

import argparse
from typing import Any

from opir_core.plugin import hookimpl

_SUMMARY = "write a report of a run or a study, one HTML file with plots"


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir report`."""
    parser = commands.add_parser("report", help=_SUMMARY)
    parser.add_argument(
        "path", metavar="RUN_OR_STUDY", help="the events or the folder of a run, or the folder of a study"
    )
    parser.add_argument(
        "-o", "--out", metavar="PATH", default="report.html", help="the report (default report.html; data beside it)"
    )
    parser.add_argument("--no-data", action="store_true", help="do not write the data of the figures")
    parser.set_defaults(run=_report)


def _report(arguments: argparse.Namespace) -> int:
    from opir_report.command import report

    return report(arguments)
