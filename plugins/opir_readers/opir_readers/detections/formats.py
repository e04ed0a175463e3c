"""The formats of detections that are read, and a small file of each."""

from collections.abc import Mapping

from attrs import Factory, frozen

from opir_core.plugin import FileReader, deferred, nested
from opir_readers.configs_of_sites import start_setting
from opir_readers.reader_calls import reads

SIGHTS_HELP = (
    "columns of a text with other names, by quantity and unit: {time_s: T, azimuth_deg: AZ,"
    " elevation_deg: EL}. Times as time_s or as dates, timestamp; directions as azimuth and"
    " elevation, right_ascension and declination, or los_x_ecef, los_y_ecef, los_z_ecef; places as"
    " sensor_x_ecef or sensor_lat; line_of_sight_sigma in urad, mrad, arcsec, deg"
)


@frozen
class SightsConfig:
    """The settings of the reader `sights`."""

    columns: Mapping[str, str] = nested(
        default=Factory(dict),
        check=deferred("opir_readers.detections.sights.sights_complaint"),
        help=SIGHTS_HELP,
    )
    start_s: float | None = start_setting()


DETECTIONS = (
    FileReader(
        name="events",
        summary="opir's events (JSON, one a line, or a list): lines of sight of sensors",
        yields="detections",
        build=reads("detections.events", "event_rows"),
        recognises=deferred("opir_readers.detections.events.is_of_events"),
        example="""{"timestamp":"2026-04-01T12:01:00.5Z","sensor_id":"A","azimuth_deg":10.1,"elevation_deg":-84.2}
{"timestamp":"2026-04-01T12:01:10.5Z","sensor_id":"A","azimuth_deg":10.2,"elevation_deg":-84.1}
""",
    ),
    FileReader(
        name="sights",
        summary="a table of lines of sight below a line of names: time, sensor_id, azimuth and"
        " elevation, or others",
        yields="detections",
        config=SightsConfig,
        build=reads("detections.sights", "sight_rows", "start_s", "columns"),
        recognises=deferred("opir_readers.detections.sights.is_of_sights"),
        example="time_s,sensor_id,azimuth_deg,elevation_deg\n60.5,A,10.1,-84.2\n70.5,A,10.2,-84.1\n",
    ),
    FileReader(
        name="tdm",
        summary="CCSDS Tracking Data Message, KVN or XML: angles of the types AZEL, RADEC, XEYN and"
        " XSYE",
        yields="detections",
        build=reads("detections.tdm", "tdm_rows"),
        recognises=deferred("opir_readers.detections.tdm.is_tdm"),
        example="""CCSDS_TDM_VERS = 2.0
CREATION_DATE = 2026-04-01T00:00:00
ORIGINATOR = EXAMPLE
META_START
TIME_SYSTEM = UTC
PARTICIPANT_1 = A
PARTICIPANT_2 = T1
MODE = SEQUENTIAL
PATH = 2,1
ANGLE_TYPE = AZEL
META_STOP
DATA_START
ANGLE_1 = 2026-04-01T12:01:00.5 10.1
ANGLE_2 = 2026-04-01T12:01:00.5 -84.2
DATA_STOP
""",
    ),
)
