"""`opir serve`: a live run with its HTTP server, until a signal stops it."""

import argparse
import asyncio
import errno
import os
import socket
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from opir_core.cli import scene_of
from opir_core.errors import ModelError, OpirError, Problem, SceneError, SinkError
from opir_core.host import STUCK, ended_if_stuck, warn
from opir_core.live import ChangesFile, LiveRun, LiveSettings, LiveStatus, limit_pauses
from opir_core.output import CommandsFile
from opir_core.plugin import Host
from opir_core.simulation import plan_warnings
from opir_http.gate import Gate
from opir_http.health import log_health
from opir_http.json_log import log_as_json
from opir_http.log import RequestLog
from opir_http.routes import application
from opir_http.server import Server, bound
from opir_http.service import Service
from opir_http.settings import LOOPBACK, HttpSettings
from opir_http.telemetry import end_spans, span_provider, window_spans
from opir_http.watchdog import Notifier, RunWatchdog

#: Environment variable of the bearer token, if no file is given.
TOKEN_VARIABLE = "OPIR_HTTP_TOKEN"

#: Time, s, after the stop signal for the sinks to empty their queues; the process ends within 5 s.
STOP_S = 4.0

_LEAST_S = 1.0
_SHORTEST_TOKEN = 16
_LONGEST_TOKEN_FILE = 4096


class ServeError(OpirError):
    """A service that cannot be started with these arguments."""

    exit_code = 2


class AddressInUseError(OpirError):
    """An address that another process has: a later start may succeed."""

    exit_code = 6


def serve(arguments: argparse.Namespace) -> int:
    """Run the service until a signal stops it; return the exit code."""
    is_json = arguments.log_format == "json"
    if is_json:
        log_as_json()
    token = token_of(arguments)
    log = RequestLog(sys.stderr.write, token_name(arguments), is_json=is_json)
    with ended_if_stuck(arguments.dead_after):
        service = service_of(arguments)
    if spans := span_provider():
        service.run.on_window = window_spans(spans, service.run.on_window)
    on_stuck = partial(end_process, service.run) if arguments.supervise else None
    watchdog = RunWatchdog(service.run, on_stuck, Notifier.of(), arguments.dead_after)
    service.watchdog = watchdog.thread
    stopping = threading.Event()
    with bound_socket(arguments) as listening:
        # Building it takes a second or two, which viewers would miss if the run had already
        # started.
        app = application(service)
        limit_pauses()
        with ended_if_stuck(arguments.dead_after):
            record_changes(service.run, arguments.changes)
            record_commands(service.run, arguments.commands)
            service.run.start()
        log_health(service.health, stopping)
        asked_at_s = None
        try:
            asked_at_s = asyncio.run(
                _served(service, app, (token, log), listening, arguments.host, watchdog.start)
            )
        finally:
            stopping.set()
            watchdog.stop()
            service.feed.stop()
            passed_s = 0.0 if asked_at_s is None else time.monotonic() - asked_at_s
            status = service.run.stop(within_s=max(_LEAST_S, STOP_S - passed_s))
            if spans:
                end_spans(spans)
    sys.stdout.write(final_report(status))
    if service.run.status().error:
        raise ModelError(f"the run failed: {service.run.status().error}")
    if status.tracker_error:
        raise ModelError(f"the tracker has ended: {status.tracker_error}")
    if failures := [
        f"{sink.path} ({sink.name}): {sink.error}" for sink in status.sinks if sink.error
    ]:
        raise SinkError("\n".join(failures))
    return 0


def record_changes(run: LiveRun, path: str | None) -> None:
    """Let a run record its changes in a file: that of a path, or beside the first file of events;
    "" for none.
    """
    place = _place(run, path, ".changes.jsonl")
    if place is not None:
        run.changes_file = ChangesFile(place, run.scene, loop=run.settings.loop)


def record_commands(run: LiveRun, path: str | None) -> None:
    """Let a run with a director write what becomes of commands, to the same places; raises
    `SceneError` for a path without a director.
    """
    if run.scene.director is None:
        if path:
            raise SceneError([Problem("--commands", "the scene has no director; omit this option")])
    elif (place := _place(run, path, ".commands.jsonl")) is not None:
        run.commands_file = CommandsFile(place)


def _place(run: LiveRun, path: str | None, ending: str) -> Path | None:
    """Return the path of a file of a run: that given, or beside the first file of events; None for
    none.
    """
    outputs = (choice.config for choice in run.scene.outputs if choice.name == "jsonl")
    events = next((output.path for output in outputs if output.path not in ("", "-")), None)
    beside = None if events is None else Path(events).with_suffix(ending)
    return beside if path is None else Path(path) if path else None


def service_of(arguments: argparse.Namespace, host: Host | None = None) -> Service:
    """Return the service that the arguments describe, not yet started."""
    plugins = host or Host.discover()
    start = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    scene = scene_of(arguments, plugins, first=(f"epoch={start}",) if arguments.epoch_now else ())
    settings = HttpSettings(
        host=arguments.host,
        port=arguments.port,
        config_writes=not arguments.no_config_writes,
        history=arguments.history,
        maximum_targets=arguments.max_targets,
    )
    live = LiveSettings(
        speed=arguments.speed,
        cycle_ns=round(arguments.cycle_ms * 1e6),
        loop=arguments.loop,
        maximum_targets=arguments.max_targets,
        unready_after_s=arguments.unready_after,
        dead_after_s=arguments.dead_after,
        late_after_s=arguments.late_after,
        slows=arguments.when_late == "slow",
    )
    try:
        run = LiveRun(scene, plugins, live)
    except SceneError as error:
        raise SceneError(error.problems, source=arguments.scene) from error
    for warning in plan_warnings(run.plan):
        warn(warning)
    service = Service(run, settings)
    run.on_window = service.feed.put
    return service


def end_process(run: LiveRun, reason: str) -> None:
    """Print the reason, close the sinks as far as they can be within `STOP_S`, and end this process
    with `STUCK`.

    The process ends without waiting for threads: one of them may never return.
    """
    sys.stderr.write(f"opir: {reason}; the supervisor ends the service with exit code {STUCK}\n")
    sys.stderr.flush()
    closing = threading.Thread(target=_report_stopped, args=(run,), name="opir-end", daemon=True)
    closing.start()
    closing.join(STOP_S + _LEAST_S)
    os._exit(STUCK)


def _report_stopped(run: LiveRun) -> None:
    status = run.stop(within_s=STOP_S)
    if status.error:
        sys.stderr.write(f"opir: the run failed: {status.error}\n")
    sys.stdout.write(final_report(status))
    sys.stdout.flush()


def token_of(arguments: argparse.Namespace) -> str | None:
    """Return the bearer token of the file or the environment; required unless only this machine can
    connect.
    """
    token = os.environ.get(TOKEN_VARIABLE)
    if arguments.token_file is not None:
        _check_permissions(Path(arguments.token_file))
        token = _read_token(Path(arguments.token_file))
    if token is not None and (
        len(token) < _SHORTEST_TOKEN or not token.isascii() or not token.isprintable()
    ):
        raise ServeError(
            f"the bearer token needs at least {_SHORTEST_TOKEN} printable ASCII characters"
        )
    if token is None and arguments.host not in LOOPBACK:
        raise ServeError(
            f"--host {arguments.host}: other machines can connect; give a bearer token in"
            f" {TOKEN_VARIABLE} or with"
            " --token-file"
        )
    return token


def _read_token(path: Path) -> str:
    """Return the token of a file, which may be a pipe; of an endless one only the beginning is
    read.
    """
    try:
        with path.open("rb") as file:
            text = file.read(_LONGEST_TOKEN_FILE + 1)
        token = text.decode("ascii").strip()
    except (OSError, ValueError):
        raise ServeError("--token-file: the file cannot be read as text") from None
    if len(text) > _LONGEST_TOKEN_FILE:
        raise ServeError(
            f"--token-file: the file has more than {_LONGEST_TOKEN_FILE} bytes; it holds one token"
        )
    return token


def _check_permissions(path: Path) -> None:
    """Reject a token file that other users can read or write."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return
    if os.name == "posix" and stat.S_ISREG(mode) and mode & 0o077:
        raise ServeError(
            f"--token-file: other users can open the file (mode {stat.S_IMODE(mode):03o});"
            f" chmod 600 {path}"
        )


def token_name(arguments: argparse.Namespace) -> str | None:
    """Return the name of the token in the log of writes: of its file or variable."""
    if arguments.token_file is not None:
        return Path(arguments.token_file).name
    return TOKEN_VARIABLE if TOKEN_VARIABLE in os.environ else None


def final_report(status: LiveStatus) -> str:
    """Return the text printed at the end: scene time, cycles, detections, and the event counts of
    each sink.
    """
    head = (
        f"opir: stopped at {status.time_ns * 1e-9:.3f} s of scene time, after {status.cycle}"
        f" cycles:"
        f" {status.detections} detections of {status.targets_launched} targets\n"
    )
    sinks = (
        f"opir: {sink.path} ({sink.name}): {sink.delivered} delivered, {sink.spooled} spooled,"
        f" {sink.dropped} dropped"
        + (f", {sink.withheld} withheld" if sink.withheld else "")
        + (f"; {sink.error}" if sink.error else "")
        + "\n"
        for sink in status.sinks
    )
    return "".join([head, *sinks])


def bound_socket(arguments: argparse.Namespace) -> socket.socket:
    """Return the listening socket of the arguments' address; raises `ServeError`."""
    try:
        return bound(arguments.host, arguments.port)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        words = f"--host {arguments.host} --port {arguments.port} cannot be bound: {reason}"
        is_taken = getattr(error, "errno", None) == errno.EADDRINUSE
        raise (AddressInUseError(words) if is_taken else ServeError(words)) from None


async def _served(
    service: Service,
    app: Any,
    access: tuple[str | None, RequestLog],
    listening: socket.socket,
    host: str,
    on_start: Callable[[], None],
) -> float | None:
    """Serve until a signal, and return its time on the monotonic clock, s; `on_start` is called
    once it serves.
    """

    def print_address() -> None:
        notes = service.run.plan.scene.automatic
        sys.stdout.write(start_text(host, listening.getsockname()[1], notes))
        sys.stdout.flush()
        on_start()

    token, log = access
    server = server_of(service, app, token, print_address, log)
    await server.serve(sockets=[listening])
    return server.asked_at_s


def start_text(host: str, port: int, notes: Iterable[str] = ()) -> str:
    """Return the text printed once a service answers: its address, then notes on its scene."""
    address = f"http://{f'[{host}]' if ':' in host else host}:{port}"
    lines = [address, f"{address}/page/api.html describes the HTTP interface", *notes]
    return "".join(f"opir: {line}\n" for line in lines)


def server_of(
    service: Service,
    app: Any,
    token: str | None,
    on_start: Callable[[], None] = lambda: None,
    log: RequestLog | None = None,
) -> Server:
    """Return the server of a service and its application, for the running event loop."""
    service.feed.start(asyncio.get_running_loop())

    def stop() -> None:
        service.run.halt()
        service.feed.stop()

    return Server(
        Gate(app, lambda: service.settings, token, log, service.configuration_bytes), stop, on_start
    )
