"""Column maps as a command takes them."""

import re

from opir_core.errors import Problem, SceneError

_PAIR = re.compile(r"\s*([^=,]+?)\s*=\s*(\"[^\"]*\"|'[^']*'|[^,]*?)\s*(?:,|$)")


def columns_of_text(text: str) -> dict[str, str]:
    """Return the column map of `lat=Latitude,height_ft="Altitude (ft)"`; raises `SceneError` for what is none.

    >>> columns_of_text('time_s=T,height_ft="Altitude, ft"')
    {'time_s': 'T', 'height_ft': 'Altitude, ft'}
    """
    found, at = dict[str, str](), 0
    while at < len(text):
        match = _PAIR.match(text, at)
        if match is None:
            raise SceneError(
                [Problem("--columns", f"{text[at:]!r} is not of the form quantity=column")], source="import"
            )
        found[match[1]] = match[2].strip("\"'")
        at = match.end()
    return found
