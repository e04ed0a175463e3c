"""A service in a process of its own, with a broker and a disk that can be spoilt, and the books
that it must keep.

Each life of the service has a day of scene time of its own, so that an event tells its life. Two
outputs with a spool get the same events: a topic, and a file. What one has must be in the other.
"""

import http.client
import json
import os
import re
import shutil
import signal
import tempfile
import threading
import time
from collections import defaultdict
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import kafka_broker
from faulty_process import tell
from forked_processes import is_alive
from kafka_broker import messages
from waiting import until

SCENE = """
scene: watched
epoch: "2026-04-01T12:00:00Z"
duration_s: 60
seed: 5
sensors:
  - constellation: DSP
  - constellation: SBIRS-GEO
targets:
  - id: T1
    type: ICBM
    launch: {lat_deg: 34.73, lon_deg: -120.57, time_s: 0.1}
    aim: {lat_deg: 9.0, lon_deg: 167.7}
"""
LAUNCH = {
    "type": "SRBM",
    "launch": {"lat_deg": 22.0, "lon_deg": -160.0},
    "aim": {"lat_deg": 24.0, "lon_deg": -158.0},
}
#: Answers to a request that the run cannot serve now, and says so.
BUSY = {409, 412, 429, 503}
UNREADY_S = 3.0
#: The mock broker keeps the last 5 MiB of each partition.
PARTITIONS = 12
#: Time for what is whole again to be ready, and for a spool to empty, on a slow machine, s.
RECOVERY_S = 120.0
#: Times for a machine that does other work too, s.
PATIENT = kafka_broker.BRISK | {
    "request_timeout_s": 3.0,
    "acknowledgement_timeout_s": 4.0,
    "connect_timeout_s": 6.0,
}
COUNTS = ("delivered", "spooled", "dropped", "withheld")


class WatchedService:
    """The service, from life to life; `close` heals everything and examines what has arrived."""

    def __init__(self, nurse, broker):
        self.folder = Path(tempfile.mkdtemp(prefix="opir-watched-"))
        self._nurse = nurse
        self.broker = broker
        self.topic = broker.topic(PARTITIONS)
        self.disk = self.folder / "disk"
        self.disk.mkdir()
        self.control = self.folder / "control"
        self.log = self.folder / "log"
        os.mkfifo(self.control)
        (self.folder / "scene.yaml").write_text(SCENE, encoding="utf-8")
        self.life = -1
        self.number = None
        self.is_frozen = False
        self.is_faulty = False
        #: By life: the events given at least, those that viewers have seen, and those that may be
        #: missing.
        self.given = {}
        self.seen = defaultdict(set)
        self.lost = {"lines": 0, "topic": 0}
        self.start()

    @property
    def is_running(self):
        return self.number is not None

    def start(self):
        """Begin a life."""
        self.life += 1
        self.log.unlink(missing_ok=True)
        stored = {"when_full": "wait", "wait_s": 600}
        kafka = {"bootstrap_servers": self.broker.address, "topic": self.topic, **PATIENT}
        sinks = [
            {
                "jsonl": {
                    "path": str(self.disk / "lines"),
                    "spool": {"path": str(self.disk / "a.spool"), **stored},
                }
            },
            {"kafka": {**kafka, "spool": {"path": str(self.disk / "b.spool"), **stored}}},
        ]
        words = ["serve", str(self.folder / "scene.yaml"), "--port", "0", "--speed", "5", "--loop"]
        words += ["--unready-after", str(UNREADY_S), "--set", f"outputs={json.dumps(sinks)}"]
        # A lap adds 1 to the seed: laps of two lives must not share ids.
        words += [
            "--set",
            f"seed={1000 * self.life}",
            "--set",
            f'epoch="2026-04-{self.life + 1:02d}T12:00:00Z"',
        ]
        self.number = self._nurse.born(self.log, str(self.disk), str(self.control), *words)
        until(lambda: "http://" in self.reported() or not is_alive(self.number or 0))
        assert "http://" in self.reported(), self.reported()
        result = re.search(r"http://[^:]+:(\d+)", self.reported())
        assert result
        self.port = int(result[1])
        threading.Thread(target=self._view, args=(self.life, self.port), daemon=True).start()

    def reported(self):
        return self.log.read_text(encoding="utf-8") if self.log.exists() else ""

    def ask(self, method, path, body=None, **headers):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60.0)
        try:
            more = {"Content-Type": "application/json"} if body is not None else {}
            connection.request(
                method, path, None if body is None else json.dumps(body), {**more, **headers}
            )
            answer = connection.getresponse()
            self.etag = answer.headers.get("ETag", "")
            return answer.status, json.loads(answer.read() or b"null")
        finally:
            connection.close()

    def launch(self):
        status, reported = self.ask("POST", "/trigger", LAUNCH)
        assert status == 202 or status in BUSY, reported

    def configure(self, period_ms, client):
        """Change the scan period of the first sensor, and the output to the broker, which is opened
        anew.
        """
        _, settings = self.ask("GET", "/config")
        tag = self.etag
        settings["sensors"][0]["members"][0]["scan_period_ms"] = period_ms
        settings["outputs"][1]["kafka"]["client_id"] = client
        status, reported = self.ask("PUT", "/config", settings, **{"If-Match": tag})
        assert status == 200 or status in BUSY, reported

    def freeze(self):
        self.broker.freeze()
        self.is_frozen = True

    def thaw(self):
        if self.is_frozen:
            self.broker.thaw()
        self.is_frozen = False

    def fail_disk(self, number, error, lasts, kinds):
        tell(self.control, "fail", number, error, lasts, ",".join(kinds))
        self.is_faulty = True

    def heal_disk(self):
        tell(self.control, "heal")
        self.is_faulty = False

    def stop(self):
        """End the life with SIGTERM; the report must be in time, and balance."""
        assert self.number is not None
        self._observe_given()
        os.kill(self.number, signal.SIGTERM)
        until(lambda: not is_alive(self.number or 0))
        self.number = None
        self.is_faulty = False
        reported = self.reported()
        assert "Traceback" not in reported, reported
        dropped = [int(result) for result in re.findall(r"spooled, (\d+) dropped", reported)]
        assert len(dropped) == 2, reported
        self.lost = {
            name: self.lost[name] + count for name, count in zip(self.lost, dropped, strict=True)
        }

    def kill(self):
        assert self.number is not None
        self._observe_given()
        os.kill(self.number, signal.SIGKILL)
        until(lambda: not is_alive(self.number or 0))
        self.number = None
        self.is_faulty = False

    def damage(self, name, seed, flips):
        """Flip bits of the spool of a service that was stopped, behind its first page; return
        whether there is more.
        """
        import random

        path = self.disk / name
        rng = random.Random(seed)
        content = bytearray(path.read_bytes())
        if len(content) <= 8192 or path.with_name(f"{name}-wal").exists():
            return False
        for _ in range(flips):
            content[rng.randrange(4096, len(content))] ^= 1 << rng.randrange(8)
        path.write_bytes(content)
        return True

    def observe(self):
        """Check what holds at any moment: books, and a readiness that follows the cycles."""
        ready, reasons = self.ask("GET", "/health/ready")
        began_s = time.monotonic()
        self._observe_given()
        status = self.ask("GET", "/status")[1]
        age_s = status["clock"]["cycle_age_s"] - (time.monotonic() - began_s)
        assert ready == 503 or age_s < UNREADY_S + 0.5, (reasons, status["clock"])
        assert status["state"] == "running", status
        for sink in status["sinks"]:
            assert sink["state"] in ("open", "parked"), sink
            assert sink["unbalanced"] == 0, sink

    def _observe_given(self):
        """Note how many events were given; a window is counted after it is in the spool, so wait
        until it is.
        """
        give_up_s = time.monotonic() + (60.0 if not self.is_faulty else 0.3)
        while True:
            sinks = self.ask("GET", "/status")[1]["sinks"]
            off = [
                sum(sink[name] for name in COUNTS) - sink["given"] - sink["recovered"]
                for sink in sinks
            ]
            if not any(off) or (time.monotonic() > give_up_s and self.is_faulty):
                break
            assert time.monotonic() < give_up_s, sinks
        self.given[self.life] = max(
            self.given.get(self.life, 0), min(sink["given"] for sink in sinks)
        )
        self.sinks = sinks

    def recover(self):
        """Heal everything; the service must become ready, and deliver all that was given."""
        self.thaw()
        self.broker.heal()
        if not self.is_running:
            self.start()
        self.heal_disk()
        give_up_s = time.monotonic() + RECOVERY_S
        while (health := self.ask("GET", "/health/ready"))[0] != 200:
            assert time.monotonic() < give_up_s, (health, self._sinks(), self.reported())
            self._retry()
        missing = {
            sink["path"]: sink["given"] + sink["recovered"]
            for sink in self.ask("GET", "/status")[1]["sinks"]
        }
        while any(self._done(sink) < missing[sink["path"]] for sink in self._sinks()):
            assert time.monotonic() < give_up_s, (missing, self._sinks(), self.reported())
            time.sleep(0.1)

    def _sinks(self):
        return self.ask("GET", "/status")[1]["sinks"]

    def _done(self, sink):
        return int(sink["delivered"] + sink["dropped"] + sink["withheld"])

    def _retry(self):
        """Let parked outputs try again, at a moderate rate."""
        for sink in self._sinks():
            if sink["state"] == "parked":
                self.ask("POST", f"/outputs/{sink['name']}/retry")
        time.sleep(0.2)

    def close(self):
        """Heal, stop and examine."""
        try:
            for _ in range(3):  # a stop has 4 s, which are too few for a slow machine now and then
                self.recover()
                self.observe()
                self.stop()
                if self.reported().count(" 0 spooled") == 2:
                    break
            assert self.reported().count(" 0 spooled") == 2, self.reported()
            self.examine()
        finally:
            self.end()

    def end(self):
        """Leave nothing behind."""
        self.thaw()
        self.broker.heal()
        if self.number is not None:
            with suppress(ProcessLookupError):  # ended by itself, which the error on its way tells
                os.kill(self.number, signal.SIGKILL)
        shutil.rmtree(self.folder, ignore_errors=True)

    def examine(self):
        """Hold what arrived in the file against what arrived in the topic, by life and sensor."""
        lines = [json.loads(line) for line in (self.disk / "lines").read_bytes().splitlines()]
        came = messages(self.broker.address, self.topic)
        offsets = {message.partition(): message.offset() for message in reversed(came)}
        assert not any(offsets.values()), "the broker has forgotten the first messages"
        carried = [json.loads(message.value()) for message in came]
        arrived = {"lines": by_life(lines), "topic": by_life(carried)}
        everything = {name: {} for name in arrived}
        for name, lives in arrived.items():
            for events in (events for sensors in lives.values() for events in sensors.values()):
                everything[name] |= {event["detection_id"]: event for event in events}
                hold_order(name, [event["timestamp"] for event in events])
        names = everything["lines"].keys() & everything["topic"].keys()
        assert all(everything["lines"][each] == everything["topic"][each] for each in names)
        for name, lives in arrived.items():
            missing = 0
            for life in range(self.life + 1):
                count = sum(map(len, lives.get(life, {}).values()))
                missing += max(0, self.given.get(life, 0) - count)
            assert missing <= self.lost[name], (name, missing, self.lost)
            unseen = set().union(*self.seen.values()) - everything[name].keys()
            assert len(unseen) <= self.lost[name], (name, len(unseen), self.lost)

    def _view(self, life, port):
        """Note the ids of all detections that a viewer receives."""
        remainder = b""
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60.0)
        try:
            connection.request("GET", "/stream")
            response = connection.getresponse()
            while chunk := response.read1(1 << 16):
                *lines, remainder = (remainder + chunk).split(b"\n")
                for line in lines:
                    identifiers = re.findall(rb'"detection_id":"([0-9a-f-]{36})"', line)
                    self.seen[life].update(identifier.decode() for identifier in identifiers)
        except (OSError, http.client.HTTPException):
            return
        finally:
            connection.close()


def hold_order(name, times):
    """Events of a sensor arrive in the order of their times."""
    fallen = (at for at, (start, end) in enumerate(pairwise(times)) if start > end)
    at = next(fallen, None)
    assert at is None, (name, "out of order", times[max(at - 3, 0) : at + 5], len(times))


def by_life(events):
    """Return the first arrivals by life and sensor; a second one must be the same."""
    arrivals = {}
    for event in events:
        assert arrivals.setdefault(event["detection_id"], event) == event
    lives = defaultdict(lambda: defaultdict(list))
    for event in arrivals.values():
        lives[life_of(event)][event["sensor_id"]].append(event)
    return lives


def life_of(event):
    """Return the life of an event: the days since the first."""
    return int(event["timestamp"][8:10]) - 1
