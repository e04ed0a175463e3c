"""Soak test of the service at full speed with faults at random: constant memory and descriptors,
every event delivered.

`opir serve --speed max --loop` in a process of its own: two constellations, a tracker, a launch
requested every minute of scene time, a viewer of the stream, and two outputs with a spool: a pipe
that another process reads, and a topic of a mock broker. Every half minute or so a fault of some
seconds: the broker is gone, stopped, slow or refuses events, the reader of the pipe is stopped, or
no file of the service can grow. After SIGTERM every event that the service reports as delivered
must have arrived. `--machine` is a sentence on the machine, for the page.
"""

import http.client
import json
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from pages import Table, markdown_table, options_of, printed, svg_plot, write_csv
from soak_faults import (
    Faults,
    PipeReader,
    TopicReader,
    mock_kafka,
)
from waiting import until

PAGE = """# Soak test

Does the service run for long without leaks or lost events, whatever fails around it? {answer}:
{minutes:g} minutes of `opir serve --speed {speed} --loop`, {laps} laps of a scene of 5 minutes,
{given} events to each of two outputs, {faults} faults.

{rows}

![Memory, spool file, waiting events and events read, by minute](soak.svg)

Both outputs, a pipe and a topic of a mock Kafka broker, have a spool of 8 MiB that holds the run when it is
full. A launch is requested every {trigger_s:g} s of scene time; one viewer reads the stream.
Faults of 2 to 12 s, 10 to 25 s apart, of seed {seed}: {kinds}. {machine} Samples:
[soak.csv](soak.csv).

Memory is constant if the least of the last quarter is at most {flat:g} % above the least of the
first, after the warm-up ({warm_up:g} % of the run, and {warm_up_laps} laps). What grows before is
bounded: histories of detections and tracks.
"""

LAUNCH = {
    "type": "ICBM",
    "launch": {"lat_deg": 34.73, "lon_deg": -120.57},
    "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
}
PANELS = {
    "memory, MiB": "rss_mib",
    "spool file, MiB": "spool_mib",
    "events waiting": "waiting",
    "events read": "out",
}
HEADERS = {"Content-Type": "application/json", "If-Match": "*"}
#: Tracks that the page keeps: so few that they are all there within the warm-up.
TRACKS = 100

#: Scene time between launches: with real time, how many there are in a lap would hang on the
#: machine's other work.
TRIGGER_S = 60.0
#: Time without faults at the end, s.
CALM_S = 45.0
#: The part of the run that is warm-up, and the laps at least: the histories of the service fill
#: with events, not time.
WARM_UP = 0.25
WARM_UP_LAPS = 2
#: How much memory may grow from the first to the last quarter of what follows the warm-up.
FLAT = 0.02
COUNTED = re.compile(r"(\d+) (?:delivered|spooled|dropped)")
FATES = ("delivered", "spooled", "dropped", "withheld")


def streamed(port, path):
    """Yield the lines of a stream as they come, until the service ends, in order or not."""
    connection = http.client.HTTPConnection("127.0.0.1", port)
    connection.request("GET", path)
    with suppress(OSError, http.client.HTTPException):
        yield from connection.getresponse()


class Viewer:
    """A client of the stream, which counts its frames."""

    def __init__(self, port):
        self.frames = 0
        self.has_end = False
        self._port = port
        self.thread = threading.Thread(target=self._read, daemon=True)
        self.thread.start()

    def _read(self):
        for line in streamed(self._port, "/stream?view=brief"):
            self.frames += line.startswith(b"event:")
            self.has_end |= line.startswith(b"event: end")


def request(port, method, path, body=None):
    """Return the status and the answer of the service."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60.0)
    try:
        text = None if body is None else json.dumps(body)
        connection.request(method, path, text, HEADERS if body else {})
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())
    finally:
        connection.close()


def limit_tracks(port):
    """Let the service keep few tracks for its page; a run that is late at its start takes no
    settings yet.
    """
    config = request(port, "GET", "/config")[1]
    config["http"]["maximum_tracks"] = TRACKS
    until(lambda: request(port, "PUT", "/config", config)[0] == 200, within_s=60.0)


def balanced_status(port):
    """Return a status in which the books of both outputs balance; a window is counted once it is in
    the spool.
    """
    end_s = time.monotonic() + 30.0
    while True:
        status = request(port, "GET", "/status")[1]
        sinks = status["sinks"]
        if all(
            sum(sink[name] for name in FATES) == sink["given"] + sink["recovered"] for sink in sinks
        ):
            return status
        assert time.monotonic() < end_s, f"the books do not balance: {sinks}"


class Service(NamedTuple):
    """The service under test, its spools, and what is around it."""

    process: subprocess.Popen[str]
    port: int
    spools: tuple[Path, ...]
    pipe: PipeReader
    topic: TopicReader
    faults: Faults


def resident_mib(process):
    """Return the resident memory of a process, MiB."""
    text = Path(f"/proc/{process}/status").read_text(encoding="ascii")
    memory = re.search(r"VmRSS:\s+(\d+)", text)
    assert memory
    return int(memory[1]) / 1024


def sample(service, start_s):
    """Return the state of the service; of counts of outputs, the sum of both."""
    fault = service.faults.kind or ""
    # While the disk takes nothing, a window waits half counted.
    port = service.port
    status = request(port, "GET", "/status")[1] if fault else balanced_status(port)
    process = service.process.pid
    files = [Path(f"{spool}{end}") for spool in service.spools for end in ("", "-wal", "-shm")]
    return {
        "at_s": time.monotonic() - start_s,
        "rss_mib": resident_mib(process),
        "descriptors": len(list(Path(f"/proc/{process}/fd").iterdir())),
        "spool_mib": sum(file.stat().st_size for file in files if file.exists()) / 2**20,
        "waiting": sum(sink["spooled"] for sink in status["sinks"]),
        "given": status["sinks"][0]["given"],
        "out": service.pipe.lines + service.topic.messages,
        "lap": status["clock"]["lap"],
        "tracks": status["counts"]["tracks"],
        "fault": fault,
    }


def scene_with(folder, address):
    """Write the scene with its pipe and the address of its broker, and return its path."""
    os.mkfifo(folder / "pipe")
    text = Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8")
    text = text.replace("PIPE", str(folder / "pipe")).replace("SPOOL", str(folder / "spool"))
    scene = folder / "scene.yaml"
    scene.write_text(text.replace("BROKER", address), encoding="utf-8")
    return scene


def soaked(options, folder):
    """Run the service before a broker; return the results."""
    with mock_kafka("soak") as (address, broker_faults):
        return soaked_before(address, broker_faults, options, folder)


def soaked_before(address, broker_faults, options, folder):
    """Return samples, answers to triggers by status, and how the run ended."""
    scene = scene_with(folder, address)
    pipe = PipeReader(folder / "pipe")
    topic = TopicReader(address, "soak")
    command = [sys.executable, "-m", "opir_core", "serve", str(scene), "--loop", "--port", "0"]
    command += ["--speed", options.speed]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    faults = Faults(options.seed, process.pid, broker_faults, pipe.process)
    spools = (folder / "spool-pipe", folder / "spool-topic")
    try:
        assert process.stdout is not None
        port = int(process.stdout.readline().rpartition(":")[2])
        limit_tracks(port)
        viewer = Viewer(port)
        results = watched(Service(process, port, spools, pipe, topic, faults), options.minutes * 60)
        status = balanced_status(port)
        process.send_signal(signal.SIGTERM)
        start_s = time.monotonic()
        output = process.communicate(timeout=60.0)[0]
        stop_s = time.monotonic() - start_s
        pipe.thread.join(20.0)
        viewer.thread.join(10.0)
        time.sleep(2.0)
        topic.close()
    finally:
        process.kill()
        faults.end()
        pipe.close()
    return results | {
        "output": output,
        "stop_s": stop_s,
        "code": process.returncode,
        "out": (pipe.lines, topic.messages),
        "repeated": (pipe.repeated, topic.recent.repeated),
        "disordered": topic.disordered,
        "reader_error": topic.error,
        "unbalanced": [sink["unbalanced"] for sink in status["sinks"]],
        "faults": faults.counts,
        "viewer": viewer,
    }


def watched(service, duration_s):
    """Sample, trigger and let things fail until the time is over, the last minute without faults.

    Returns the samples, the answers to triggers by status, and how late, s, the run was at most
    while it was ready.
    """
    start_s = time.monotonic()
    samples = []
    triggers = {}
    late_s = 0.0
    trigger_due_s = 0.0
    sample_due_s = start_s
    while (at_s := time.monotonic() - start_s) < duration_s:
        service.faults.step() if at_s < duration_s - CALM_S else service.faults.end()
        status = request(service.port, "GET", "/status")[1]
        clock = status["clock"]
        late_s = max(late_s, clock["late_s"] if status["health"]["ready"] else 0.0)
        if clock["time_s"] >= trigger_due_s and service.faults.kind is None:
            trigger_due_s = clock["time_s"] + TRIGGER_S
            answer, body = request(service.port, "POST", "/trigger", LAUNCH)
            triggers[answer] = triggers.get(answer, 0) + 1
            if answer != 202:
                print(answer, body, flush=True)
        if time.monotonic() >= sample_due_s:
            sample_due_s += 10.0
            samples.append(sample(service, start_s))
            printed(samples[-1])
        time.sleep(0.05)
    return {"samples": samples, "triggers": triggers, "late_s": late_s}


class Criterion(NamedTuple):
    """A criterion of the test, its result in words, and whether it is met."""

    name: str
    result: str
    is_met: bool


def criteria_table(rows):
    """Return criteria as a table of a page."""
    head = ("criterion", "result", "met")
    return markdown_table(
        head, [(row.name, row.result, "yes" if row.is_met else "NO") for row in rows]
    )


def memory_criteria(samples):
    """Return the criteria on memory, descriptors and spools."""
    warm = [row for row in samples[int(WARM_UP * len(samples)) :] if row["lap"] >= WARM_UP_LAPS]
    warm = warm or list(samples)
    size = max(1, len(warm) // 4)
    memory = [[row["rss_mib"] for row in part] for part in (warm[:size], warm[-size:])]
    least = [min(part) for part in memory]
    median = [statistics.median(part) for part in memory]
    files = [
        statistics.median(row["descriptors"] for row in part)
        for part in (warm[:size], warm[-size:])
    ]
    waiting = samples[-1]["waiting"]
    words = "least of the first quarter {:.1f} MiB, of the last {:.1f}; medians {:.1f} and {:.1f}"
    most_mib = max(row["spool_mib"] for row in samples)
    return [
        Criterion(
            "memory constant", words.format(*least, *median), least[1] / least[0] <= 1 + FLAT
        ),
        # Connections come and go with faults.
        Criterion(
            "file descriptors constant",
            f"{files[0]:g}, later {files[1]:g}",
            abs(files[0] - files[1]) <= 2,
        ),
        Criterion("spools empty after the last fault", f"{waiting} waiting", waiting < 5000),
        Criterion("spool files bounded", f"maximum {most_mib:.1f} MiB", True),
    ]


def event_criteria(results):
    """Return the criteria on events."""
    lines = [COUNTED.findall(line) for line in results["output"].splitlines()]
    counts = [list(map(int, numbers)) for numbers in lines if len(numbers) == 3]
    words = []
    are_delivered = results["reader_error"] is None
    for name, (delivered, spooled, dropped), out in zip(
        ("pipe", "topic"), counts, results["out"], strict=True
    ):
        fates = f"{delivered} delivered, {spooled} left in the spool, {dropped} dropped"
        words.append(f"{name}: {fates}, {out} read")
        are_delivered &= delivered <= out <= delivered + spooled and not dropped
    if results["reader_error"]:
        error = results["reader_error"]
        words.append(f"the reader of the topic came too late for the mock broker: {error}")
    unbalanced = results["unbalanced"]
    repeated = results["repeated"]
    disordered = results["disordered"]
    return [
        Criterion("books balance", f"off by {max(unbalanced)} events", not any(unbalanced)),
        Criterion("all events delivered", "; ".join(words), are_delivered),
        Criterion(
            "repeated events",
            f"{repeated[0]} in the pipe, {repeated[1]} in the topic",
            repeated[0] == 0,
        ),
        Criterion(
            "each sensor's events in order", f"{disordered} after a later one", disordered == 0
        ),
    ]


def criteria(results):
    """Return all criteria."""
    answers = results["triggers"]
    counts = ", ".join(f"{count} × status {code}" for code, count in answers.items())
    stop = f"{results['stop_s']:.1f} s, exit code {results['code']}"
    viewer = results["viewer"]
    late_s = results["late_s"]
    return [
        *memory_criteria(results["samples"]),
        *event_criteria(results),
        Criterion("at most 5 s late while ready", f"{late_s:.2f} s", late_s <= 5.0),
        Criterion("launches accepted", counts, all(code < 500 for code in answers)),
        Criterion(
            "SIGTERM stops it within 5 s", stop, results["stop_s"] < 5.0 and results["code"] == 0
        ),
        Criterion("viewer receives the end", f"{viewer.frames} frames", viewer.has_end),
    ]


def page(results, options):
    """Return the page."""
    final = results["samples"][-1]
    faults = results["faults"]
    rows = criteria(results)
    return PAGE.format(
        answer="Yes" if all(row.is_met for row in rows) else "No",
        minutes=options.minutes,
        speed=options.speed,
        laps=final["lap"],
        given=final["given"],
        faults=sum(faults.values()),
        rows=criteria_table(rows),
        trigger_s=TRIGGER_S,
        seed=options.seed,
        kinds=", ".join(f"{kind} ({count} times)" for kind, count in faults.items()),
        machine=options.machine,
        warm_up=100 * WARM_UP,
        warm_up_laps=WARM_UP_LAPS,
        flat=100 * FLAT,
    )


def draw(path, samples, panels=PANELS):
    """Draw four columns of the samples by minute."""
    with svg_plot(path, 2, 2, figsize=(9.0, 5.0), sharex=True) as (_, axes):
        for panel, (title, name) in zip(axes.flat, panels.items(), strict=True):
            minute = [row["at_s"] / 60 for row in samples]
            panel.plot(minute, samples.column(name), linewidth=1.0)
            panel.set(title=title, ylim=(0.0, None), xlabel="minute")


def main():
    """Run the test; return 1 if a criterion is not met."""
    options = options_of(__doc__, minutes=30.0, seed=1, machine="", speed="max")
    with tempfile.TemporaryDirectory() as folder:
        results = soaked(options, Path(folder))
    rows = criteria(results)
    is_met = all(row.is_met for row in rows)
    print(results["output"], results["faults"], *rows, "met" if is_met else "NOT MET", sep="\n")
    if options.write:
        text = page(results, options)
        (options.write / "soak.md").write_text(text, encoding="utf-8")
        write_csv(options.write / "soak.csv", results["samples"])
        draw(options.write / "soak.svg", Table(results["samples"]))
    return 0 if is_met else 1


if __name__ == "__main__":
    sys.exit(main())
