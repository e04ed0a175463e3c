"""The formats of mean elements that are read, and a small file of each."""

from opir_core.plugin import FileReader, deferred
from opir_readers.orbits.fleet_config import FleetConfig
from opir_readers.reader_calls import reads

_FILES = "orbits.element_files"

ORBITS = (
    FileReader(
        name="omm",
        summary="CCSDS Orbit Mean-Elements Messages, one or many: JSON, CSV, KVN or XML",
        yields="orbits",
        build=reads(_FILES, "omm_elements"),
        recognises=deferred(f"opir_readers.{_FILES}.is_omm"),
        orbit=deferred("opir_readers.orbits.orbit_of_files.orbit_of_file"),
        fleet=FleetConfig,
        example="""[{"OBJECT_NAME": "ONE", "NORAD_CAT_ID": 1, "EPOCH": "2026-04-01T12:00:00", "MEAN_MOTION": 15.7,
 "ECCENTRICITY": 0.0007, "INCLINATION": 51.6, "RA_OF_ASC_NODE": 247.5, "ARG_OF_PERICENTER": 130.5,
 "MEAN_ANOMALY": 325.0, "BSTAR": 0.0001}]
""",
    ),
    FileReader(
        name="tle",
        summary="two-line elements, with or without lines of names",
        yields="orbits",
        build=reads(_FILES, "tle_elements"),
        recognises=deferred(f"opir_readers.{_FILES}.is_tle"),
        example="""ONE
1 25544U 98067A   26091.50000000  .00000000  00000-0  11606-4 0  9991
2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
""",
    ),
)
