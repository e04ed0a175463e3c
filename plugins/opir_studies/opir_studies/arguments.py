"""The arguments of `opir sweep`; nothing heavy is imported here."""

import argparse

from opir_scoring import add_score_settings

from opir_core.cli import add_dead_after, add_overrides


def _study_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the study or scene, what varies, the runs, the executor and the output."""
    parser.add_argument("study", metavar="STUDY|SCENE", help="a study (YAML), or a scene to vary")
    _repeatable(
        parser,
        "--vary",
        "PATH=VALUES",
        "vary a setting, e.g. sensors[*].scan_period_ms=50,100,200 or tracker=imm,kepler-arc;"
        " repeatable",
    )
    _repeatable(
        parser,
        "--condition",
        "PATH=VALUES",
        "a setting that nobody chooses, such as epoch or cloud: each design is answered in all"
        " of its values, in each and in the worst; repeatable",
        dest="conditions",
    )
    _add_common(parser)
    _number(parser, "--runs", "runs of each design (default: the study's, or 100)")
    _repeatable(
        parser,
        "--metric",
        "NAME",
        "a metric, a name or a block {NAME: settings}; repeatable (default: the study's, or"
        " latency and"
        " detection_by_time)",
        dest="metrics",
    )
    _running_arguments(parser)


def _running_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the output, the executor, the early stop and the figures shown."""
    parser.add_argument(
        "-o",
        "--out",
        metavar="FOLDER",
        help="where the study goes (default: its name, with -study)",
    )
    parser.add_argument(
        "--executor", metavar="NAME", help="where runs are made: processes (default), serial, dask"
    )
    _number(parser, "--workers", "number of workers (default: the executor's)")
    parser.add_argument(
        "--until",
        metavar="FIGURE:WIDTH",
        help="stop a design when half the 95 %% interval is narrow enough: latency_s:0.5%%, or"
        " latency_s:0.2 (s); `decided`: when every required share of launches is",
    )
    _number(parser, "--seed", "seed of the designs that are drawn (default 0)")
    _repeatable(
        parser,
        "--show",
        "FIGURE",
        "a figure that the table and the report begin with; repeatable (default: the first of"
        " each metric)",
    )
    _repeatable(
        parser,
        "--require",
        "'FIGURE >= VALUE'",
        "a bound of a figure's mean, with >= or <=, or a share of launches: 'region_km2 < 1000"
        " within 90 s in 90 %% of launches': a line in plots, and which designs meet it; repeatable",
        dest="requirements",
    )
    parser.add_argument("--json", action="store_true", help="print the results as JSON")
    _quiet(parser)


def sweep_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a study, and which combinations run."""
    _study_arguments(parser)
    parser.add_argument(
        "--design",
        metavar="NAME",
        help="factorial (default), one-at-a-time, latin-hypercube or sobol (sensitivity indices)",
    )
    _number(parser, "--samples", "samples of a Latin hypercube or of Sobol indices (default 20)")
    parser.add_argument(
        "--shard",
        metavar="I/N",
        help="make only the I-th of N parts of the runs, on machines without a common network;"
        " `opir merge` joins their folders",
    )
    _report_arguments(parser)


def _report_arguments(parser: argparse.ArgumentParser) -> None:
    """Add where the report and its figures go."""
    parser.add_argument(
        "--report", metavar="PAGE", help="write the report too, one HTML file (with opir-report)"
    )
    parser.add_argument(
        "--figures",
        metavar="FOLDER",
        help="write its figures and tables too, as files for a paper (with opir-report)",
    )


def optimise_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a study, the objective and the number of evaluations."""
    _study_arguments(parser)
    parser.add_argument(
        "--objective",
        metavar="'min|max FIGURE'",
        required=True,
        help="the figure whose mean is to be least or largest: 'max warning_time_s'",
    )
    _number(parser, "--evaluations", "designs that are evaluated (default 100)", default=100)
    parser.set_defaults(design=None, samples=None)


def rerun_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is made again, the output and the number of workers."""
    parser.add_argument(
        "source",
        metavar="FOLDER|MANIFEST",
        help="the folder of a study or of a run, or the manifest of a run",
    )
    parser.add_argument(
        "-o", "--out", metavar="FOLDER", help="where it goes (default: its name, with -again)"
    )
    _number(parser, "--workers", "number of worker processes")
    add_dead_after(parser)
    parser.add_argument("--json", action="store_true", help="print what differs as JSON")
    _quiet(parser)


def merge_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the folders of shards and the output."""
    parser.add_argument(
        "folders", metavar="FOLDER", nargs="+", help="the folders of `opir sweep --shard`"
    )
    parser.add_argument("-o", "--out", metavar="FOLDER", required=True, help="where the study goes")
    _number(parser, "--workers", "number of worker processes")
    _report_arguments(parser)
    add_dead_after(parser)
    _quiet(parser)


def compare_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scene, the trackers, the number of runs, the score settings and the output format."""
    parser.add_argument("scene", metavar="SCENE", help="a scene file (YAML)")
    parser.add_argument(
        "--tracker",
        metavar="NAME",
        action="append",
        dest="trackers",
        help="a tracker to score, a name or a YAML block; repeatable (default: the scene's)",
    )
    _repeatable(
        parser,
        "--vary",
        "PATH=VALUES",
        "score each tracker with each value of a setting, e.g."
        " tracker.association=jpda,gnn; repeatable, in all combinations",
    )
    _number(
        parser, "--runs", "runs of each tracker, with consecutive seeds (default 20)", default=20
    )
    _number(
        parser,
        "--workers",
        "number of worker processes (default 1; timings inflate with more than one)",
        default=1,
    )
    parser.add_argument(
        "--details", action="store_true", help="print all scores of each tracker too"
    )
    _add_common(parser)
    add_score_settings(parser)


def tune_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scene, the wanted errors, the number of runs and the output format."""
    parser.add_argument("scene", metavar="SCENE", help="a scene file (YAML)")
    _repeatable(
        parser,
        "--error",
        "NAME=VALUE",
        "an error that the run may have against the most exact settings, e.g. impact_km=1,"
        " p_d=1e-3,"
        " line_of_sight_urad=1 or latency_s=0.1; repeatable",
        dest="errors",
    )
    _number(parser, "--runs", "runs of each setting (default 3)", default=3)
    _add_common(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")


def _add_common(parser: argparse.ArgumentParser) -> None:
    add_overrides(parser)
    add_dead_after(parser)


def _number(
    parser: argparse.ArgumentParser, flag: str, words: str, default: int | None = None
) -> None:
    """Add a flag with a whole number."""
    parser.add_argument(flag, metavar="N", type=int, default=default, help=words)


def _repeatable(
    parser: argparse.ArgumentParser, flag: str, metavar: str, words: str, dest: str | None = None
) -> None:
    """Add a flag that may be given several times."""
    parser.add_argument(flag, metavar=metavar, action="append", default=[], help=words, dest=dest)


def _quiet(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
