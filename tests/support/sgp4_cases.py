"""The verification cases that the sgp4 package carries (Vallado, Crawford, Hujsak and Kelso, AIAA
2006-6753).
"""

from itertools import pairwise
from pathlib import Path

import sgp4

US_PER_DAY = 86_400_000_000

_FOLDER = Path(sgp4.__file__).parent
_LINES = (_FOLDER / "SGP4-VER.TLE").read_text().splitlines()

#: Two-line element sets by catalogue number.
TLE = {
    first[2:7].strip(): (first[:69], second[:69])
    for first, second in pairwise(_LINES)
    if first.startswith("1 ")
}

#: The kinds of orbit that SGP4 tells apart.
KINDS = {
    "low": "06251",
    "eccentric": "00005",
    "deep": "23599",
    "geosynchronous": "24208",
    "half a day": "08195",
}


def published_km():
    """Return minutes since epoch and position in km, by catalogue number, as published."""
    tables = {}
    for line in (_FOLDER / "tcppver.out").read_text().splitlines():
        if "xx" in line:
            number = line.split()[0].zfill(5)
            tables.setdefault(number, [])
        else:
            tables[number].append([float(word) for word in line.split()[:4]])
    return tables


def epoch_of(satellite):
    """Return the midnight before the epoch of the elements, in microseconds since 1970, and seconds
    from there.
    """
    day = int(satellite.jdsatepoch - 2440587.5)
    return day * US_PER_DAY, (
        satellite.jdsatepoch - 2440587.5 - day + satellite.jdsatepochF
    ) * 86400.0
