"""The arguments of `opir physics`."""

import argparse
import math
from collections.abc import Callable
from typing import Any

from opir_coverage import numbers_of

from opir_core.cli import add_overrides
from opir_core.plugin import deferred

_CURVES = ("pd", "snr", "least-intensity", "first-report")
_AGAINST = ("height", "aspect", "elevation", "cloud", "climate")


def physics_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the quantities: a formula, and those of the bench."""
    quantities = parser.add_subparsers(metavar="QUANTITY", required=True, dest="quantity")
    _min_intensity(
        quantities.add_parser(
            "min-intensity", help="minimum detectable intensity, NEI R² SNR / transmittance"
        )
    )
    _add_budget(quantities)
    _add_curve(quantities)
    _on_bench(quantities, "roc", "P_d of one look against false alarms a day, by threshold")
    _on_bench(quantities, "false-alarms", "false alarms a day of each sensor by cause")
    _on_bench(quantities, "window", "transmittance of the air in the bands of a sensor, by height")
    _add_bands(quantities)
    _add_frames(quantities)


def _add_budget(quantities: Any) -> None:
    budget = _on_bench(
        quantities,
        "budget",
        "noise of one look by term and band, NEI, NEDT; or the steps of its SNR",
    )
    budget.add_argument(
        "--waterfall", action="store_true", help="steps of the SNR from source to decision, dB"
    )
    budget.add_argument(
        "--band",
        default="",
        metavar="NAME",
        help="band of --waterfall (default: the reference band)",
    )


def _add_curve(quantities: Any) -> None:
    curve = _on_bench(
        quantities, "curve", "P_d, SNR, least intensity or first report against a condition"
    )
    curve.add_argument(
        "--of",
        choices=_CURVES,
        default="least-intensity",
        help="quantity (default least-intensity)",
    )
    curve.add_argument(
        "--against", choices=_AGAINST, default="height", help="condition (default height)"
    )
    curve.add_argument(
        "--values", type=numbers_of, default=(), metavar="X,…", help="values of the condition"
    )


def _add_bands(quantities: Any) -> None:
    bands = _on_bench(
        quantities, "bands", "the best edges of a band for targets and a background, by a scan"
    )
    add = bands.add_argument
    add(
        "--heights",
        type=numbers_of,
        default=(),
        metavar="KM,…",
        help="heights; the worst counts (default: --height)",
    )
    add(
        "--edges",
        type=numbers_of,
        default=(),
        metavar="UM,…",
        help="edges to scan (default: those of LOWTRAN's table)",
    )
    add(
        "--least-width",
        type=float,
        default=0.0,
        metavar="UM",
        help="least width of a band (default 0)",
    )
    add(
        "--most-width",
        type=float,
        default=math.inf,
        metavar="UM",
        help="most width of a band (default: any)",
    )
    add("--most", type=int, default=12, metavar="N", help="bands to show (default 12)")


def _add_frames(quantities: Any) -> None:
    add = _on_bench(
        quantities,
        "frame",
        "simulated frames of a focal plane, with masks and labels",
        run=deferred("opir_bench.command.frame_command"),
    ).add_argument
    add("--band", default="", metavar="NAME", help="band of the frames (default: the first)")
    add(
        "--movie",
        type=int,
        default=0,
        metavar="N",
        help="a clip of N frames (default: one picture)",
    )
    add(
        "--every", type=float, metavar="S", help="time between frames, s (default: the scan period)"
    )
    add(
        "--clips", type=int, default=1, metavar="K", help="clips of --movie, each with its own seed"
    )
    add(
        "--snr",
        type=_two_numbers,
        metavar="LOW,HIGH",
        help="scale the target's light to a signal over noise between these"
        " (default: its own light)",
    )
    add("--pixels", type=int, default=128, metavar="N", help="pixels along a side (default 128)")
    add("--seed", type=int, default=1, help="seed of the noise and the background (default 1)")
    add(
        "-o", "--out", default="frame", metavar="FOLDER", help="folder of the files (default frame)"
    )


def _on_bench(
    quantities: Any, name: str, words: str, run: Callable[[argparse.Namespace], int] | None = None
) -> Any:
    parser = quantities.add_parser(name, help=words, description=f"{words[0].upper()}{words[1:]}.")
    add = parser.add_argument
    add(
        "scene",
        nargs="?",
        metavar="SCENE",
        help="a scene file (YAML); without one, sensor models alone",
    )
    add(
        "--sensor",
        action="append",
        default=[],
        metavar="NAME",
        help="id in the scene, or a model; repeatable",
    )
    _add_pose(add)
    add_overrides(parser)
    if run is None:
        add("--json", action="store_true", help="print JSON")
        add("--plot", metavar="FILE", help="draw it into a .png, .svg or .pdf")
    parser.set_defaults(run=run or deferred("opir_bench.command.physics"))
    return parser


def _add_pose(add: Callable[..., Any]) -> None:
    """Add the target class and its pose."""
    add(
        "--class",
        dest="classes",
        type=_names,
        default=("ICBM",),
        metavar="NAME,…",
        help="target class (default ICBM)",
    )
    add(
        "--height", type=float, default=20.0, metavar="KM", help="height of the target (default 20)"
    )
    add(
        "--elevation",
        type=float,
        default=40.0,
        metavar="DEG",
        help="of the sensor above its horizon (default 40)",
    )
    add(
        "--aspect",
        type=float,
        default=90.0,
        metavar="DEG",
        help="between flight and sensor (default 90: from the side)",
    )
    add(
        "--burned",
        type=float,
        default=0.4,
        metavar="SHARE",
        help="share of the burn that is over (default 0.4)",
    )
    add(
        "--speed",
        type=float,
        default=1000.0,
        metavar="M_S",
        help="of the target, m/s (default 1000)",
    )


def _min_intensity(parser: argparse.ArgumentParser) -> None:
    from opir_bench.least_intensity import least_intensity_arguments

    least_intensity_arguments(parser)


def _names(text: str) -> tuple[str, ...]:
    return tuple(text.split(","))


def _two_numbers(text: str) -> tuple[float, ...]:
    numbers = numbers_of(text)
    if len(numbers) != 2:
        raise argparse.ArgumentTypeError(f"{text!r} is no pair of numbers with a comma between")
    return numbers
