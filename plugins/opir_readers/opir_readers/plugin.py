"""Targets whose trajectories come from files; what reads them is imported when a scene names
one.
"""

import argparse
from collections.abc import Iterable, Sequence
from typing import Any

from opir_core.plugin import FileReader, TargetModel, hookimpl
from opir_readers.configs import AscentConfig, TableConfig
from opir_readers.formats import READERS


@hookimpl
def opir_target_models() -> Iterable[TargetModel]:
    """Yield `table` and `ascent`."""
    yield TargetModel(
        name="ascent",
        summary="a space launch: two burns with a dark gap into orbit, or the booster of one that"
        " lands",
        config=AscentConfig,
        build=_ascent,
    )
    yield TargetModel(
        name="table",
        summary="a trajectory from a file: a table of states, CSV or CCSDS OEM",
        config=TableConfig,
        build=_table,
    )


@hookimpl
def opir_readers() -> Iterable[FileReader]:
    """Yield the readers."""
    return READERS


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir import`."""
    parser = commands.add_parser(
        "import", help="show what is read from a file, and write it for a scene"
    )
    parser.add_argument(
        "file",
        metavar="FILE",
        help="a file of states: CSV, OEM, or what a plugin reads; gzip or not",
    )
    parser.add_argument(
        "--as", metavar="FORMAT", dest="format", help="name of the reader (default: by content)"
    )
    parser.add_argument(
        "--columns",
        metavar="MAP",
        help='columns by quantity and unit: time_s=T,lat=LAT,height_ft="Altitude (ft)"',
    )
    parser.add_argument(
        "--start-s", metavar="S", type=float, help="scene time of time 0 of the file"
    )
    parser.add_argument("--object", metavar="NAME", help="object of an OEM with several")
    parser.add_argument(
        "--site",
        metavar="LAT,LON[,HEIGHT[,AZIMUTH]]",
        help="launch point of local places, deg and m; e.g. --site=28.6,-80.6,3",
    )
    parser.add_argument(
        "--noise-m", metavar="M", type=float, help="smooth positions of this standard deviation, m"
    )
    parser.add_argument(
        "--burns", choices=("acceleration", "all"), help="where burns are from (default: the file)"
    )
    parser.add_argument(
        "--out", metavar="PATH", help="write the states as CSV, in ECEF, from time 0 on"
    )
    parser.add_argument(
        "--type", metavar="CLASS", default="ICBM", help="target class in the block that is shown"
    )
    fleet = parser.add_argument_group("sensors from a file of elements (OMM, TLE)")
    fleet.add_argument(
        "--sensors", metavar="MODEL", help="write the satellites as sensors of a model, for a scene"
    )
    fleet.add_argument("--name", metavar="PATTERN", help="only names like this, with * and ?")
    fleet.add_argument("--inclination", metavar="LOW:HIGH", help="only these inclinations, deg")
    fleet.add_argument("--numbers", metavar="N[:M],…", help="only these catalogue numbers")
    fleet.add_argument(
        "--max-age-days", metavar="D", type=float, help="only elements within D days of --epoch"
    )
    fleet.add_argument("--epoch", metavar="TIME", help="the scene's epoch, for --max-age-days")
    parser.set_defaults(run=_import, group="data")
    _track_arguments(commands.add_parser("track", help="track the detections of another program"))


def _track_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file",
        metavar="FILE",
        help="lines of sight: opir's events, CSV, TDM, or what a plugin reads",
    )
    parser.add_argument(
        "--sensors",
        metavar="SENSORS",
        required=True,
        help="the sensors that made them: a scene, a YAML file with sensors alone, or names of"
        " constellations",
    )
    parser.add_argument(
        "--as", metavar="FORMAT", dest="format", help="name of the reader (default: by content)"
    )
    parser.add_argument(
        "--columns",
        metavar="MAP",
        help="columns of a CSV by quantity and unit: time_s=T,azimuth_deg=AZ",
    )
    parser.add_argument(
        "--start-s", metavar="S", type=float, help="scene time of time 0 of the file"
    )
    parser.add_argument(
        "--rename",
        metavar="THEIRS=OURS",
        action="append",
        default=[],
        help="id of a sensor in --sensors; repeatable",
    )
    parser.add_argument(
        "--tracker", metavar="NAME", help="tracker (default: that of the scene, else imm)"
    )
    parser.add_argument(
        "--set",
        metavar="PATH=VALUE",
        action="append",
        default=[],
        dest="overrides",
        help="override a scene's value",
    )
    parser.add_argument(
        "-o", "--out", metavar="PATH", default="tracked.jsonl", help="events with their tracks"
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    parser.set_defaults(run=_track, group="data")


def _track(arguments: argparse.Namespace) -> int:
    from opir_readers.detections.command import track_file

    return track_file(arguments)


def _import(arguments: argparse.Namespace) -> int:
    from opir_readers.import_command import import_file

    return import_file(arguments)


def _ascent(configs: Sequence[AscentConfig], context: Any) -> Any:
    from opir_readers.ascents import ascent_targets

    return ascent_targets(configs, context)


def _table(configs: Sequence[TableConfig], context: Any) -> Any:
    from opir_readers.table_targets import table_targets

    return table_targets(configs, context)
