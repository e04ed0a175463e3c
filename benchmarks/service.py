"""Requests per second of the service, and its stream under 200 clients, compared with a bare
Litestar application.

Each server is a process of its own on the loopback; wrk (1 thread, 32 connections) asks each in
turn, several times, and ratios are medians of those within a turn. The stream's clients are one
process that reads 200 connections to `/stream` and counts the detections that come.
"""

import asyncio
import http.client
import json
import re
import shutil
import statistics
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

from pages import markdown_table, options_of

SCENE = Path(__file__).resolve().parents[1] / "examples" / "raid_100.yaml"
#: How often each is asked.
TURNS = 5
BARE = "bare Litestar"
PATHS = ("/detections?limit=1", "/detections?limit=100", "/status", "/health/live")
HELLO = """
import asyncio, socket, sys
import uvicorn
from litestar import Litestar, get

@get("/")
async def hello() -> dict[str, str]:
    return {"hello": "world"}

listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
listening.bind(("127.0.0.1", 0)) listening.listen(512)
print(f"http://127.0.0.1:{listening.getsockname()[1]}", flush=True) app = Litestar([hello],
openapi_config=None, logging_config=None) config = uvicorn.Config(app, http="h11", ws="none",
lifespan="off", log_config=None, access_log=False)
asyncio.run(uvicorn.Server(config).serve(sockets=[listening]))
"""
PAGE = """# Throughput of the service

How many requests per second does `opir serve` answer? `examples/raid_100.yaml` in real time;
server and clients share two cores, with other load; wrk, 32 connections; compared with a bare
Litestar under the same server. Medians of {turns} repetitions.

{table}

With {clients} clients of `/stream` for {seconds:g} s the run makes {made:.0f} detections/s and
sends {sent:.0f}/s ({each:.0f}/s each, {mib:.1f} MiB/s). {lost} frames are dropped for slow
clients, {windows} windows for all; {late} deadlines are missed.
"""


@contextmanager
def running(*command):
    """Start a server that prints its address; yield its port."""
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        assert process.stdout is not None
        yield int(process.stdout.readline().rpartition(":")[2])
    finally:
        process.terminate()
        process.communicate(timeout=30.0)


def requests_per_s(port, path, seconds):
    """Return the rate by wrk; raise where an answer is not 2xx."""
    command = ["wrk", "-t1", "-c32", f"-d{seconds:g}s", f"http://127.0.0.1:{port}{path}"]
    answer = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "Non-2xx" not in answer, answer
    rate = re.search(r"Requests/sec:\s+([0-9.]+)", answer)
    assert rate, answer
    return float(rate[1])


def status(port):
    """Return the status of a service."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60.0)
    connection.request("GET", "/status")
    answer = json.loads(connection.getresponse().read())
    connection.close()
    return answer


async def viewed(port, clients, seconds):
    """Return how many detections viewers of the full stream are sent in a time, and bytes."""
    detections = 0
    size = 0

    async def view():
        nonlocal detections, size
        reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 24)
        writer.write(b"GET /stream HTTP/1.1\r\nHost: localhost\r\n\r\n")
        try:
            while line := await reader.readline():
                size += len(line)
                if data := re.match(rb'data: \{"cycle":\d+,"time_s":[0-9.]+,"count":(\d+)', line):
                    detections += int(data[1])
        finally:
            writer.close()

    tasks = [asyncio.create_task(view()) for _ in range(clients)]
    await asyncio.sleep(seconds)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return detections, size


def rates_of(bare, port, seconds):
    """Return requests a second by path, of the bare server first."""
    rates = {BARE: requests_per_s(bare, "/", seconds)}
    return rates | {f"`GET {path}`": requests_per_s(port, path, seconds) for path in PATHS}


def table(turns):
    """Return the table of rates, and of ratios to the bare server."""
    lines = []
    for name in turns[0]:
        ratios = [rates[name] / rates[BARE] for rates in turns]
        rate = statistics.median(rates[name] for rates in turns)
        spread = f"{min(ratios):.2f} to {max(ratios):.2f}"
        lines.append((name, f"{rate:.0f}", f"{statistics.median(ratios):.2f}", spread))
    return markdown_table(("request", "requests/s", "ratio", "range"), lines)


def measured(seconds, clients):
    """Return the page."""
    words = ["serve", str(SCENE), "--loop", "--port", "0", "--set", "outputs=['null']"]
    serve = [sys.executable, "-m", "opir_core", *words]
    with running(sys.executable, "-c", HELLO) as bare, running(*serve) as port:
        while status(port)["counts"]["detections"] < 2000:
            time.sleep(0.1)
        turns = [rates_of(bare, port, seconds) for _ in range(TURNS)]
        before = status(port)
        start_s = time.monotonic()
        detections, size = asyncio.run(viewed(port, clients, 6 * seconds))
        after = status(port)
        taken_s = time.monotonic() - start_s

    def grown(part, name):
        return int(after[part][name] - before[part][name])

    return PAGE.format(
        turns=TURNS,
        table=table(turns),
        clients=clients,
        seconds=6 * seconds,
        made=grown("counts", "detections") / taken_s,
        sent=detections / taken_s,
        each=detections / taken_s / clients,
        mib=size / taken_s / 2**20,
        lost=grown("viewers", "dropped_frames"),
        windows=after["viewers"]["dropped_windows"],
        late=grown("clock", "late_cycles"),
    )


def main():
    """Measure and print; write the page where asked."""
    options = options_of(__doc__, seconds=2.0, clients=200)
    assert shutil.which("wrk"), "no wrk: apt-get install wrk"
    text = measured(options.seconds, options.clients)
    print(text)
    if options.write:
        (options.write / "service.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
