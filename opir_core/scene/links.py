"""The links of a scene: ground stations, relay satellites, and how sensors send their reports."""

import math

from attrs import frozen

from opir_core.scene.faults import require_span
from opir_core.scene.fields import nested, number, text

#: In a path: any other satellite of the scene, in the order of sensors, then relays.
ANY = "any"


@frozen
class GroundStation:
    """A ground station, which receives where a satellite is above its elevation mask."""

    id: str = text(help="name of the station in paths", source="")
    lat_deg: float = number(
        unit="deg", minimum=-90.0, maximum=90.0, help="geodetic latitude", source=""
    )
    lon_deg: float = number(
        unit="deg", minimum=-180.0, maximum=360.0, help="east longitude", source=""
    )
    height_m: float = number(
        default=0.0,
        unit="m",
        minimum=-500.0,
        maximum=9000.0,
        help="height above the ellipsoid",
        source="0: on the ellipsoid",
    )
    mask_deg: float = number(
        default=5.0,
        unit="deg",
        minimum=-10.0,
        below=90.0,
        help="least elevation of a satellite from which it receives",
        source="notional: 5 to 10 deg are usual",
    )
    delay_s: float = number(
        default=0.0,
        unit="s",
        minimum=0.0,
        maximum=86_400.0,
        help="time from the station to the users of reports",
        source="0: at once",
    )


@frozen
class RelaySatellite:
    """A geostationary satellite that only passes reports on."""

    id: str = text(help="name of the relay in paths", source="")
    lon_deg: float = number(
        unit="deg", minimum=-180.0, maximum=360.0, help="east longitude of its slot", source=""
    )
    delay_s: float = number(
        default=0.0,
        unit="s",
        minimum=0.0,
        maximum=86_400.0,
        help="time from the reception of a report to its transmission",
        source="0: it repeats what it receives",
    )


@frozen
class Downlink:
    """How sensors send reports: each has a transmitter of its own with a queue, first in, first out.

    >>> Downlink(rate_bytes_s=1000.0, message_bytes=500).service_s
    0.5
    """

    sensors: tuple[str, ...] = nested(
        default=(),
        help="ids of the sensors; none: all that no other downlink names",
        source="choice",
    )
    paths: tuple[tuple[str, ...], ...] = nested(
        default=(),
        help="ways to the ground, the preferred first: a station, or satellites and then a station;"
        f" `{ANY}` is any other satellite. A report takes the first that is open when it is sent",
        source="every station, directly",
    )
    rate_bytes_s: float = number(
        default=10_000.0,
        unit="bytes/s",
        above=0.0,
        maximum=1e12,
        help="bytes that the transmitter sends in a second",
        source="notional: 80 kbit/s",
    )
    message_bytes: int = number(
        default=500,
        unit="bytes",
        minimum=1,
        maximum=1_000_000_000,
        help="bytes of a report",
        source="notional: an event as JSON without tracks",
    )
    loss: float = number(
        default=0.0,
        minimum=0.0,
        maximum=1.0,
        help="probability that a report that is sent does not arrive",
        source="0: none is lost",
    )
    keep_s: float = number(
        default=3600.0,
        unit="s",
        minimum=0.0,
        maximum=86_400.0,
        help="age up to which reports are of use; what would arrive later is lost",
        source="choice",
    )

    @property
    def service_s(self) -> float:
        """The time that the transmitter takes for a report, s."""
        return self.message_bytes / self.rate_bytes_s


@frozen
class LinkOutage:
    """A time in which a station, a relay or a sensor's transmitter neither sends nor receives."""

    node: str = text(help="id of the station, relay or sensor", source="")
    at_s: float = number(
        default=0.0, unit="s", minimum=0.0, help="start, scene time", source="the scene's start"
    )
    until_s: float | None = number(
        default=None, unit="s", above=0.0, help="end; none: it stays", source="choice"
    )
    mtbf_s: float | None = number(
        default=None,
        unit="s",
        minimum=1.0,
        help="mean time between failures: from `at_s` to `until_s` it fails at random, by the seed",
        source="choice",
    )
    mttr_s: float | None = number(
        default=None,
        unit="s",
        above=0.0,
        help="mean time to repair of such failures",
        source="choice",
    )

    def __attrs_post_init__(self) -> None:
        require_span(self)

    @property
    def end_s(self) -> float:
        """The end, s; inf without one."""
        return math.inf if self.until_s is None else self.until_s


@frozen
class Links:
    """The links of a scene; a sensor without a downlink reports as if its link were perfect."""

    stations: tuple[GroundStation, ...] = nested(help="ground stations", source="")
    relays: tuple[RelaySatellite, ...] = nested(default=(), help="relay satellites", source="none")
    downlinks: tuple[Downlink, ...] = nested(
        default=(Downlink(),), help="how sensors send", source="all sensors, by the defaults"
    )
    outages: tuple[LinkOutage, ...] = nested(
        default=(), help="times without transmission", source="none"
    )
    clearance_km: float = number(
        default=100.0,
        unit="km",
        minimum=0.0,
        maximum=10_000.0,
        help="least height above the ellipsoid of a line between two satellites that see each other",
        source="notional: above the air",
    )

    def __attrs_post_init__(self) -> None:
        ids = [*(station.id for station in self.stations), *(relay.id for relay in self.relays)]
        twice = sorted(name for name in set(ids) if ids.count(name) > 1 or name in ("", ANY))
        if twice:
            raise ValueError(f"{twice[0]!r} names two nodes, or is no name of one")
        if not self.stations:
            raise ValueError("links need a station")
        ends = {station.id for station in self.stations}
        for downlink in self.downlinks:
            for path in downlink.paths:
                if not path or path[-1] not in ends:
                    raise ValueError(f"the path {list(path)} does not end at a station")
        if sum(not downlink.sensors for downlink in self.downlinks) > 1:
            raise ValueError("two downlinks name no sensors; one is for all others")
        if not self.downlinks:
            raise ValueError("links need a downlink")

    @property
    def delays_s(self) -> dict[str, float]:
        """What stations and relays delay a report, s, by their ids."""
        stations = {station.id: station.delay_s for station in self.stations}
        return stations | {relay.id: relay.delay_s for relay in self.relays}

    def downlink_of(self, sensor: str) -> Downlink | None:
        """Return the downlink of a sensor by its id; None if it has none."""
        others = (downlink for downlink in self.downlinks if not downlink.sensors)
        named = (downlink for downlink in self.downlinks if sensor in downlink.sensors)
        return next(named, next(others, None))
