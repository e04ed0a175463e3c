"""`opir physics min-intensity`: the minimum detectable radiant intensity, for each unit that the
NEI may have.
"""

import argparse
import sys
from contextlib import suppress

UNITS = {"W/m2": 1.0, "W/cm2": 1e4}


def least_intensity_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the quantities."""
    add = parser.add_argument
    add("--nei", type=_positive, default=5e-14, help="noise-equivalent irradiance (default 5e-14)")
    add("--unit", choices=UNITS, help="unit of --nei (default: print the result for each unit)")
    add("--range-km", type=_positive, default=36_000.0, help="range (default 36000)")
    add(
        "--transmittance", type=_fraction, default=1.0, help="of the atmosphere, (0, 1] (default 1)"
    )
    add(
        "--snr",
        type=_positive,
        default=5.0,
        help="signal-to-noise ratio at the threshold (default 5)",
    )
    parser.set_defaults(run=least_intensity)


def least_intensity(arguments: argparse.Namespace) -> int:
    """Print the minimum intensity for each unit that the NEI may have."""
    from opir_photons.radiometry import minimum_detectable_intensity

    for unit in [arguments.unit] if arguments.unit else UNITS:
        nei_w_m2 = arguments.nei * UNITS[unit]
        least = minimum_detectable_intensity(
            nei_w_m2, arguments.range_km * 1e3, arguments.transmittance, arguments.snr
        )
        converted = "" if unit == "W/m2" else f" = {nei_w_m2:g} W/m2"
        sys.stdout.write(f"NEI {arguments.nei:g} {unit}{converted}: {float(least):.6g} W/sr\n")
    return 0


def _positive(text: str) -> float:
    with suppress(ValueError):
        value = float(text)
        if 0.0 < value < float("inf"):
            return value
    raise argparse.ArgumentTypeError(f"{text} is not a number above 0")


def _fraction(text: str) -> float:
    value = _positive(text)
    if value > 1.0:
        raise argparse.ArgumentTypeError(f"{text} is not in (0, 1]")
    return value
