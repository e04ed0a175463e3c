"""The settings of the service. Those that a running service may change are in `LIVE`."""

from attrs import frozen

from opir_core.scene.fields import flag, number, text

#: Settings that take effect while the service runs.
LIVE = ("maximum_targets", "maximum_viewers", "writes_per_s")

#: The largest body of a request, bytes.
MAXIMUM_BODY_BYTES = 64 * 1024
#: How long a request's headers, and then its body, may take to arrive, s.
HEADERS_S = 10.0
BODY_S = 10.0
#: The most connections at a time.
MAXIMUM_CONNECTIONS = 1024
#: The most detections on a page of GET /detections.
MAXIMUM_PAGE = 1000


@frozen(kw_only=True)
class HttpSettings:
    """How the service is reached, and what it bears."""

    host: str = text(default="127.0.0.1", help="address that is bound")
    port: int = number(default=8000, minimum=0, maximum=65535, help="port that is bound")
    config_writes: bool = flag(default=True, help="whether PUT /config is allowed")
    history: int = number(default=10_000, minimum=100, maximum=1_000_000, help="detections kept for GET /detections")
    maximum_targets: int = number(default=1_000, minimum=1, maximum=50_000, help="targets in the run at a time")
    maximum_viewers: int = number(default=256, minimum=1, maximum=1_000, help="clients of the stream at a time")
    writes_per_s: float = number(
        default=20.0, unit="1/s", above=0.0, maximum=10_000.0, help="POST and PUT requests a client may make, sustained"
    )
