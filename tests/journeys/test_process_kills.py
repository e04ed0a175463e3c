"""`opir` killed with SIGKILL at random moments and started again: whatever anyone has seen of an
event, it arrives.
"""

import http.client
import json
import os
import random
import re
import signal
import threading
import time

import kafka_broker
import pytest
from forked_processes import is_alive
from kafka_broker import messages
from serve_process import nursery
from waiting import until

from opir_core.host.host import Host
from opir_core.interfaces.contexts import EncoderContext
from opir_core.output.events.forge import ForgeEncoder
from opir_core.planning.plan import compile_plan
from opir_core.reading import load_scene
from opir_core.simulation.engine import Engine

KILLS = 20
RUNS = 8

SCENE = """
scene: kills
epoch: "2026-04-01T12:00:00Z"
duration_s: DURATION
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

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs POSIX processes")


@pytest.fixture(scope="module")
def nurse():
    with nursery() as made:
        yield made


class Viewer(threading.Thread):
    """Reads the stream of a service until it is cut off."""

    def __init__(self, port):
        super().__init__(daemon=True)
        self.port = port
        self._received = bytearray()
        self.start()

    def run(self):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60.0)
        try:
            connection.request("GET", "/stream")
            response = connection.getresponse()
            while chunk := response.read1(1 << 16):
                self._received += chunk
        except (ConnectionError, http.client.HTTPException):
            return
        finally:
            connection.close()

    def ids(self):
        """Return the ids of all detections that came whole."""
        return {
            result.decode()
            for result in re.findall(rb'"detection_id":"([0-9a-f-]{36})"', bytes(self._received))
        }


def status(port):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60.0)
    try:
        connection.request("GET", "/status")
        return json.loads(connection.getresponse().read())
    finally:
        connection.close()


def killed(number):
    os.kill(number, signal.SIGKILL)
    until(lambda: not is_alive(number))


def watched_lives(nurse, words, log):
    """Kill a service KILLS times while a viewer sees it, and end the last one in order.

    Return the ids that each viewer saw of those that were killed.
    """
    rng = random.Random(KILLS)
    viewed = []
    for life in range(KILLS + 1):
        log.unlink(missing_ok=True)
        number = nurse.born(log, *words, "--set", f"seed={life}")
        until(lambda: log.exists() and "http://" in log.read_text(encoding="utf-8"))
        viewer = Viewer(int(log.read_text(encoding="utf-8").splitlines()[0].split(":")[3]))
        until(viewer.ids)
        time.sleep(0.2 * rng.random())
        if life < KILLS:
            killed(number)
            viewer.join()
            viewed.append(viewer.ids())
    until(
        lambda: all(sink["delivered"] > sink["recovered"] for sink in status(viewer.port)["sinks"])
    )
    os.kill(number, signal.SIGTERM)
    until(lambda: not is_alive(number))
    return viewed


@pytest.mark.slow
def test_what_a_viewer_has_seen_of_a_service_that_is_killed_arrives(nurse, tmp_path):
    scene = tmp_path / "scene.yaml"
    log = tmp_path / "log"
    lines = tmp_path / "lines"
    scene.write_text(SCENE.replace("DURATION", "40"), encoding="utf-8")
    with kafka_broker.broker() as broker:
        topic = broker.topic()
        kafka = {"bootstrap_servers": broker.address, "topic": topic, **kafka_broker.BRISK}
        spools = [{"path": str(tmp_path / name)} for name in ("a", "b")]
        sinks = [
            {"jsonl": {"path": str(lines), "spool": spools[0]}},
            {"kafka": {**kafka, "spool": spools[1]}},
        ]
        outputs = f"outputs={json.dumps(sinks)}"
        words = ("serve", str(scene), *["--port", "0", "--speed", "20", "--set"], outputs)
        viewed = watched_lives(nurse, words, log)
        told = log.read_text(encoding="utf-8")
        assert told.count(" 0 spooled, 0 dropped") == 2, told
        carried = [message.value() for message in messages(broker.address, topic)]
    host = Host.discover()
    arrived = lines.read_bytes().splitlines(), carried
    delivered = [list(map(json.loads, lines_of_sink)) for lines_of_sink in arrived]
    for life, ids in enumerate(viewed):
        expected = batch(scene, life, host)
        assert all(arrived_in_order(events, expected) >= ids for events in delivered)
    assert all(viewed)


@pytest.mark.slow
def test_a_run_that_is_killed_and_started_again_is_whole(nurse, tmp_path):
    scene = tmp_path / "scene.yaml"
    log = tmp_path / "log"
    lines = tmp_path / "lines"
    scene.write_text(SCENE.replace("DURATION", "200"), encoding="utf-8")
    spool = tmp_path / "spool"
    sink = {"jsonl": {"path": str(lines), "spool": {"path": str(spool)}}}
    words = ("run", str(scene), "--set", f"outputs=[{json.dumps(sink)}]")
    rng = random.Random(RUNS)
    for _ in range(RUNS):
        number = nurse.born(log, *words)
        until(lambda: spool.exists() or not is_alive(number))  # noqa: B023 - read before the next is born
        time.sleep(0.1 * rng.random())
        killed(number) if is_alive(number) else None
    number = nurse.born(log, *words)
    until(lambda: not is_alive(number))
    expected = batch(scene, 5, Host.discover())
    assert len(expected) > 1000
    arrived = arrived_in_order(list(map(json.loads, lines.read_bytes().splitlines())), expected)
    assert arrived == {event["detection_id"] for event in expected}


def batch(scene, seed, host):
    """Return the events of a batch run of a scene."""
    read = load_scene(scene, overrides=[f"seed={seed}", 'outputs=["null"]'], host=host)
    plan = compile_plan(read, host)
    lines = ForgeEncoder(EncoderContext(sensors=plan.sensors, epoch_us=read.epoch_us)).encode(
        Engine(plan).advance(plan.end_ns)
    )
    return [json.loads(line) for line in lines.splitlines()]


def arrived_in_order(events, expected):
    """Return the ids of a run's events that arrived; of each sensor, they are its first, in their
    order, unchanged.
    """
    total = {event["detection_id"]: event for event in expected}
    events = [event for event in events if event["detection_id"] in total]
    assert all(total[event["detection_id"]] == event for event in events)
    arrived = dict.fromkeys(event["detection_id"] for event in events)
    for sensor in {event["sensor_id"] for event in expected}:
        result = [event["detection_id"] for event in expected if event["sensor_id"] == sensor]
        came = [name for name in arrived if total[name]["sensor_id"] == sensor]
        assert result[: len(came)] == came
    return set(arrived)
