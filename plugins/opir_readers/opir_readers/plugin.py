"""Targets whose trajectories come from files; readers are imported when a scene names one."""

import argparse
from collections.abc import Iterable
from typing import Any

from opir_core.plugin import FileReader, TargetModel, deferred, hookimpl
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
        build=deferred("opir_readers.ascents.ascent_targets"),
    )
    yield TargetModel(
        name="table",
        summary="a trajectory from a file: a table of states, CSV or CCSDS OEM",
        config=TableConfig,
        build=deferred("opir_readers.table_targets.table_targets"),
    )


@hookimpl
def opir_readers() -> Iterable[FileReader]:
    """Yield the readers."""
    return READERS


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir import`."""
    _import_arguments(
        commands.add_parser(
            "import", help="show what is read from a file, and write it for a scene"
        )
    )
    _track_arguments(commands.add_parser("track", help="track the detections of another program"))


def _import_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "file",
        metavar="FILE",
        help="a file of states: CSV, OEM, or what a plugin reads; gzip or not",
    )
    columns = 'columns by quantity and unit: time_s=T,lat=LAT,height_ft="Altitude (ft)"'
    _reading_arguments(parser, columns)
    add("--object", metavar="NAME", help="object of an OEM with several")
    add(
        "--site",
        metavar="LAT,LON[,HEIGHT[,AZIMUTH]]",
        help="launch point of local places, deg and m; e.g. --site=28.6,-80.6,3",
    )
    add("--noise-m", metavar="M", type=float, help="smooth positions of this standard deviation, m")
    add("--burns", choices=("acceleration", "all"), help="where burns are from (default: the file)")
    add("--out", metavar="PATH", help="write the states as CSV, in ECEF, from time 0 on")
    add("--type", metavar="CLASS", default="ICBM", help="target class in the block that is shown")
    add = parser.add_argument_group("sensors from a file of elements (OMM, TLE)").add_argument
    add(
        "--sensors", metavar="MODEL", help="write the satellites as sensors of a model, for a scene"
    )
    add("--name", metavar="PATTERN", help="only names like this, with * and ?")
    add("--inclination", metavar="LOW:HIGH", help="only these inclinations, deg")
    add("--numbers", metavar="N[:M],…", help="only these catalogue numbers")
    add("--max-age-days", metavar="D", type=float, help="only elements within D days of --epoch")
    add("--epoch", metavar="TIME", help="the scene's epoch, for --max-age-days")
    parser.set_defaults(run=deferred("opir_readers.import_command.import_file"), group="data")


def _reading_arguments(parser: argparse.ArgumentParser, columns: str) -> None:
    """Add the arguments of a reader; `columns` is the help of its column map."""
    add = parser.add_argument
    add("--as", metavar="FORMAT", dest="format", help="name of the reader (default: by content)")
    add("--columns", metavar="MAP", help=columns)
    add("--start-s", metavar="S", type=float, help="scene time of time 0 of the file")


def _track_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "file",
        metavar="FILE",
        help="lines of sight: opir's events, CSV, TDM, or what a plugin reads",
    )
    add(
        "--sensors",
        metavar="SENSORS",
        required=True,
        help="the sensors that made them: a scene, a YAML file with sensors alone, or names of"
        " constellations",
    )
    columns = "columns of a CSV by quantity and unit: time_s=T,azimuth_deg=AZ"
    _reading_arguments(parser, columns)
    add(
        "--rename",
        metavar="THEIRS=OURS",
        action="append",
        default=[],
        help="id of a sensor in --sensors; repeatable",
    )
    add(
        "--watched",
        metavar="FILE",
        help="when each sensor looked: a table of sensor_id, start_s, end_s, or the word throughout"
        " (default: the scene, the manifest beside the events, or the lines of each sensor)",
    )
    add("--tracker", metavar="NAME", help="tracker (default: that of the scene, else imm)")
    add(
        "--set",
        metavar="PATH=VALUE",
        action="append",
        default=[],
        dest="overrides",
        help="override a scene's value",
    )
    add("-o", "--out", metavar="PATH", default="tracked.jsonl", help="events with their tracks")
    add("-q", "--quiet", action="store_true", help="print nothing but errors")
    parser.set_defaults(run=deferred("opir_readers.detections.command.track_file"), group="data")
