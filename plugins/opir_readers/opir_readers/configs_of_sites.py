"""The launch point of files whose places are local. Nothing heavy is imported here."""

from typing import Any

from attrs import frozen

from opir_core.plugin import number, text


@frozen
class SiteConfig:
    """Where a file's local places count from."""

    lat_deg: float = number(
        unit="deg", minimum=-90.0, maximum=90.0, help="geodetic latitude of the launch point"
    )
    lon_deg: float = number(
        unit="deg", minimum=-180.0, maximum=360.0, help="east longitude of the launch point"
    )
    height_m: float = number(
        default=0.0,
        unit="m",
        minimum=-500.0,
        maximum=20_000.0,
        help="its height above the WGS 84 ellipsoid",
    )
    azimuth_deg: float | None = number(
        default=None,
        unit="deg",
        minimum=-360.0,
        maximum=360.0,
        help="direction of flight over the ground at the launch point, clockwise from north: for"
        " files of distances downrange, or of speeds alone",
    )


SITE_HELP = (
    "launch point of a file whose places are local: east, north and up, downrange and altitude, or"
    " speed alone"
)


def noise_setting() -> Any:
    """Return the field of the noise that a smoothing spline takes out."""
    return number(
        default=None,
        unit="m",
        minimum=0.0,
        maximum=1e5,
        help="standard deviation of the file's positions, per axis: a spline smooths them to it;"
        " default: as they are",
    )


def burns_setting() -> Any:
    """Return the field of where burns are from."""
    return text(
        default=None,
        choices=("acceleration", "all"),
        help="acceleration: burns are what the accelerations show; all: it burns from the first"
        " state to the last; default: what the file states",
    )


def start_setting() -> Any:
    """Return the field of the scene time of a text's time 0."""
    return number(
        default=None,
        unit="s",
        minimum=-1e13,
        maximum=31_557_600.0,
        help="scene time of time 0 of a file whose times are no dates; default 0",
    )
