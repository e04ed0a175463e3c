"""Column maps and launch points as a command takes them."""

import re

from opir_core.errors import Problem, SceneError
from opir_readers.configs_of_sites import SiteConfig

_PAIR = re.compile(r"\s*([^=,]+?)\s*=\s*(\"[^\"]*\"|'[^']*'|[^,]*?)\s*(?:,|$)")


def columns_of_text(text: str) -> dict[str, str]:
    """Return the column map of `lat=Latitude,height_ft="Altitude (ft)"`; raises `SceneError` for
    another text.

    >>> columns_of_text('time_s=T,height_ft="Altitude, ft"')
    {'time_s': 'T', 'height_ft': 'Altitude, ft'}
    """
    columns = {}
    at = 0
    while at < len(text):
        match = _PAIR.match(text, at)
        if match is None:
            raise SceneError(
                [Problem("--columns", f"{text[at:]!r} is not of the form quantity=column")],
                source="import",
            )
        columns[match[1]] = match[2].strip("\"'")
        at = match.end()
    return columns


def site_of_text(text: str) -> SiteConfig:
    """Return the launch point of `LAT,LON[,HEIGHT[,AZIMUTH]]`, deg and m; raises `SceneError` for
    another text.

    >>> site_of_text("28.5,-80.6,3,90").azimuth_deg
    90.0
    """
    names = ("lat_deg", "lon_deg", "height_m", "azimuth_deg")
    try:
        values = [float(word) for word in text.split(",")]
        if not 2 <= len(values) <= len(names):
            raise ValueError("2 to 4 numbers are needed")
        return SiteConfig(**dict(zip(names, values, strict=False)))
    except ValueError as error:
        words = f"{text!r} is no LAT,LON[,HEIGHT[,AZIMUTH]] in degrees and metres: {error}"
        raise SceneError([Problem("--site", words)], source="command line") from error
