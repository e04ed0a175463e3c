"""The arguments of `opir serve`, `opir view` and `opir doctor`."""

import argparse
import math

from opir_core.cli import add_scene_arguments

_PORT = 8000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scene, its pace, and the address and limits of the service."""
    add_scene_arguments(parser)
    parser.add_argument(
        "--speed",
        type=_speed,
        default=1.0,
        metavar="N|max",
        help="scene time per real time (default 1); max: unpaced",
    )
    parser.add_argument("--loop", action="store_true", help="run the scene again when it ends")
    parser.add_argument(
        "--epoch-now", action="store_true", help="use the start time as the scene's epoch"
    )
    parser.add_argument(
        "--cycle-ms",
        type=_cycle_ms,
        default=50.0,
        metavar="MS",
        help="real time of a cycle (default 50)",
    )
    parser.add_argument("--workers", type=_no_workers, help=argparse.SUPPRESS)
    add_address(parser)
    parser.add_argument(
        "--no-config-writes", action="store_true", help="refuse PUT and PATCH /config"
    )
    parser.add_argument(
        "--changes",
        metavar="PATH",
        help="write launches and settings here, with which `opir run` repeats the run (default:"
        " beside the events; '' for none)",
    )
    parser.add_argument(
        "--commands",
        metavar="PATH",
        help="write what becomes of commands to sensors here, of a scene with a director (default:"
        " beside the events; '' for none)",
    )
    parser.add_argument(
        "--max-targets",
        type=_targets,
        default=1000,
        metavar="N",
        help="maximum number of targets in the run (default 1000)",
    )
    parser.add_argument(
        "--history",
        type=_history,
        default=10_000,
        metavar="N",
        help="number of detections kept for GET /detections and Last-Event-ID (default 10000)",
    )
    _add_health(parser)
    parser.add_argument(
        "--log-format",
        choices=("text", "json"),
        default="text",
        help="json: all messages as JSON lines on standard error (default text)",
    )


def _add_health(parser: argparse.ArgumentParser) -> None:
    """Add the times after which the service is unready, late or dead, and what follows."""
    parser.add_argument(
        "--unready-after",
        type=_wait_s,
        default=5.0,
        metavar="S",
        help="not ready if no cycle has ended for S seconds, or a sink has been in one call"
        " (default 5 s)",
    )
    parser.add_argument(
        "--dead-after",
        type=_wait_s,
        default=120.0,
        metavar="S",
        help="not alive after S seconds without a beat (default 120 s)",
    )
    parser.add_argument(
        "--late-after",
        type=_wait_s,
        default=5.0,
        metavar="S",
        help="not ready, and launches and settings refused, if the run is S seconds late (default 5"
        " s)",
    )
    parser.add_argument(
        "--when-late",
        choices=("refuse", "slow"),
        default="refuse",
        help="refuse: launches that would make the run late; slow: the scene takes longer (default"
        " refuse)",
    )
    parser.add_argument(
        "--supervise",
        action="store_true",
        help="end with exit code 6 if the run has failed or is not alive",
    )


def add_address(parser: argparse.ArgumentParser) -> None:
    """Add address and token."""
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to bind (default 127.0.0.1); any other needs a token",
    )
    parser.add_argument(
        "--port",
        type=_port,
        default=_PORT,
        help=f"port to bind (default {_PORT}); 0: any free port",
    )
    parser.add_argument(
        "--token-file",
        metavar="PATH",
        help="file with the bearer token of requests (or OPIR_HTTP_TOKEN)",
    )


def add_examined(parser: argparse.ArgumentParser) -> None:
    """Add what `opir doctor` examines, a scene and a port, and the output format."""
    parser.add_argument(
        "scene", metavar="SCENE", nargs="?", help="a scene whose outputs are examined too"
    )
    parser.add_argument(
        "--port", type=int, default=_PORT, help=f"the port of `opir serve` to try (default {_PORT})"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")


def _no_workers(_word: str) -> None:
    """Refuse the option of `opir run`."""
    raise argparse.ArgumentTypeError("a live service runs in one process; omit it, or use opir run")


def _speed(word: str) -> float | None:
    """Return the speed, None for `max`."""
    if word == "max":
        return None
    try:
        speed = float(word)
    except ValueError:
        speed = 0.0
    if not 0.01 <= speed <= 1000.0:
        raise argparse.ArgumentTypeError(f"{word!r} is not a speed: 0.01 to 1000, or max")
    return speed


def _cycle_ms(word: str) -> float:
    return _within(word, 5.0, 1000.0, "a time of 5 to 1000 ms")


def _wait_s(word: str) -> float:
    return _within(word, 0.5, 86_400.0, "a time of 0.5 to 86400 s")


def _targets(word: str) -> int:
    return int(_within(word, 1, 50_000, "a number of targets, 1 to 50000"))


def _history(word: str) -> int:
    return int(_within(word, 100, 1_000_000, "a number of detections, 100 to 1000000"))


def _port(word: str) -> int:
    return int(_within(word, 0, 65_535, "a port, 0 to 65535"))


def _within(word: str, minimum: float, maximum: float, words: str) -> float:
    try:
        number = float(word)
    except ValueError:
        number = math.nan
    if not minimum <= number <= maximum:
        raise argparse.ArgumentTypeError(f"{word!r} is not {words}")
    return number
