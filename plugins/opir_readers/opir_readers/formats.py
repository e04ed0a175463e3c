"""The formats that are read: how each is recognised, and a small file of it."""

import re
from collections.abc import Mapping
from typing import Any

from attrs import Factory, frozen

from opir_core.plugin import FileReader, deferred, nested, text
from opir_readers.configs_of_sites import SITE_HELP, SiteConfig, start_setting
from opir_readers.detections.formats import DETECTIONS
from opir_readers.flights.formats import FLIGHTS
from opir_readers.orbits.formats import ORBITS
from opir_readers.reader_calls import reads

#: The keyword that every Orbit Ephemeris Message begins with.
FIRST_KEYWORD = "CCSDS_OEM_VERS"

#: Without backtracking (`*+`), which would take exponential time at a file of blank lines.
_OEM_HEAD = re.compile(rf"([^\S\n]*(COMMENT[^\n]*|#[^\n]*)?\n)*+[^\S\n]*{FIRST_KEYWORD}")
_OTHER_HEADS = re.compile(r"\s*(CCSDS_|<|\{|\[|stk\.v\.|#[cd][PV ]|%PDF|PK\x03|[12] \d{5}[A-Z ])")

COLUMNS_HELP = (
    "columns of a text with other names, by quantity and unit: {time_s: T, lat: Latitude, lon:"
    " Longitude, height_ft: ALT}. Times in s, ms, min, h; lengths in m, km, ft, nmi; speeds in m_s,"
    " km_s, ft_s, km_h, kn; velocities as vx_ecef, vy_ecef, vz_ecef, vx_inertial, vy_inertial,"
    " vz_inertial, or v_east, v_north, v_up. With a site also east, north, up; downrange and height"
    " or altitude, the height above the site"
)
OBJECT_HELP = "OBJECT_NAME or OBJECT_ID, for an OEM with several objects"


def columns_setting() -> Any:
    """Return the field of a column map."""
    return nested(
        default=Factory(dict),
        check=deferred("opir_readers.columns.map_complaint"),
        help=COLUMNS_HELP,
    )


@frozen
class ReadCsvConfig:
    """The settings of the reader `csv`."""

    columns: Mapping[str, str] = columns_setting()
    start_s: float | None = start_setting()
    site: SiteConfig | None = nested(default=None, help=SITE_HELP)


@frozen
class ReadOemConfig:
    """The settings of the reader `oem`."""

    object: str | None = text(default=None, help=OBJECT_HELP)


def _is_csv(text: str) -> bool:
    from opir_readers.csv_layout import is_table
    from opir_readers.likeness import likeness

    if _OTHER_HEADS.match(text) or likeness(text):
        return False
    if any(reader.recognises(text) for reader in READERS if reader.name != "csv"):
        return False
    return is_table(text) or not text.strip()


TRAJECTORIES = (
    FileReader(
        name="csv",
        summary="lines of numbers below a line of names, parted by commas, semicolons, tabs or"
        " blanks, or JSON records",
        config=ReadCsvConfig,
        build=reads("csv_table", "csv_table", "start_s", "columns", "site", "epoch_us"),
        recognises=_is_csv,
        example="time_s,x_ecef_km,y_ecef_km,z_ecef_km\n0,-2643.878,-4579.332,3566.637\n10,-2644.469,-4580.355,3567.568\n",
    ),
    FileReader(
        name="oem",
        summary="CCSDS Orbit Ephemeris Message, keyword form",
        config=ReadOemConfig,
        build=reads("oem_table", "oem_table", "epoch_us", "object"),
        recognises=lambda text: _OEM_HEAD.match(text) is not None,
        example="""CCSDS_OEM_VERS = 2.0
CREATION_DATE = 2026-04-01T00:00:00
ORIGINATOR = EXAMPLE
META_START
OBJECT_NAME = ONE
OBJECT_ID = 2026-001A
CENTER_NAME = EARTH
REF_FRAME = ITRF
TIME_SYSTEM = UTC
START_TIME = 2026-04-01T12:00:00
STOP_TIME = 2026-04-01T12:00:10
META_STOP
2026-04-01T12:00:00 -2643.878 -4579.332 3566.637 -0.053 -0.091 0.083
2026-04-01T12:00:10 -2644.469 -4580.355 3567.568 -0.065 -0.114 0.104
""",
    ),
    FileReader(
        name="stk",
        summary="STK ephemeris (.e), Earth-fixed, inertial or of date, or latitude, longitude,"
        " altitude",
        build=reads("stk_table", "stk_table", "epoch_us"),
        recognises=lambda text: text.lstrip().lower().startswith("stk.v."),
        example="""stk.v.4.3
BEGIN Ephemeris
NumberOfEphemerisPoints 2
ScenarioEpoch 1 Apr 2026 12:00:00.000000
CentralBody Earth
CoordinateSystem Fixed
EphemerisTimePosVel
0 -2643878 -4579332 3566637 -53 -91 83
10 -2644469 -4580355 3567568 -65 -114 104
END Ephemeris
""",
    ),
)

#: All readers of this package.
READERS = (*TRAJECTORIES, *FLIGHTS, *ORBITS, *DETECTIONS)
