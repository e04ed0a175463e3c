"""The settings of the sinks `cot` and `dis`; no heavy imports."""

from ipaddress import ip_address
from typing import ClassVar

from attrs import frozen

from opir_core.plugin import flag, nested, number, text, with_defaults

_IEEE = "IEEE 1278.1-2012"


def _host_complaint(host: str) -> str | None:
    try:
        ip_address(host)
    except ValueError:
        return f"{host!r} is no IP address; give one, such as 127.0.0.1"
    return None


@frozen(kw_only=True)
class DatagramConfig:
    """Where datagrams go, and how many a second."""

    #: The events of these sinks are tracks: outputs count what this encoder would encode.
    encoder: ClassVar[str] = "tracks"

    host: str = nested(
        default="127.0.0.1",
        check=_host_complaint,
        help="IP address of the display; one beyond this machine needs allow_remote",
    )
    port: int = number(default=4242, minimum=1, maximum=65_535, help="UDP port of the display")
    allow_remote: bool = flag(
        default=False, help="whether host may be an address beyond this machine, or a group"
    )
    rate_per_s: float = number(
        default=2000.0,
        unit="1/s",
        minimum=1.0,
        maximum=1e6,
        help="most datagrams a second; a run waits for them, at most 20 s a window, and then drops",
    )

    def __attrs_post_init__(self) -> None:
        if not self.allow_remote and not ip_address(self.host).is_loopback:
            raise ValueError(
                f"host {self.host} is not this machine; set allow_remote: true to send tracks to it"
            )


@frozen(kw_only=True)
class CotConfig(DatagramConfig):
    """Where Cursor on Target events go, and what they say of the tracks."""

    file: str | None = text(
        default=None, help="file of the events, one a line, in place of datagrams"
    )
    stale_s: float = number(
        default=30.0,
        unit="s",
        minimum=0.1,
        maximum=86_400.0,
        help="time after which a display takes an event for stale, unless the track goes on",
    )
    affiliation: str = text(
        default="u",
        choices=("p", "u", "a", "f", "n", "s", "h"),
        source="MIL-STD-2525: pending, unknown, assumed friend, friend, neutral, suspect, hostile",
        help="affiliation of the tracks",
    )


@with_defaults(port=3000)
class DisConfig(DatagramConfig):
    """Where Entity State PDUs go, how the exercise knows them, and when they are sent."""

    exercise: int = number(default=1, minimum=1, maximum=255, help="exercise identifier")
    site: int = number(default=1, minimum=1, maximum=65_534, help="site of the entities")
    application: int = number(
        default=1, minimum=1, maximum=65_534, help="application of the entities"
    )
    force: int = number(
        default=0,
        minimum=0,
        maximum=3,
        source="SISO-REF-010: 0 other, 1 friendly, 2 opposing, 3 neutral",
        help="force of the entities",
    )
    heartbeat_s: float = number(
        default=5.0,
        unit="s",
        minimum=0.1,
        maximum=3600.0,
        source=f"{_IEEE}: HBT_PDU_ENTITY_STATE",
        help="longest time between two PDUs of an entity",
    )
    threshold_m: float = number(
        default=1.0,
        unit="m",
        minimum=0.0,
        maximum=1e6,
        source=f"{_IEEE}: DRA_POS_THRSH",
        help="distance between a track and its dead reckoning above which a PDU is sent",
    )
