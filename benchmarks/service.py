"""Requests per second of the service, and its stream under 200 clients, compared with a bare
Litestar application.

    python benchmarks/service.py [--seconds 2] [--clients 200] [--write docs/benchmarks]

Each server is a process of its own on the loopback; wrk (1 thread, 32 connections) asks each in
turn, several times, and ratios are medians of those within a turn. The stream's clients are one
process that reads 200 connections to `/stream` and counts the detections that come.
"""

import argparse
import asyncio
import http.client
import json
import re
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

SCENE = Path(__file__).resolve().parents[1] / "examples" / "raid_100.yaml"
#: How often each is asked.
TURNS = 5
PATHS = ("/detections?limit=1", "/detections?limit=100", "/status", "/health/live")
HELLO = """
import asyncio, socket, sys
import uvicorn
from litestar import Litestar, get

@get("/")
async def hello() -> dict[str, str]:
    return {"hello": "world"}

listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
listening.bind(("127.0.0.1", 0))
listening.listen(512)
print(f"http://127.0.0.1:{listening.getsockname()[1]}", flush=True)
app = Litestar([hello], openapi_config=None, logging_config=None)
config = uvicorn.Config(app, http="h11", ws="none", lifespan="off", log_config=None, access_log=False)
asyncio.run(uvicorn.Server(config).serve(sockets=[listening]))
"""


@contextmanager
def running(*command: str) -> Iterator[int]:
    """Start a server that prints its address; yield its port."""
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        assert process.stdout is not None
        yield int(process.stdout.readline().rpartition(":")[2])
    finally:
        process.terminate()
        process.communicate(timeout=20.0)


def requests_per_s(port: int, path: str, seconds: float) -> float:
    """Return what wrk finds; raises where an answer is not 2xx."""
    command = ["wrk", "-t1", "-c32", f"-d{seconds:g}s", f"http://127.0.0.1:{port}{path}"]
    answer = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "Non-2xx" not in answer, answer
    found = re.search(r"Requests/sec:\s+([0-9.]+)", answer)
    assert found, answer
    return float(found[1])


def status(port: int) -> Any:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30.0)
    connection.request("GET", "/status")
    answer = json.loads(connection.getresponse().read())
    connection.close()
    return answer


async def viewed(port: int, clients: int, seconds: float) -> tuple[int, int]:
    """Return how many detections `clients` viewers of the full stream were sent, and how many
    bytes, in that time.
    """
    counts = 0
    size = 0

    async def view() -> None:
        nonlocal counts, size
        reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 24)
        writer.write(b"GET /stream HTTP/1.1\r\nHost: localhost\r\n\r\n")
        try:
            while line := await reader.readline():
                size += len(line)
                if found := re.match(rb'data: \{"cycle":\d+,"time_s":[0-9.]+,"count":(\d+)', line):
                    counts += int(found[1])
        finally:
            writer.close()

    tasks = [asyncio.create_task(view()) for _ in range(clients)]
    await asyncio.sleep(seconds)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return counts, size


def turn(bare: int, port: int, seconds: float) -> dict[str, float]:
    """Return requests a second by path; the bare server's is "hello"."""
    rates = {"hello": requests_per_s(bare, "/", seconds)}
    return rates | {path: requests_per_s(port, path, seconds) for path in PATHS}


def table(turns: list[dict[str, float]]) -> list[str]:
    rows = ["| request | requests/s | ratio | range |", "|---|---|---|---|"]
    for name in turns[0]:
        ratios = [rates[name] / rates["hello"] for rates in turns]
        rate = statistics.median(rates[name] for rates in turns)
        words = "bare Litestar" if name == "hello" else f"`GET {name}`"
        spread = f"{min(ratios):.2f} to {max(ratios):.2f}"
        rows.append(f"| {words} | {rate:.0f} | {statistics.median(ratios):.2f} | {spread} |")
    return rows


def measured(seconds: float, clients: int) -> list[str]:
    """Return the page's lines of figures."""
    serve = [
        sys.executable,
        "-m",
        "opir_core",
        "serve",
        str(SCENE),
        "--loop",
        "--port",
        "0",
        "--set",
        "outputs=['null']",
    ]
    with running(sys.executable, "-c", HELLO) as bare, running(*serve) as port:
        while status(port)["counts"]["detections"] < 2000:
            time.sleep(0.1)
        turns = [turn(bare, port, seconds) for _ in range(TURNS)]
        before = status(port)
        began_s = time.monotonic()
        counts, size = asyncio.run(viewed(port, clients, 6 * seconds))
        after = status(port)
        took_s = time.monotonic() - began_s
    made = (after["counts"]["detections"] - before["counts"]["detections"]) / took_s
    lost = after["viewers"]["dropped_frames"] - before["viewers"]["dropped_frames"]
    late = after["clock"]["late_cycles"] - before["clock"]["late_cycles"]
    return [
        *table(turns),
        "",
        (
            f"With {clients} clients of `/stream` for {6 * seconds:g} s the run makes {made:.0f}"
            f" detections/s and sends"
        ),
        (
            f"{counts / took_s:.0f}/s ({counts / took_s / clients:.0f}/s each,"
            f" {size / took_s / 2**20:.1f} MiB/s)."
        ),
        (
            f"{lost} frames are dropped for slow clients, {after['viewers']['dropped_windows']} windows"
            f" for all;"
        ),
        f"{late} deadlines are missed.",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--clients", type=int, default=200)
    parser.add_argument(
        "--write", type=Path, metavar="FOLDER", help="write the page to FOLDER/service.md"
    )
    arguments = parser.parse_args()
    assert shutil.which("wrk"), "no wrk: apt-get install wrk"
    head = [
        "# Throughput of the service",
        "",
        (
            "How many requests per second does `opir serve` answer? `examples/raid_100.yaml` in real"
            " time; server and"
        ),
        (
            "clients share two cores, with other load; wrk, 32 connections; compared with a bare"
            " Litestar under the same"
        ),
        f"server. Medians of {TURNS} repetitions.",
        "",
    ]
    page = "\n".join([*head, *measured(arguments.seconds, arguments.clients), ""])
    print(page)
    if arguments.write:
        (arguments.write / "service.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
