"""`opir view`: the page of a saved run, read-only, until a signal stops it."""

import argparse
import asyncio
import socket
import sys
from functools import partial
from typing import Any

import msgspec
from litestar import Litestar, Response, get
from litestar.datastructures import State

from opir_core import load_run
from opir_core.plugin import Host
from opir_http import answers
from opir_http.gate import Gate
from opir_http.openapi import described, document_of
from opir_http.problems import ProblemError
from opir_http.queries import LONGEST_S, SPAN_RULE, ReplayQuery, time_us
from opir_http.replay import Replay
from opir_http.routes import application_of, query_of
from opir_http.served import AnyRequest, encoded
from opir_http.server import Server
from opir_http.serving import bound_socket, start_text, token_of
from opir_http.settings import HttpSettings


def view(arguments: argparse.Namespace) -> int:
    """Serve the page of a saved run until a signal stops it; return the exit code."""
    token = token_of(arguments)
    replay = Replay(load_run(arguments.run_path, Host.discover()))
    with bound_socket(arguments) as listening:
        asyncio.run(_serve(replay, token, listening, arguments.host))
    return 0


def view_server(replay: Replay, token: str | None, on_start: Any = lambda: None) -> Server:
    """Return the server of a saved run, for the running event loop."""
    settings = HttpSettings()
    app: Any = view_application(replay)
    return Server(Gate(app, lambda: settings, token), lambda: None, on_start)


@get("/status", **described())
async def status(request: AnyRequest) -> Response[answers.Status]:
    """State and counts of the simulation, its sensors and its sinks."""
    return encoded(request.app.state.status)


@get("/replay", **described(query=ReplayQuery))
async def replay(request: AnyRequest) -> Response[answers.ReplayAnswer]:
    """A part of the saved run: detections (of many a sample), estimates of tracks once a step,
    exact counts.
    """
    query: ReplayQuery = query_of(request)
    run: Replay = request.app.state.replay
    since_us = time_us(query, "since")
    until_us = time_us(query, "until")
    if since_us is None or until_us is None or not 0 <= until_us - since_us <= LONGEST_S * 1e6:
        raise ProblemError(400, SPAN_RULE)
    answer = partial(run.part, since_us, until_us, query.step_s)
    return encoded(await asyncio.to_thread(lambda: msgspec.json.encode(answer())))


_ROUTES = [status, replay]


def view_document() -> dict[str, Any]:
    """Return the OpenAPI document of `opir view`."""
    return document_of(_ROUTES, "A saved run of overhead infrared sensors.")


def view_application(run: Replay) -> Litestar:
    """Return the application that shows a saved run."""
    state = State({"replay": run, "status": msgspec.json.encode(run.status())})
    return application_of(_ROUTES, view_document, state)


async def _serve(replay: Replay, token: str | None, listening: socket.socket, host: str) -> None:
    def print_address() -> None:
        sys.stdout.write(start_text(host, listening.getsockname()[1]))
        sys.stdout.flush()

    await view_server(replay, token, print_address).serve(sockets=[listening])
