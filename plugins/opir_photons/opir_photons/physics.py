"""`opir physics`: the minimum detectable radiant intensity, and the brightness temperature of a pixel."""

import argparse
import sys
from contextlib import suppress

from opir_core.plugin import Band
from opir_photons.radiometry import band_radiance, minimum_detectable_intensity, pixel_temperature_k

UNITS = {"W/m2": 1.0, "W/cm2": 1e4}


def physics_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the quantities."""
    quantities = parser.add_subparsers(metavar="QUANTITY", required=True)
    least = quantities.add_parser("min-intensity", help="minimum detectable intensity, NEI R² SNR / transmittance")
    least.add_argument("--nei", type=_positive, default=5e-14, help="noise-equivalent irradiance (default 5e-14)")
    least.add_argument("--unit", choices=UNITS, help="unit of --nei (default: print the result for each unit)")
    least.add_argument("--range-km", type=_positive, default=36_000.0, help="range (default 36000)")
    least.add_argument("--transmittance", type=_fraction, default=1.0, help="of the atmosphere, (0, 1] (default 1)")
    least.add_argument("--snr", type=_positive, default=5.0, help="signal-to-noise ratio at the threshold (default 5)")
    least.set_defaults(quantity=_print_least)
    pixel = quantities.add_parser("pixel-temperature", help="brightness temperature of a pixel with a point of light")
    pixel.add_argument("--irradiance", type=_positive, required=True, help="in-band, at the aperture, W/m2")
    pixel.add_argument("--behind-k", type=_positive, default=285.0, help="brightness of the neighbours (default 285)")
    pixel.add_argument("--lower-um", type=_positive, default=3.8, help="lower edge of the band (default 3.8)")
    pixel.add_argument("--upper-um", type=_positive, default=4.0, help="upper edge of the band (default 4.0)")
    pixel.add_argument("--pixel-urad", type=_positive, default=56.0, help="width of a pixel (default 56)")
    pixel.add_argument("--share", type=_fraction, default=0.5, help="of the light in that pixel, (0, 1] (default 0.5)")
    pixel.set_defaults(quantity=_print_pixel)


def physics(arguments: argparse.Namespace) -> int:
    """Print the quantity that was asked for."""
    code: int = arguments.quantity(arguments)
    return code


def _print_pixel(arguments: argparse.Namespace) -> int:
    """Print the brightness temperature of a pixel, and of its neighbours, K."""
    band = Band("band", arguments.lower_um, arguments.upper_um)
    behind = band_radiance(arguments.behind_k, band.lower_um, band.upper_um)
    lit = arguments.share * arguments.irradiance
    found = float(pixel_temperature_k(lit, behind, arguments.pixel_urad * 1e-6, band))
    sys.stdout.write(f"{found:.1f} K over {arguments.behind_k:g} K\n")
    return 0


def _print_least(arguments: argparse.Namespace) -> int:
    """Print the minimum intensity for each unit that the NEI may have."""
    for unit in [arguments.unit] if arguments.unit else UNITS:
        nei_w_m2 = arguments.nei * UNITS[unit]
        least = minimum_detectable_intensity(nei_w_m2, arguments.range_km * 1e3, arguments.transmittance, arguments.snr)
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
