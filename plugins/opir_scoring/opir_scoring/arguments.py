"""The arguments of `opir score`; nothing heavy is imported here."""

import argparse


def score_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the run, its truth, the score settings and the output format."""
    parser.add_argument(
        "events",
        metavar="RUN",
        help="the events of a run; tracks and manifest are beside them; or the folder of a"
        " benchmark set",
    )
    parser.add_argument(
        "--truth", metavar="PATH", help="the run's truth (default: beside the events)"
    )
    parser.add_argument(
        "--tracks",
        metavar="PATH",
        help="tracks of these events, by any tracker (default: beside the events); of a set: CSV,"
        " JSON or Parquet",
    )
    parser.add_argument(
        "--case",
        metavar="NAME",
        action="append",
        default=[],
        help="of a benchmark set, score this case; repeatable",
    )
    parser.add_argument(
        "--manifest", metavar="PATH", help="the run's manifest (default: beside the events)"
    )
    add_score_settings(parser)


def add_score_settings(parser: argparse.ArgumentParser) -> None:
    """Add the score settings and the output format."""
    parser.add_argument(
        "--bin-s",
        type=float,
        default=20.0,
        help="bin width of the time since ignition, s (default 20)",
    )
    parser.add_argument(
        "--cutoff-m", type=float, default=5000.0, help="GOSPA cut-off distance c, m (default 5000)"
    )
    parser.add_argument("--order", type=float, default=2.0, help="GOSPA order p (default 2)")
    parser.add_argument(
        "--alpha", type=float, default=2.0, help="GOSPA alpha, in (0, 2] (default 2)"
    )
    parser.add_argument(
        "--launch-probability",
        type=float,
        default=0.5,
        help="a track with a greater P(launch) is taken as a launch (default 0.5)",
    )
    parser.add_argument(
        "--unknown",
        metavar="CLASS",
        action="append",
        default=[],
        help='a target class that the tracker does not know, for which "none of these" is right;'
        " repeatable",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
