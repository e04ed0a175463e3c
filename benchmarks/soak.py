"""Soak test of the service at full speed with faults at random: constant memory and descriptors,
every event delivered.

    nice python benchmarks/soak.py --minutes 60 [--seed 1] [--write docs/benchmarks]

`opir serve --speed max --loop` in a process of its own: two constellations, a tracker, a launch
requested every minute of scene time, a viewer of the stream, and two outputs with a spool: a pipe
that another process reads, and a topic of a mock broker, or of Apache Kafka (`--apache`; Java and
Maven are needed). Every half minute or so a fault of some seconds: the broker is gone, stopped,
slow or refuses events (of Apache Kafka: it is killed, ended or stopped), the reader of the pipe is
stopped, or no file of the service can grow. After SIGTERM every event that the service reports as
delivered must have arrived. `--write` writes the page, the samples as CSV and, where matplotlib is
installed, a plot.
"""

import argparse
import contextlib
import csv
import http.client
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import asdict, fields, frozen
from soak_faults import (
    BrokerFaults,
    Faults,
    PipeReader,
    TopicReader,
    apache_kafka,
    descriptors,
    file_mib,
    mock_kafka,
    rss_mib,
)

PAGE = """# {title}

Does the service run for long without leaks or lost events, whatever fails around it? {answer}: {minutes:g} minutes of
`opir serve --speed {speed} --loop`, {laps} laps of a scene of 5 minutes, {given} events to each of two outputs,
{faults} faults.

| criterion | result | met |
|---|---|---|
{rows}

![Memory, spool file, waiting events and events read, by minute]({name}.svg)

Both outputs, a pipe and a topic of {broker}, have a spool of 8 MiB that holds the run when it is full. A launch is
requested every {trigger_s:g} s of scene time; one viewer reads the stream. Faults of 2 to 12 s, 10 to 25 s apart, of
seed {seed}: {kinds}.{machine} Samples: [{name}.csv]({name}.csv).

Memory is constant if the least of the last quarter is at most {flat:g} % above the least of the first, after the
warm-up ({warm_up:g} % of the run, and {warm_up_laps} laps). What grows before is bounded: histories of
detections and tracks.
"""

SCENE = """
scene: soak
epoch: "2026-04-01T12:00:00Z"
duration_s: 300
seed: 5
sensors:
  - constellation: DSP
  - constellation: SBIRS-GEO
tracker: imm
targets:
  - id: T1
    type: ICBM
    launch: {lat_deg: 34.73, lon_deg: -120.57, time_s: 1.0}
    aim: {lat_deg: 9.0, lon_deg: 167.7}
  - id: T2
    type: SRBM
    launch: {lat_deg: 22.0, lon_deg: -160.0, time_s: 60.0}
    aim: {lat_deg: 24.0, lon_deg: -158.0}
outputs:
  - jsonl: {path: PIPE, spool: {path: SPOOL-pipe, max_bytes: 8388608, when_full: wait, wait_s: 120.0}}
  - kafka:
      bootstrap_servers: BROKER
      topic: soak
      compression: gzip
      request_timeout_s: 2.0
      acknowledgement_timeout_s: 3.0
      longest_pause_s: 0.5
      spool: {path: SPOOL-topic, max_bytes: 8388608, when_full: wait, wait_s: 120.0}
"""
LAUNCH = {
    "type": "ICBM",
    "launch": {"lat_deg": 34.73, "lon_deg": -120.57},
    "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
}
HEADERS = {"Content-Type": "application/json", "If-Match": "*"}
#: Tracks that the page keeps: so few that they are all there within the warm-up.
TRACKS = 100

SAMPLE_S = 10.0
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
#: How late, s, a run may be that says that it is ready.
LATE_S = 5.0
#: Connections come and go with faults.
DESCRIPTORS = 2
COUNTED = re.compile(r"(\d+) (?:delivered|spooled|dropped)")
FATES = ("delivered", "spooled", "dropped", "withheld")


@frozen
class Sample:
    """The service at a moment; of counts of outputs, the sum of both."""

    at_s: float
    rss_mib: float
    descriptors: int
    spool_mib: float
    waiting: int
    given: int
    out: int
    lap: int
    tracks: int
    fault: str


class Viewer:
    """A client of the stream, which counts its frames."""

    def __init__(self, port: int) -> None:
        self.frames = 0
        self.has_end = False
        self._port = port
        self.thread = threading.Thread(target=self._read, daemon=True)
        self.thread.start()

    def _read(self) -> None:
        connection = http.client.HTTPConnection("127.0.0.1", self._port)
        connection.request("GET", "/stream?view=brief")
        response = connection.getresponse()
        while line := response.readline():
            self.frames += line.startswith(b"event:")
            self.has_end |= line.startswith(b"event: end")


def asked(port: int, method: str, path: str, body: Any = None) -> tuple[int, Any]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60.0)
    try:
        connection.request(
            method, path, None if body is None else json.dumps(body), HEADERS if body else {}
        )
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())
    finally:
        connection.close()


def limit_tracks(port: int) -> None:
    """Let the service keep few tracks for its page; a run that is late at its start takes no
    settings yet.
    """
    config = asked(port, "GET", "/config")[1]
    config["http"]["maximum_tracks"] = TRACKS
    give_up_s = time.monotonic() + 60.0
    while (answer := asked(port, "PUT", "/config", config))[0] != 200:
        if answer[0] != 429 or time.monotonic() > give_up_s:
            raise AssertionError(answer)
        time.sleep(0.5)


def balanced(port: int) -> dict[str, Any]:
    """Return a status in which the books of both outputs balance; a window is counted once it is in
    the spool.
    """
    give_up_s = time.monotonic() + 30.0
    while True:
        status: dict[str, Any] = asked(port, "GET", "/status")[1]
        sinks = status["sinks"]
        if all(
            sum(each[name] for name in FATES) == each["given"] + each["recovered"] for each in sinks
        ):
            return status
        if time.monotonic() > give_up_s:
            raise AssertionError(f"the books do not balance: {sinks}")


def sampled(
    process: int, port: int, spools: Sequence[Path], out: int, began_s: float, fault: str
) -> Sample:
    # While the disk takes nothing, a window waits half counted.
    status = balanced(port) if not fault else asked(port, "GET", "/status")[1]
    return Sample(
        at_s=time.monotonic() - began_s,
        rss_mib=rss_mib(process),
        descriptors=descriptors(process),
        spool_mib=sum(map(file_mib, spools)),
        waiting=sum(sink["spooled"] for sink in status["sinks"]),
        given=status["sinks"][0]["given"],
        out=out,
        lap=status["clock"]["lap"],
        tracks=status["counts"]["tracks"],
        fault=fault,
    )


def scene_with(folder: Path, address: str) -> Path:
    """Write the scene with its pipe and the address of its broker, and return its path."""
    os.mkfifo(folder / "pipe")
    text = SCENE
    for name, value in {
        "PIPE": folder / "pipe",
        "SPOOL": folder / "spool",
        "BROKER": address,
    }.items():
        text = text.replace(name, str(value))
    scene = folder / "scene.yaml"
    scene.write_text(text, encoding="utf-8")
    return scene


def soaked(arguments: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Run it before a broker; return what was found."""
    with (apache_kafka if arguments.apache else mock_kafka)(folder, "soak") as (
        address,
        broker_faults,
    ):
        return soaked_before(address, broker_faults, arguments, folder)


def soaked_before(
    address: str, broker_faults: BrokerFaults, arguments: argparse.Namespace, folder: Path
) -> dict[str, Any]:
    """Run it; return samples, answers to triggers by status, and how it ended."""
    scene = scene_with(folder, address)
    pipe = PipeReader(folder / "pipe")
    topic = TopicReader(address, "soak")
    command = [sys.executable, "-m", "opir_core", "serve", str(scene), "--loop", "--port", "0"]
    command += ["--speed", arguments.speed]
    service = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    faults = Faults(arguments.seed, service.pid, broker_faults, pipe)
    try:
        assert service.stdout is not None
        port = int(service.stdout.readline().rpartition(":")[2])
        limit_tracks(port)
        viewer = Viewer(port)
        spools = [folder / f"spool-{kind}" for kind in ("pipe", "topic")]
        seen = watched(service.pid, port, spools, (pipe, topic, faults), arguments.minutes * 60)
        status = balanced(port)
        service.send_signal(signal.SIGTERM)
        began_s = time.monotonic()
        output = service.communicate(timeout=60.0)[0]
        stop_s = time.monotonic() - began_s
        pipe.thread.join(20.0)
        viewer.thread.join(10.0)
        time.sleep(2.0)
        topic.close()
    finally:
        service.kill()
        faults.end()
        pipe.close()
    return {
        **seen,
        "output": output,
        "stop_s": stop_s,
        "code": service.returncode,
        "out": (pipe.lines, topic.messages),
        "repeated": (pipe.repeated, topic.repeated),
        "disordered": topic.disordered,
        "reader_error": topic.error,
        "unbalanced": [sink["unbalanced"] for sink in status["sinks"]],
        "faults": faults.counts,
        "viewer": (viewer.frames, viewer.has_end),
    }


def watched(
    process: int,
    port: int,
    spools: Sequence[Path],
    parts: tuple[PipeReader, TopicReader, Faults],
    for_s: float,
) -> dict[str, Any]:
    """Sample, trigger and let things fail until the time is over, the last minute without faults.

    Returns the samples, the answers to triggers by status, and how late, s, the run was at most
    while it was ready.
    """
    pipe, topic, faults = parts
    began_s = time.monotonic()
    samples: list[Sample] = []
    triggers: dict[int, int] = {}
    late_s = 0.0
    trigger_due_s = 0.0
    sample_due_s = began_s
    while (at_s := time.monotonic() - began_s) < for_s:
        faults.step() if at_s < for_s - CALM_S else faults.end()
        status = asked(port, "GET", "/status")[1]
        scene_s = status["clock"]["time_s"]
        late_s = max(late_s, status["clock"]["late_s"] if status["health"]["ready"] else 0.0)
        if scene_s >= trigger_due_s and faults.now is None:
            trigger_due_s = scene_s + TRIGGER_S
            answer, body = asked(port, "POST", "/trigger", LAUNCH)
            triggers[answer] = triggers.get(answer, 0) + 1
            if answer != 202:
                print(answer, body, flush=True)
        if time.monotonic() >= sample_due_s:
            sample_due_s += SAMPLE_S
            out = pipe.lines + topic.messages
            samples.append(sampled(process, port, spools, out, began_s, faults.now or ""))
            print(samples[-1], flush=True)
        time.sleep(0.05)
    return {"samples": samples, "triggers": triggers, "late_s": late_s}


def quarters(
    values: Sequence[float], figure: Callable[[Sequence[float]], Any]
) -> tuple[float, float]:
    """Return a figure of the first and of the last quarter."""
    size = max(1, len(values) // 4)
    return float(figure(values[:size])), float(figure(values[-size:]))


def verdict(found: dict[str, Any]) -> tuple[list[str], bool]:
    """Return the rows of the table of criteria, each with its result, and whether all are met."""
    samples: list[Sample] = found["samples"]
    warm = [
        each for each in samples[int(WARM_UP * len(samples)) :] if each.lap >= WARM_UP_LAPS
    ] or samples
    fds = quarters([each.descriptors for each in warm], np.median)
    rss, usual = (quarters([each.rss_mib for each in warm], figure) for figure in (min, np.median))
    counts = [
        [int(count) for count in COUNTED.findall(line)] for line in found["output"].splitlines()
    ]
    delivered, spooled, dropped = zip(*(each for each in counts if len(each) == 3), strict=True)
    held = "least of the first quarter {:.1f} MiB, of the last {:.1f}; medians {:.1f} and {:.1f}"
    rows = [
        ("memory constant", held.format(*rss, *usual), rss[1] / rss[0] - 1.0 <= FLAT),
        ("file descriptors constant", f"{fds[0]:g}, later {fds[1]:g}", abs(fds[0] - fds[1]) <= DESCRIPTORS),
        ("spools empty after the last fault", f"{samples[-1].waiting} waiting", samples[-1].waiting < 5000),
        ("spool files bounded", f"maximum {max(each.spool_mib for each in samples):.1f} MiB", True),
        ("books balance", f"off by {max(found['unbalanced'])} events", not any(found["unbalanced"])),
        ("all events delivered", all_of(delivered, spooled, dropped, found["out"]) + too_late(found["reader_error"]),
         all(low <= out <= low + left for low, left, out in zip(delivered, spooled, found["out"], strict=True))
         and not any(dropped) and found["reader_error"] is None),
        ("repeated events", (f"{found['repeated'][0]} in the pipe, {found['repeated'][1]} in the"
                            f" topic"),
         found["repeated"][0] == 0),
        ("each sensor's events in order", f"{found['disordered']} after a later one", found["disordered"] == 0),
        ("at most 5 s late while ready", f"{found['late_s']:.2f} s", found["late_s"] <= LATE_S),
        ("launches accepted", f"{counted(found['triggers'])}", all(code < 500 for code in found["triggers"])),
        ("SIGTERM stops it within 5 s", f"{found['stop_s']:.1f} s, exit code {found['code']}",
         found["stop_s"] < 5.0 and found["code"] == 0),
        ("viewer receives the end", f"{found['viewer'][0]} frames", found["viewer"][1]),
    ]  # fmt: skip
    lines = [f"| {name} | {what} | {'yes' if met else 'NO'} |" for name, what, met in rows]
    return lines, all(met for _, _, met in rows)


def too_late(error: str | None) -> str:
    """Return that the reader of the topic was too slow for the memory of the mock broker."""
    return (
        ""
        if error is None
        else f"; the reader of the topic came too late for the mock broker: {error}"
    )


def all_of(*counts: Sequence[int]) -> str:
    """Return the counts of both outputs as one sentence."""
    names = ("delivered", "left in the spool", "dropped", "read")
    parts = [
        [f"{count[place]} {name}" for name, count in zip(names, counts, strict=True)]
        for place in range(2)
    ]
    return f"pipe: {', '.join(parts[0])}; topic: {', '.join(parts[1])}"


def counted(answers: dict[int, int]) -> str:
    """Return how many answers there were of each HTTP status."""
    return ", ".join(f"{count} × status {code}" for code, count in answers.items())


def page(found: dict[str, Any], arguments: argparse.Namespace, name: str) -> str:
    """Return the page."""
    machine = arguments.machine
    last = found["samples"][-1]
    rows, met = verdict(found)
    return PAGE.format(
        answer="Yes" if met else "No",
        minutes=arguments.minutes,
        speed=arguments.speed,
        title="Soak test with Apache Kafka" if arguments.apache else "Soak test",
        broker="Apache Kafka 4.1" if arguments.apache else "a mock Kafka broker",
        name=name,
        laps=last.lap,
        given=last.given,
        faults=sum(found["faults"].values()),
        rows="\n".join(rows),
        trigger_s=TRIGGER_S,
        seed=arguments.seed,
        kinds=", ".join(f"{name} ({count} times)" for name, count in found["faults"].items()),
        machine=f" {machine}" if machine else "",
        warm_up=100 * WARM_UP,
        warm_up_laps=WARM_UP_LAPS,
        flat=100 * FLAT,
    )


def write_csv(samples: Sequence[Sample], path: Path) -> None:
    """Write the samples, a row each."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(field.name for field in fields(Sample))
        for sample in samples:
            values = asdict(sample).values()
            writer.writerow(
                f"{value:.1f}" if isinstance(value, float) else value for value in values
            )


def plot(samples: Sequence[Sample], path: Path) -> None:
    """Draw the samples by minute."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
    import matplotlib.pyplot as plt

    minute = [each.at_s / 60 for each in samples]
    panels = {
        "memory, MiB": "rss_mib",
        "spool file, MiB": "spool_mib",
        "events waiting": "waiting",
        "events read": "out",
    }
    figure, grid = plt.subplots(2, 2, figsize=(9.0, 5.0), sharex=True)
    for axes, (title, name) in zip(grid.flat, panels.items(), strict=True):
        axes.plot(minute, [getattr(each, name) for each in samples], marker=".", linewidth=1.0)
        axes.set(title=title, ylim=(0.0, None))
        axes.grid(alpha=0.3)
    for axes in grid[1]:
        axes.set_xlabel("minute")
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--seed", type=int, default=1, help="seed of the faults")
    parser.add_argument(
        "--machine", default="", metavar="WORDS", help="a sentence on the machine, for the page"
    )
    parser.add_argument("--speed", default="max", help="as of opir serve")
    parser.add_argument(
        "--apache", action="store_true", help="Apache Kafka instead of a mock broker"
    )
    parser.add_argument(
        "--write", type=Path, metavar="FOLDER", help="write a page, its CSV and its plot to FOLDER"
    )
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = soaked(arguments, Path(folder))
    lines, met = verdict(found)
    print(found["output"], found["faults"], *lines, "met" if met else "NOT MET", sep="\n")
    if arguments.write:
        name = "soak_apache" if arguments.apache else "soak"
        (arguments.write / f"{name}.md").write_text(page(found, arguments, name), encoding="utf-8")
        write_csv(found["samples"], arguments.write / f"{name}.csv")
        with contextlib.suppress(ImportError):
            plot(found["samples"], arguments.write / f"{name}.svg")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
