"""The service behind the routes, and answers from it."""

import asyncio
import time
from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar

import msgspec
from litestar import Request, Response

from opir_http.metrics import metrics_text
from opir_http.service import Service, etag_of

_JSON = "application/json"
#: Maximum age of cached documents, s.
_CACHED_S = 0.05

AnyRequest = Request[Any, Any, Any]
Result = TypeVar("Result")


class Cached(Generic[Result]):
    """The result of `make`, called in a thread when the last one is older than `for_s`; for one
    event loop.
    """

    def __init__(self, make: Callable[[], Result], for_s: float = _CACHED_S) -> None:
        self._make = make
        self._for_s = for_s
        self._cached: tuple[float, Result] | None = None
        self._task: asyncio.Task[Result] | None = None

    async def get(self) -> Result:
        """Return the result; waits for a new one if it is too old."""
        if self._cached is not None and time.monotonic() - self._cached[0] < self._for_s:
            return self._cached[1]
        if self._task is None:
            self._task = asyncio.create_task(asyncio.to_thread(self._make))
            self._task.add_done_callback(self._keep)
        return await asyncio.shield(self._task)

    def forget(self) -> None:
        """Make a new result for the next request; the one in progress is for earlier requests."""
        self._cached = None
        self._task = None

    def _keep(self, task: "asyncio.Task[Result]") -> None:
        if task is self._task:
            self._task = None
            if not task.cancelled() and task.exception() is None:
                self._cached = time.monotonic(), task.result()


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
