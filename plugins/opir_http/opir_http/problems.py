"""Error responses: problem details (RFC 9457), without file paths and tracebacks."""

from collections.abc import Mapping
from typing import Any

import msgspec
from litestar import Response
from litestar.exceptions import HTTPException
from msgspec import UNSET

from opir_core.errors import OpirError, SceneError, number_of
from opir_core.live import BusyError, RefusedError, RestartError
from opir_http.answers import Message, ProblemAnswer

PROBLEM_TYPE = "application/problem+json"

#: Titles by status.
TITLES = {
    400: "The request cannot be read",
    401: "A bearer token is needed",
    403: "This is not permitted",
    404: "There is no such resource",
    405: "The method is not allowed",
    408: "The request took too long to arrive",
    409: "The simulation cannot apply this",
    412: "The configuration has changed",
    413: "The request is too large",
    415: "The content type is not supported",
    421: "The host is not served",
    422: "The request is not valid",
    428: "If-Match is needed",
    429: "Too many requests",
    500: "The service failed",
    503: "The service is not available",
}


class ProblemError(Exception):
    """An error response; `errors` are pairs of path and message."""

    def __init__(
        self,
        status: int,
        detail: str,
        errors: tuple[tuple[str, str], ...] = (),
        headers: Mapping[str, str] | None = None,
    ) -> None:
        self.status = status
        self.detail = detail
        self.errors = errors
        self.headers = dict(headers or {})
        super().__init__(detail)


def problem_body(error: ProblemError) -> bytes:
    """Return the body of a problem."""
    problem = ProblemAnswer(
        title=TITLES.get(error.status, "The request failed"),
        status=error.status,
        detail=error.detail,
        errors=[Message(path, message) for path, message in error.errors] or UNSET,
    )
    return msgspec.json.encode(problem)


def problem_of(error: OpirError) -> ProblemError:
    """Return the error response for an error of opir."""
    if isinstance(error, BusyError):
        return ProblemError(429, str(error), headers={"Retry-After": "1"})
    if isinstance(error, RefusedError):
        return ProblemError(409, str(error))
    if isinstance(error, RestartError):
        return ProblemError(409, "some settings need a restart", _pairs(error.problems))
    if isinstance(error, SceneError):
        return ProblemError(422, number_of("error", len(error.problems)), _pairs(error.problems))
    return ProblemError(422, str(error))


def _pairs(problems: Any) -> tuple[tuple[str, str], ...]:
    return tuple(
        (problem.path.removeprefix("targets[0]").lstrip("."), problem.message)
        for problem in problems
    )


def answer_problem(_request: Any, error: ProblemError) -> Response[bytes]:
    """Return the response to a problem."""
    return Response(
        problem_body(error),
        status_code=error.status,
        media_type=PROBLEM_TYPE,
        headers=error.headers,
    )


def answer_http(request: Any, error: HTTPException) -> Response[bytes]:
    """Return the response to an error of the framework."""
    status = error.status_code
    headers = {key: value for key, value in (error.headers or {}).items() if key.lower() == "allow"}
    detail = TITLES.get(status, "The request failed").lower()
    return answer_problem(request, ProblemError(status, detail, headers=headers))


def answer_defect(request: Any, _error: Exception) -> Response[bytes]:
    """Return the response to a defect, without its details."""
    return answer_problem(request, ProblemError(500, "see the log of the service"))
