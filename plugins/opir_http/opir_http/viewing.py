"""`opir view`: the page of a saved run, read-only, until a signal stops it."""

import argparse
import asyncio
import socket
import sys
from typing import Any

import msgspec
from litestar import Litestar, Request, Response, get
from litestar.exceptions import HTTPException

from opir_core import load_run
from opir_core.plugin import Host
from opir_http.gate import Gate
from opir_http.openapi import view_document
from opir_http.problems import ProblemError, answer_defect, answer_http, answer_problem
from opir_http.reading import instant_us, number_within, query
from opir_http.replay import LONGEST_S, Replay
from opir_http.routes import page_routes
from opir_http.server import Server
from opir_http.serving import bound_socket, start_text, token_of
from opir_http.settings import HttpSettings

_JSON = "application/json"
_STEPS_S = 0.1, 600.0

AnyRequest = Request[Any, Any, Any]


def view(arguments: argparse.Namespace) -> int:
    """Serve the page of a saved run until a signal stops it; return the exit code."""
    token = token_of(arguments)
    replay = Replay(load_run(arguments.run_path, Host.discover()))
    with bound_socket(arguments) as listening:
        asyncio.run(_served(replay, token, listening, arguments.host))
    return 0


def view_server(replay: Replay, token: str | None, on_start: Any = lambda: None) -> Server:
    """Return the server of a saved run, for the running event loop."""
    settings = HttpSettings()
    app: Any = view_application(replay)
    return Server(Gate(app, lambda: settings, token), lambda: None, on_start)


def view_application(replay: Replay) -> Litestar:
    """Return the application that shows a saved run."""
    status = msgspec.json.encode(replay.status())

    @get("/status")
    async def saved_status(request: AnyRequest) -> Response[bytes]:
        query(request.scope["query_string"], ())
        return Response(status, media_type=_JSON)

    @get("/replay")
    async def part(request: AnyRequest) -> Response[bytes]:
        given = query(request.scope["query_string"], ("since", "until", "step_s"))
        since_us = instant_us(given, "since")
        until_us = instant_us(given, "until")
        if since_us is None or until_us is None or not 0 <= until_us - since_us <= LONGEST_S * 1e6:
            raise ProblemError(400, f"since and until must be given, at most {LONGEST_S:g} s apart")
        step_s = number_within(given, "step_s", 1.0, *_STEPS_S)
        found = await asyncio.to_thread(
            lambda: msgspec.json.encode(replay.part(since_us, until_us, step_s))
        )
        return Response(found, media_type=_JSON)

    return Litestar(
        route_handlers=[*page_routes(view_document()), saved_status, part],
        exception_handlers={
            ProblemError: answer_problem,
            HTTPException: answer_http,
            Exception: answer_defect,
        },
        openapi_config=None,
        logging_config=None,
    )


async def _served(replay: Replay, token: str | None, listening: socket.socket, host: str) -> None:
    def print_address() -> None:
        sys.stdout.write(start_text(host, listening.getsockname()[1]))
        sys.stdout.flush()

    await view_server(replay, token, print_address).serve(sockets=[listening])
