"""The service behind the routes, and answers from it."""

from collections.abc import Mapping
from typing import Any

import msgspec
from litestar import Request, Response

from opir_http.cached import Cached
from opir_http.metrics import metrics_text
from opir_http.service import Service, etag_of

_JSON = "application/json"

AnyRequest = Request[Any, Any, Any]


class Served:
    """A service and its cached documents, encoded."""

    def __init__(self, service: Service) -> None:
        self.service = service
        self.status = Cached(lambda: msgspec.json.encode(service.status()))
        self.config = Cached(lambda: _tagged(service.config()))
        self.readiness = Cached(service.health)
        self.metrics = Cached(lambda: metrics_text(service).encode())

    def forget(self) -> None:
        """Make status and configuration again for the next request, after a change."""
        self.status.forget()
        self.config.forget()


def _tagged(config: Mapping[str, Any]) -> tuple[bytes, str]:
    return msgspec.json.encode(config), etag_of(config)


def served_of(request: AnyRequest) -> Served:
    """Return the service of a request."""
    served: Served = request.app.state.served
    return served


def encoded(
    body: bytes, status: int = 200, headers: Mapping[str, str] | None = None
) -> Response[Any]:
    """Return an answer whose JSON is encoded already."""
    return Response(body, status_code=status, media_type=_JSON, headers=dict(headers or {}))


def json_answer(
    value: Any, status: int = 200, headers: Mapping[str, str] | None = None
) -> Response[Any]:
    """Return an answer with a value as JSON."""
    return encoded(msgspec.json.encode(value), status, headers)


def lateness(service: Service) -> dict[str, str]:
    """Return the header that states how late the last cycle was, s."""
    return {"Opir-Late": f"{service.run.late_s:.3f}"}
