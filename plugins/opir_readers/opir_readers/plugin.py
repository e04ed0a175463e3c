"""Targets whose trajectories come from files; what reads them is imported when a scene names one."""

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
        summary="a space launch: two burns with a dark gap into orbit, or the booster of one that lands",
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
    parser = commands.add_parser("import", help="show what is read from a file, and write it for a scene")
    parser.add_argument("file", metavar="FILE", help="a file of states: CSV, OEM, or what a plugin reads; gzip or not")
    parser.add_argument("--as", metavar="FORMAT", dest="format", help="name of the reader (default: by content)")
    parser.add_argument(
        "--columns",
        metavar="MAP",
        help='columns by quantity and unit: time_s=T,lat=LAT,height_ft="Altitude (ft)"',
    )
    parser.add_argument("--start-s", metavar="S", type=float, help="scene time of time 0 of the file")
    parser.add_argument("--object", metavar="NAME", help="object of an OEM with several")
    parser.add_argument("--out", metavar="PATH", help="write the states as CSV, in ECEF, from time 0 on")
    parser.add_argument("--type", metavar="CLASS", default="ICBM", help="target class in the block that is shown")
    parser.set_defaults(run=_import)


def _import(arguments: argparse.Namespace) -> int:
    from opir_readers.import_command import import_file

    return import_file(arguments)


def _ascent(configs: Sequence[AscentConfig], context: Any) -> Any:
    from opir_readers.ascents import ascent_targets

    return ascent_targets(configs, context)


def _table(configs: Sequence[TableConfig], context: Any) -> Any:
    from opir_readers.table_targets import table_targets

    return table_targets(configs, context)
