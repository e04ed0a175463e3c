"""The command `opir coverage`, and the metric `coverage`.

Heavy modules are imported when used.
"""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from opir_core.cli import add_scene_arguments
from opir_core.plugin import MetricModel, deferred, hookimpl
from opir_coverage.metric_config import CoverageMetricConfig
from opir_coverage.number_lists import numbers_of

_SUMMARY = (
    "map who sees launches from where, how soon and how well: access, gaps, reports, tracks, bounds"
)


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir coverage`."""
    _add_coverage(commands)


@hookimpl
def opir_metrics() -> Iterable[MetricModel]:
    """Yield `coverage`."""
    yield MetricModel(
        name="coverage",
        summary="number of sensors, share of the Earth covered, on average and always, and the"
        " longest gap over a day",
        config=CoverageMetricConfig,
        build=deferred("opir_coverage.metric.coverage_metric"),
    )


def _add_coverage(commands: Any) -> None:
    parser = commands.add_parser("coverage", help=_SUMMARY)
    add_scene_arguments(parser)
    add = parser.add_argument
    _add_grid(add)
    _add_launches(add)
    add("--geometry", action="store_true", help="access and gaps only, no launches")
    add(
        "--against",
        metavar="SCENE",
        help="another scene: the page and the data are of the first minus this one",
    )
    add("--json", action="store_true", help="print the table as JSON")
    add(
        "-o",
        "--out",
        metavar="FOLDER",
        default="coverage",
        help="folder of page and data (default coverage)",
    )
    parser.set_defaults(run=deferred("opir_coverage.command.coverage"), group="study")


def _add_grid(add: Callable[..., Any]) -> None:
    """Add class and heights of targets, cells, instants and numbers of sensors."""
    add(
        "--class",
        dest="target_class",
        metavar="NAME",
        default="ICBM",
        help="class of the launches (default ICBM)",
    )
    add("--profile", default="", metavar="NAME", help="profile of the class (default: its first)")
    add(
        "--height",
        metavar="KM,…",
        type=numbers_of,
        default=(10.0, 100.0),
        help="heights of targets (default 10,100)",
    )
    add(
        "--grid",
        metavar="DEG",
        type=float,
        default=2.0,
        help="step of the grid, degrees (default 2)",
    )
    add(
        "--hours",
        type=float,
        default=24.0,
        help="length of the interval from the scene's epoch (default 24)",
    )
    add(
        "--steps",
        type=int,
        default=96,
        metavar="N",
        help="instants of the interval for access and gaps (default 96)",
    )
    add(
        "--assets",
        metavar="N,…",
        type=partial(numbers_of, kind=int),
        default=(1, 2),
        help="least numbers of sensors in view (default 1,2)",
    )


def _add_launches(add: Callable[..., Any]) -> None:
    """Add azimuths and instants of launches, and the requirements."""
    add(
        "--azimuth",
        metavar="DEG,…",
        type=numbers_of,
        default=(0.0,),
        help="launch azimuths (default 0: north)",
    )
    add(
        "--launches",
        type=int,
        default=2,
        metavar="N",
        help="instants of launches in the interval (default 2)",
    )
    add(
        "--chance",
        type=float,
        default=0.9,
        metavar="P",
        help="probability of times to a report (default 0.9)",
    )
    add(
        "--track-reports",
        type=int,
        default=4,
        metavar="N",
        help="reports that make a track (default 4)",
    )
    add(
        "--require",
        action="append",
        default=[],
        metavar="LAYER<=X",
        help="share of the day that meets it; repeatable",
    )
