"""Constellations by pattern: the settings of a Walker pattern and of a ring of geostationary slots,
and their orbits.

Source of the notation i: T/P/F: J. G. Walker, J. Brit. Interplanetary Soc. 37 (1984), 559-572.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from attrs import frozen

from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2
from opir_core.plugin import number, text

#: The keywords of a satellite, by name.
Elements = Mapping[str, Any]

_TURN_DEG = 360.0


def _prefix(default: str) -> Any:
    return text(default=default, help="ids are this, a hyphen and the number of the satellite")


def _angle(words: str, default: float | None = None) -> Any:
    return number(default=default, unit="deg", minimum=-_TURN_DEG, maximum=_TURN_DEG, help=words)


def require_single(config: Any, names: Sequence[str], words: str) -> None:
    """Raise `ValueError` unless exactly one of several settings is given; with words if none is."""
    present = [name for name in names if getattr(config, name) is not None]
    if len(present) != 1:
        raise ValueError(f"{' and '.join(present)} exclude each other" if present else words)


@frozen
class WalkerFleetConfig:
    """A Walker pattern i: T/P/F of circular orbits, plane by plane."""

    total: int | None = number(
        default=None, minimum=1, maximum=10_000, help="satellites, T; or give per_plane"
    )
    per_plane: int | None = number(
        default=None, minimum=1, maximum=10_000, help="satellites in each plane"
    )
    planes: int = number(
        minimum=1, maximum=10_000, help="orbit planes, P, each with the same number of satellites"
    )
    phasing: int = number(
        minimum=0,
        maximum=10_000,
        help="by how many units of 360/T deg a plane is ahead of the one before it, F; P more is"
        " the same pattern",
    )
    kind: str = text(
        default="delta",
        choices=("delta", "star"),
        help="nodes spread over 360 deg (delta) or over 180 deg (star)",
    )
    node_spacing_deg: float | None = number(
        default=None,
        unit="deg",
        above=0.0,
        maximum=_TURN_DEG,
        help="angle from one node to the next (default: 360/P for delta, 180/P for star)",
    )
    altitude_km: float | None = number(
        default=None,
        unit="km",
        above=0.0,
        maximum=400_000.0,
        help="height above the Earth's equatorial radius, 6378.137 km; or give period_min",
    )
    period_min: float | None = number(
        default=None,
        unit="min",
        above=0.0,
        maximum=40_000.0,
        help="orbital period, two-body: 2 pi sqrt(a^3/mu)",
    )
    inclination_deg: float = number(
        unit="deg",
        minimum=0.0,
        maximum=180.0,
        help="angle from the equator to the orbits' planes, i",
    )
    raan_deg: float | None = _angle(
        "right ascension of the first ascending node, from the mean equinox of date; or give"
        " lon_asc_node_deg"
    )
    lon_asc_node_deg: float | None = _angle(
        "east longitude, at the scene epoch, of the first ascending node (default 0)"
    )
    arg_latitude_deg: float = _angle(
        "angle from the ascending node to the first satellite at the scene epoch", 0.0
    )
    prefix: str = _prefix("WALKER")

    def __attrs_post_init__(self) -> None:
        require_single(self, ("total", "per_plane"), "give total or per_plane")
        require_single(self, ("altitude_km", "period_min"), "give altitude_km or period_min")
        if self.raan_deg is not None and self.lon_asc_node_deg is not None:
            raise ValueError("raan_deg and lon_asc_node_deg exclude each other")
        if self.total is not None and self.total % self.planes:
            raise ValueError(
                f"{self.total} satellites cannot be shared evenly among {self.planes} planes"
            )
        if self._height_km() <= 0.0:
            raise ValueError(
                f"period_min: {self.period_min:g} min is that of an orbit inside the Earth"
            )

    def rows(self) -> list[Elements]:
        """Return `orbit` and the keywords that filters read of each satellite."""
        in_plane = self.per_plane or (self.total or 0) // self.planes
        unit_deg = _TURN_DEG / (in_plane * self.planes)
        spread_deg = _TURN_DEG if self.kind == "delta" else 0.5 * _TURN_DEG
        spacing_deg = self.node_spacing_deg or spread_deg / self.planes
        orbits = [
            self._orbit(
                plane * spacing_deg, (place * self.planes + plane * self.phasing) * unit_deg
            )
            for plane in range(self.planes)
            for place in range(in_plane)
        ]
        return list(_rows(self.prefix, self.inclination_deg, orbits))

    def _orbit(self, node_deg: float, phase_deg: float) -> Elements:
        """Return the orbit of the satellite with the node and the argument of latitude so far after
        those of the first one.
        """
        node = "lon_asc_node_deg" if self.raan_deg is None else "raan_deg"
        start_deg = self.raan_deg if self.raan_deg is not None else self.lon_asc_node_deg or 0.0
        settings = {
            "altitude_km": self._height_km(),
            "inclination_deg": self.inclination_deg,
            node: (start_deg + node_deg) % _TURN_DEG,
            "arg_latitude_deg": (self.arg_latitude_deg + phase_deg) % _TURN_DEG,
        }
        return {"circular": settings}

    def _height_km(self) -> float:
        if self.altitude_km is not None:
            return self.altitude_km
        motion_rad_s = 2.0 * math.pi / (60.0 * (self.period_min or 0.0))
        return 1e-3 * (math.cbrt(EARTH_MU_M3_S2 / motion_rad_s**2) - EARTH_EQUATORIAL_RADIUS_M)


@frozen
class SlotFleetConfig:
    """A ring of geostationary slots."""

    count: int = number(minimum=1, maximum=1_000, help="satellites")
    first_deg: float = number(
        unit="deg", minimum=-180.0, maximum=_TURN_DEG, help="east longitude of the first slot"
    )
    spacing_deg: float | None = number(
        default=None,
        unit="deg",
        minimum=-_TURN_DEG,
        maximum=_TURN_DEG,
        help="from one slot to the next, to the east (default: 360/count)",
    )
    prefix: str = _prefix("GEO")

    def rows(self) -> list[Elements]:
        """Return `orbit` and the keywords that filters read of each satellite."""
        spacing_deg = _TURN_DEG / self.count if self.spacing_deg is None else self.spacing_deg
        places = [
            (self.first_deg + number_ * spacing_deg + 180.0) % _TURN_DEG - 180.0
            for number_ in range(self.count)
        ]
        return list(_rows(self.prefix, 0.0, [{"slot": {"lon_deg": place}} for place in places]))


def _rows(prefix: str, inclination_deg: float, orbits: Sequence[Elements]) -> Iterator[Elements]:
    digits = len(str(len(orbits)))
    for count, orbit in enumerate(orbits, 1):
        name = f"{prefix}-{count:0{digits}d}"
        yield {
            "OBJECT_NAME": name,
            "NORAD_CAT_ID": count,
            "INCLINATION": inclination_deg,
            "orbit": orbit,
        }
