"""The settings of the service."""

from attrs import frozen

from opir_core.plugin import flag, number, text

#: Settings that can change while the service runs.
LIVE = ("maximum_targets", "maximum_tracks", "maximum_viewers", "writes_per_s")

#: Maximum size of a request body, bytes, but of a configuration, which may have at most this many
#: times the bytes of the present one: indented it has two or three times as many.
MAXIMUM_BODY_BYTES = 64 * 1024
CONFIGURATION_SHARE = 4
#: Time, s, in which the headers of a request, and then its body, must arrive.
HEADERS_S = 10.0
BODY_S = 10.0
#: Maximum number of connections.
MAXIMUM_CONNECTIONS = 1024
#: Maximum number of connections of a client, and of its streams. Clients on this machine, such as a
#: proxy that serves many others, have no limit of their own.
CONNECTIONS_PER_CLIENT = 128
STREAMS_PER_CLIENT = 32
#: Connections above these limits that are still answered, health checks only, and the time, s, they
#: have for a request.
RESERVED_CONNECTIONS = 64
RESERVED_S = 2.0
#: Time, s, after which a client that takes none of the bytes waiting for it is disconnected.
WRITE_S = 30.0
#: Addresses of this machine.
LOOPBACK = frozenset({"127.0.0.1", "::1", "localhost"})
#: Maximum number of detections on a page of GET /detections.
MAXIMUM_PAGE = 1000


@frozen
class HttpSettings:
    """Address and limits of the service."""

    host: str = text(default="127.0.0.1", help="address to bind")
    port: int = number(default=8000, minimum=0, maximum=65535, help="port to bind")
    config_writes: bool = flag(default=True, help="whether PUT /config is allowed")
    history: int = number(
        default=10_000,
        minimum=100,
        maximum=1_000_000,
        help="number of detections kept for GET /detections",
    )
    maximum_targets: int = number(
        default=1_000, minimum=1, maximum=50_000, help="maximum number of targets in the run"
    )
    maximum_tracks: int = number(
        default=1_000,
        minimum=10,
        maximum=100_000,
        help="number of tracks kept for the page and GET /tracks, the last updated; some 20 KiB"
        " each",
    )
    maximum_viewers: int = number(
        default=256, minimum=1, maximum=1_000, help="maximum number of clients of the stream"
    )
    writes_per_s: float = number(
        default=20.0,
        unit="1/s",
        minimum=0.01,
        maximum=10_000.0,
        help="maximum sustained rate of POST and PUT requests of a client",
    )
