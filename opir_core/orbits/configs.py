"""The `orbit:` block of a sensor: one of several kinds of orbit, named by its key.

All elements hold at the scene epoch, for which nodes may be given by their longitude on the Earth
(`lon_asc_node_deg`) or by their right ascension (`raan_deg`). Nothing heavy is imported here.
"""

import math
from collections.abc import Mapping
from typing import Any

from attrs import fields_dict, frozen

from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.orbits.elements import (
    CRITICAL_INCLINATION_RAD,
    synchronous_semi_major_axis_m,
    walker_complaint,
)
from opir_core.orbits.mean_elements import omm_complaint, tle_complaint
from opir_core.scene.fields import flag, nested, number, text

_RADIUS_KM = EARTH_EQUATORIAL_RADIUS_M * 1e-3


def _angle(text_of_help: str, default: float | None = 0.0) -> Any:
    return number(default=default, unit="deg", minimum=-360.0, maximum=360.0, help=text_of_help)


def _longitude(text_of_help: str) -> Any:
    return number(unit="deg", minimum=-180.0, maximum=360.0, help=text_of_help)


def _inclination(**default: Any) -> Any:
    return number(
        unit="deg",
        minimum=0.0,
        maximum=180.0,
        help="angle from the equator to the orbit's plane",
        **default,
    )


def _eccentricity(**default: Any) -> Any:
    return number(minimum=0.0, below=1.0, help="eccentricity", **default)


def _altitude() -> Any:
    return number(
        unit="km",
        above=0.0,
        maximum=400_000.0,
        help="height above the Earth's equatorial radius, 6378.137 km",
    )


def _node_longitude() -> Any:
    return _angle(
        "east longitude, at the scene epoch, of the ascending node: where the orbit's plane crosses"
        " the equator"
        " northwards; or give raan_deg",
        default=None,
    )


def _right_ascension() -> Any:
    return _angle(
        "right ascension of the ascending node, from the mean equinox of date (as in TEME); or give"
        " lon_asc_node_deg",
        default=None,
    )


def _require(*complaints: str | None) -> None:
    """Raise `ValueError` with all complaints, if there are any."""
    errors = [complaint for complaint in complaints if complaint]
    if errors:
        raise ValueError("; ".join(errors))


def _choice_complaint(config: Any, *names: str) -> str | None:
    """Return the complaint unless exactly one of the attributes is given."""
    settings = [name for name in names if getattr(config, name) is not None]
    if len(settings) == 1:
        return None
    if settings:
        return f"{' and '.join(settings)} exclude each other"
    return f"give one of {', '.join(names)}"


def _perigee_complaint(semi_major_axis_km: float, eccentricity: float) -> str | None:
    perigee_km = semi_major_axis_km * (1.0 - eccentricity)
    if perigee_km > _RADIUS_KM:
        return None
    return (
        f"the perigee is {perigee_km:.1f} km from the Earth's centre, inside the Earth"
        f" ({_RADIUS_KM} km)"
    )


@frozen
class SlotConfig:
    """A geosynchronous satellite; with inclination and eccentricity 0, a geostationary one."""

    lon_deg: float = _longitude("east longitude of the slot: the mean of the satellite's own")
    inclination_deg: float = _inclination(default=0.0)
    eccentricity: float = _eccentricity(default=0.0)
    arg_perigee_deg: float = _angle("angle from the ascending node to the perigee")
    mean_arg_latitude_deg: float = _angle(
        "argument of perigee plus mean anomaly at the scene epoch; 0: a circular orbit goes north"
        " over the slot then"
    )

    def __attrs_post_init__(self) -> None:
        _require(_perigee_complaint(synchronous_semi_major_axis_m(1.0) * 1e-3, self.eccentricity))


@frozen
class KeplerConfig:
    """Any closed orbit, by its Kepler elements at the scene epoch."""

    semi_major_axis_km: float = number(
        unit="km",
        above=_RADIUS_KM,
        maximum=400_000.0,
        plausible=(6500.0, 400_000.0),
        help="semi-major axis",
    )
    eccentricity: float = _eccentricity()
    inclination_deg: float = _inclination()
    lon_asc_node_deg: float | None = _node_longitude()
    raan_deg: float | None = _right_ascension()
    arg_perigee_deg: float = _angle("angle from the ascending node to the perigee")
    mean_anomaly_deg: float | None = _angle(
        "mean anomaly at the scene epoch; or give true_anomaly_deg", default=None
    )
    true_anomaly_deg: float | None = _angle(
        "true anomaly at the scene epoch; or give mean_anomaly_deg", default=None
    )

    def __attrs_post_init__(self) -> None:
        _require(
            _choice_complaint(self, "lon_asc_node_deg", "raan_deg"),
            _choice_complaint(self, "mean_anomaly_deg", "true_anomaly_deg"),
            _perigee_complaint(self.semi_major_axis_km, self.eccentricity),
        )


@frozen
class CircularConfig:
    """A circular orbit."""

    altitude_km: float = _altitude()
    inclination_deg: float = _inclination()
    lon_asc_node_deg: float | None = _node_longitude()
    raan_deg: float | None = _right_ascension()
    arg_latitude_deg: float = _angle(
        "angle from the ascending node to the satellite at the scene epoch"
    )

    def __attrs_post_init__(self) -> None:
        _require(_choice_complaint(self, "lon_asc_node_deg", "raan_deg"))


@frozen
class WalkerConfig:
    """One satellite of a Walker pattern of circular orbits; node and argument of latitude are the
    first satellite's.
    """

    total: int = number(minimum=1, maximum=100_000, help="satellites in the pattern")
    planes: int = number(
        minimum=1, maximum=100_000, help="orbit planes, each with the same number of satellites"
    )
    phasing: int = number(
        minimum=0,
        maximum=100_000,
        help="by how many units of 360/total deg a plane is ahead of the one before it",
    )
    kind: str = text(
        default="delta",
        choices=("delta", "star"),
        help="nodes spread over 360 deg (delta) or over 180 deg (star)",
    )
    satellite: int = number(
        minimum=1, maximum=100_000, help="number of the satellite, from 1, plane by plane"
    )
    altitude_km: float = _altitude()
    inclination_deg: float = _inclination()
    lon_asc_node_deg: float | None = _node_longitude()
    raan_deg: float | None = _right_ascension()
    arg_latitude_deg: float = _angle(
        "angle from the ascending node to the first satellite at the scene epoch"
    )

    def __attrs_post_init__(self) -> None:
        beyond = f"satellite: {self.satellite} is more than the {self.total} of the pattern"
        _require(
            _choice_complaint(self, "lon_asc_node_deg", "raan_deg"),
            walker_complaint(self.total, self.planes, self.phasing),
            beyond if self.satellite > self.total else None,
        )


@frozen
class MolniyaConfig:
    """An orbit of half a day that dwells about its apogee; every other apogee is over the given
    longitude.
    """

    apogee_lon_deg: float = _longitude(
        "east longitude of the apogee that is passed at apogee_time_s"
    )
    apogee_time_s: float = number(
        default=0.0,
        unit="s",
        minimum=-1e6,
        maximum=1e6,
        help="scene time at which the apogee is passed",
    )
    eccentricity: float = _eccentricity(
        default=0.74,
        source="notional; Molniya satellites: 0.71 to 0.74. The perigee is 528 km high",
    )
    inclination_deg: float = _inclination(
        default=math.degrees(CRITICAL_INCLINATION_RAD),
        source="the critical inclination, sin² i = 4/5, where the Earth's oblateness leaves the"
        " perigee where it is",
    )
    arg_perigee_deg: float = _angle(
        "angle from the ascending node to the perigee; 270: apogee in the north", 270.0
    )

    @property
    def turns_a_day(self) -> float:
        """Return the turns, in ECI, to one rotation of the Earth."""
        return 2.0

    def __attrs_post_init__(self) -> None:
        _require(
            _perigee_complaint(
                synchronous_semi_major_axis_m(self.turns_a_day) * 1e-3, self.eccentricity
            )
        )


@frozen
class TundraConfig(MolniyaConfig):
    """An orbit of a day that dwells about its apogee, always over the given longitude."""

    eccentricity: float = _eccentricity(
        default=0.27, source="notional, within the usual 0.2 to 0.3"
    )

    @property
    def turns_a_day(self) -> float:
        """Return the turns, in ECI, to one rotation of the Earth."""
        return 1.0


@frozen
class OmmFileConfig:
    """A file of orbits, and the satellite in it."""

    path: str = text(help="path of the file, relative to the working directory")
    satellite: str | None = text(
        default=None, help="name, id or number of the satellite, where the file holds several"
    )


@frozen
class OrbitFileConfig(OmmFileConfig):
    """A file of elements or of an ephemeris, and the satellite in it."""

    as_given: bool = flag(
        default=False,
        source="states that contradict gravity were read wrongly",
        help="take the states of an ephemeris as they are, though they contradict gravity",
    )


@frozen
class OrbitConfig:
    """The orbit of a sensor: exactly one of these blocks."""

    slot: SlotConfig | None = nested(default=None, help="a geosynchronous slot")
    kepler: KeplerConfig | None = nested(default=None, help="Kepler elements")
    circular: CircularConfig | None = nested(default=None, help="a circular orbit")
    walker: WalkerConfig | None = nested(default=None, help="a satellite of a Walker pattern")
    molniya: MolniyaConfig | None = nested(
        default=None, help="a highly elliptical orbit of half a day"
    )
    tundra: TundraConfig | None = nested(default=None, help="a highly elliptical orbit of a day")
    tle: tuple[str, str] | None = nested(
        default=None, check=tle_complaint, help="a two-line element set, for SGP4: [line 1, line 2]"
    )
    omm: Mapping[str, Any] | None = nested(
        default=None,
        check=omm_complaint,
        help="an Orbit Mean-Elements Message, for SGP4, by its CCSDS keywords",
    )
    omm_file: OmmFileConfig | None = nested(default=None, help="a JSON file of OMM, for SGP4")
    file: OrbitFileConfig | None = nested(
        default=None,
        help="a file of elements or an ephemeris, with opir-readers: OMM, TLE, OEM, SP3, STK",
    )

    def __attrs_post_init__(self) -> None:
        _require(_choice_complaint(self, *KINDS))


#: The kinds of orbit, in the order in which messages name them.
KINDS = tuple(fields_dict(OrbitConfig))
