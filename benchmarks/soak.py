"""Soak test of the service at full speed: constant memory and file descriptors, and delivery of every event.

    nice python benchmarks/soak.py --minutes 30 [--write docs/benchmarks]

`opir serve --speed max --loop` in a process of its own: two constellations, a tracker, a launch requested every minute
of scene time, a viewer of the stream, and a spooled output into a pipe that this script reads line by line, with
pauses. In a pause the spool fills to its limit and holds the run; afterwards it must empty. After SIGTERM every event
that the service reports as delivered must have come out of the pipe, once. `--write` writes the page, the samples as
CSV and, where matplotlib is installed, a plot.
"""

import argparse
import contextlib
import csv
import http.client
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import asdict, fields, frozen

PAGE = """# Soak test

Does the service run for long without leaks or lost events? {answer}: {minutes:g} minutes of
`opir serve --speed max --loop`, {laps} laps of a scene of 5 minutes, {given} events.

| criterion | result | met |
|---|---|---|
{rows}

![Memory, spool file, waiting events and events read, by minute](soak.svg)

The samples are in [soak.csv](soak.csv).

## Method

The output has a spool. A launch is requested every {trigger_s:g} s of scene time; one viewer reads the stream.
Every {every_min:g} minutes the reader of the output pauses for {pause_s:g} s: the spool fills and holds the run.
Memory is constant if the medians of the first and the last quarter after the warm-up ({warm_up:g} % of the run)
differ by at most {flat:g} %. Made by `python benchmarks/soak.py --write docs/benchmarks`.
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
  - jsonl: {path: PIPE, spool: {path: SPOOL, max_bytes: 8388608, when_full: wait, wait_s: 120.0}}
"""
LAUNCH = {
    "type": "ICBM",
    "launch": {"lat_deg": 34.73, "lon_deg": -120.57},
    "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
}
HEADERS = {"Content-Type": "application/json"}

SAMPLE_S = 10.0
#: Scene time between launches: with real time, how many there are in a lap would hang on the machine's other work.
TRIGGER_S = 60.0
PAUSE_EVERY_S = 300.0
PAUSE_S = 25.0
#: The part of the run that is warm-up.
WARM_UP = 0.25
#: How much memory may grow from the first to the last quarter of what follows the warm-up.
FLAT = 0.03


@frozen
class Sample:
    """The service at a moment."""

    at_s: float
    rss_mib: float
    descriptors: int
    spool_mib: float
    waiting: int
    given: int
    out: int
    lap: int
    tracks: int


class Pipe:
    """The far end of the output: counts lines, and their identifiers' repetitions within a few thousand."""

    def __init__(self, path: Path) -> None:
        self.lines = self.repeated = self.longest_pause = 0
        self.flowing = threading.Event()
        self.flowing.set()
        self._path = path
        self.thread = threading.Thread(target=self._read, daemon=True)
        self.thread.start()

    def _read(self) -> None:
        recent: dict[str, None] = {}
        with self._path.open("rb") as lines:
            for line in lines:
                self.flowing.wait()
                self.lines += 1
                name = json.loads(line)["detection_id"]
                self.repeated += name in recent
                recent[name] = None
                if len(recent) > 50_000:
                    for old in list(recent)[:25_000]:
                        del recent[old]


class Viewer:
    """A client of the stream, which counts its frames."""

    def __init__(self, port: int) -> None:
        self.frames = 0
        self.is_told_the_end = False
        self._port = port
        self.thread = threading.Thread(target=self._read, daemon=True)
        self.thread.start()

    def _read(self) -> None:
        connection = http.client.HTTPConnection("127.0.0.1", self._port)
        connection.request("GET", "/stream?view=brief")
        response = connection.getresponse()
        while line := response.readline():
            self.frames += line.startswith(b"event:")
            self.is_told_the_end |= line.startswith(b"event: end")


def asked(port: int, method: str, path: str, body: Any = None) -> tuple[int, Any]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60.0)
    try:
        connection.request(method, path, None if body is None else json.dumps(body), HEADERS if body else {})
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())
    finally:
        connection.close()


def sampled(process: int, port: int, spool: Path, pipe: Pipe, began_s: float) -> Sample:
    status = asked(port, "GET", "/status")[1]
    memory = Path(f"/proc/{process}/status").read_text(encoding="ascii")
    rss_kib = next(int(line.split()[1]) for line in memory.splitlines() if line.startswith("VmRSS"))
    files = [Path(f"{spool}{end}") for end in ("", "-wal", "-shm")]
    sink = status["sinks"][0]
    return Sample(
        at_s=time.monotonic() - began_s,
        rss_mib=rss_kib / 1024,
        descriptors=len(list(Path(f"/proc/{process}/fd").iterdir())),
        spool_mib=sum(file.stat().st_size for file in files if file.exists()) / 2**20,
        waiting=sink["spooled"],
        given=sink["given"],
        out=pipe.lines,
        lap=status["clock"]["lap"],
        tracks=status["counts"]["tracks"],
    )


def soaked(minutes: float, folder: Path) -> dict[str, Any]:
    """Run it; return samples, answers to triggers by status, and how it ended."""
    spool = folder / "spool"
    os.mkfifo(folder / "pipe")
    scene = folder / "scene.yaml"
    text = SCENE.replace("PIPE", str(folder / "pipe")).replace("SPOOL", str(spool))
    scene.write_text(text, encoding="utf-8")
    pipe = Pipe(folder / "pipe")
    command = [sys.executable, "-m", "opir_core", "serve", str(scene), "--speed", "max", "--loop", "--port", "0"]
    service = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert service.stdout is not None
        port = int(service.stdout.readline().rpartition(":")[2])
        viewer = Viewer(port)
        samples, triggers = watched(service.pid, port, spool, pipe, minutes * 60)
        service.send_signal(signal.SIGTERM)
        began_s = time.monotonic()
        told = service.communicate(timeout=60.0)[0]
        stop_s = time.monotonic() - began_s
    finally:
        service.kill()
    for thread in (pipe.thread, viewer.thread):
        thread.join(10.0)
    return {
        "samples": samples,
        "triggers": triggers,
        "told": told,
        "stop_s": stop_s,
        "code": service.returncode,
        "out": pipe.lines,
        "repeated": pipe.repeated,
        "viewer": (viewer.frames, viewer.is_told_the_end),
    }


def watched(process: int, port: int, spool: Path, pipe: Pipe, for_s: float) -> tuple[list[Sample], dict[int, int]]:
    """Sample, trigger and pause until the time is over; the last pause ends a minute or more before."""
    began_s = time.monotonic()
    samples: list[Sample] = []
    triggers: dict[int, int] = {}
    trigger_due_s, sample_due_s = 0.0, began_s
    while (at_s := time.monotonic() - began_s) < for_s:
        paused = at_s % PAUSE_EVERY_S > PAUSE_EVERY_S - PAUSE_S and at_s < for_s - 60.0
        (pipe.flowing.clear if paused else pipe.flowing.set)()
        scene_s = asked(port, "GET", "/status")[1]["clock"]["time_s"]
        if scene_s >= trigger_due_s:
            trigger_due_s = scene_s + TRIGGER_S
            answer, told = asked(port, "POST", "/trigger", LAUNCH)
            triggers[answer] = triggers.get(answer, 0) + 1
            if answer != 202:
                print(answer, told, flush=True)
        if time.monotonic() >= sample_due_s:
            sample_due_s += SAMPLE_S
            samples.append(sampled(process, port, spool, pipe, began_s))
            print(samples[-1], flush=True)
        time.sleep(0.05)
    pipe.flowing.set()
    return samples, triggers


def quarters(values: Sequence[float]) -> tuple[float, float]:
    """Return the medians of the first and of the last quarter."""
    size = max(1, len(values) // 4)
    return float(np.median(values[:size])), float(np.median(values[-size:]))


def verdict(found: dict[str, Any]) -> tuple[list[str], bool]:
    """Return the rows of the table of criteria, each with its result, and whether all are met."""
    samples: list[Sample] = found["samples"]
    warm = samples[int(WARM_UP * len(samples)) :]
    rss, fds = (quarters([getattr(each, name) for each in warm]) for name in ("rss_mib", "descriptors"))
    settled = [each for each in warm if each.at_s % PAUSE_EVERY_S > 60.0 and each.at_s % PAUSE_EVERY_S < 270.0]
    least = min((each.waiting for each in settled), default=-1)
    delivered = int(found["told"].split(" delivered")[0].rpartition(" ")[2])
    spooled = int(found["told"].split(" spooled")[0].rpartition(" ")[2])
    rows = [
        ("memory constant", f"{rss[0]:.1f} MiB in the first quarter, {rss[1]:.1f} MiB in the last",
         abs(rss[1] / rss[0] - 1.0) <= FLAT),
        ("file descriptors constant", f"{fds[0]:g}, later {fds[1]:g}", fds[0] == fds[1]),
        ("spool empties between pauses", f"minimum {least} waiting events", least == 0),
        ("spool file bounded", f"maximum {max(each.spool_mib for each in samples):.1f} MiB", True),
        ("all events delivered", f"{delivered} delivered, {spooled} left in the spool, {found['out']} read",
         delivered == found["out"]),
        ("no duplicates", f"{found['repeated']} repeated", found["repeated"] == 0),
        ("launches accepted", f"{counted(found['triggers'])}", all(code < 500 for code in found["triggers"])),
        ("SIGTERM stops it within 5 s", f"{found['stop_s']:.1f} s, exit code {found['code']}",
         found["stop_s"] < 5.0 and found["code"] == 0),
        ("viewer receives the end", f"{found['viewer'][0]} frames", found["viewer"][1]),
    ]  # fmt: skip
    lines = [f"| {name} | {what} | {'yes' if met else 'NO'} |" for name, what, met in rows]
    return lines, all(met for _, _, met in rows)


def counted(answers: dict[int, int]) -> str:
    """Return how many answers there were of each HTTP status."""
    return ", ".join(f"{count} × status {code}" for code, count in answers.items())


def page(found: dict[str, Any], minutes: float) -> str:
    """Return the page."""
    last = found["samples"][-1]
    rows, met = verdict(found)
    return PAGE.format(
        answer="Yes" if met else "No",
        minutes=minutes,
        laps=last.lap,
        given=last.given,
        rows="\n".join(rows),
        trigger_s=TRIGGER_S,
        every_min=PAUSE_EVERY_S / 60,
        pause_s=PAUSE_S,
        warm_up=100 * WARM_UP,
        flat=100 * FLAT,
    )


def write_csv(samples: Sequence[Sample], path: Path) -> None:
    """Write the samples, a row each."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(field.name for field in fields(Sample))
        for sample in samples:
            values = asdict(sample).values()
            writer.writerow(f"{value:.1f}" if isinstance(value, float) else value for value in values)


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
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write soak.md, soak.csv and soak.svg to FOLDER")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = soaked(arguments.minutes, Path(folder))
    lines, met = verdict(found)
    print(found["told"], *lines, "met" if met else "NOT MET", sep="\n")
    if arguments.write:
        (arguments.write / "soak.md").write_text(page(found, arguments.minutes), encoding="utf-8")
        write_csv(found["samples"], arguments.write / "soak.csv")
        with contextlib.suppress(ImportError):
            plot(found["samples"], arguments.write / "soak.svg")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
