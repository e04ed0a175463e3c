"""The formats of mean elements that are read, and a small file of each."""

from collections.abc import Mapping, Sequence
from typing import Any

from opir_core.plugin import FileReader, ReaderContext
from opir_readers.orbits.fleet_config import FleetConfig


def _is_omm(text: str) -> bool:
    from opir_readers.orbits.element_files import is_omm

    return is_omm(text)


def _is_tle(text: str) -> bool:
    from opir_readers.orbits.element_files import is_tle

    return is_tle(text)


def _omm(_config: Any, context: ReaderContext) -> Sequence[Mapping[str, Any]]:
    from opir_readers.orbits.element_files import omm_elements

    return omm_elements(context.text)


def _tle(_config: Any, context: ReaderContext) -> Sequence[Mapping[str, Any]]:
    from opir_readers.orbits.element_files import tle_elements

    return tle_elements(context.text)


def _orbit(file: Any, epoch_us: int, readers: Sequence[FileReader]) -> Any:
    from opir_readers.orbits.orbit_of_files import orbit_of_file

    return orbit_of_file(file, epoch_us, readers)


ORBITS = (
    FileReader(
        name="omm",
        summary="CCSDS Orbit Mean-Elements Messages, one or many: JSON, CSV, KVN or XML",
        yields="orbits",
        build=_omm,
        recognises=_is_omm,
        orbit=_orbit,
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
        build=_tle,
        recognises=_is_tle,
        example="""ONE
1 25544U 98067A   26091.50000000  .00000000  00000-0  11606-4 0  9991
2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
""",
    ),
)
