"""A thousand launches, as fast as the service answers: each is accepted or refused by pace, and
none makes it late.
"""

import http.client
import json
import random
import subprocess
import sys
import threading
import time
from collections import Counter
from contextlib import closing, contextmanager

import pytest
from http_service import SCENE

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

LAUNCHES = 1000
#: Time, s, for which the service is watched after the last launch.
AFTER_S = 60.0
#: `--late-after` by default: later, s, a run is not ready.
LATE_S = 5.0
#: What a launch may be answered: it is in the run, or the run has no room for it.
ACCEPTED = 202
REFUSED = 429


@contextmanager
def served(folder):
    """Yield the port of a service in a process of its own."""
    (folder / "scene.yaml").write_text(SCENE + "tracker: imm\n", encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "opir_core",
        "serve",
        str(folder / "scene.yaml"),
        "--loop",
        "--port",
        "0",
    ]
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
    try:
        assert process.stdout is not None
        yield int(process.stdout.readline().rpartition(":")[2])
    finally:
        process.terminate()
        process.communicate(timeout=60.0)


def connected(port):
    return closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60.0))


def asked(connection, method, path, body=None):
    headers = {} if body is None else {"Content-Type": "application/json", "If-Match": "*"}
    connection.request(method, path, None if body is None else json.dumps(body), headers)
    answer = connection.getresponse()
    return answer.status, json.loads(answer.read())


class Watch(threading.Thread):
    """Reads the status again and again; `late_s` are the lateness and the age of the last cycle
    while it was ready.
    """

    def __init__(self, port):
        super().__init__(daemon=True)
        self.late_s = []
        self.over = threading.Event()
        self._port = port
        self.start()

    def run(self):
        with connected(self._port) as connection:
            while not self.over.wait(0.05):
                _, status = asked(connection, "GET", "/status")
                if status["health"]["ready"]:
                    self.late_s.append(
                        max(status["clock"]["late_s"], status["clock"]["cycle_age_s"])
                    )


def launch_of(rng):
    """Return a launch from anywhere near the equator to 80 degrees further east."""
    latitude_deg = rng.uniform(-30.0, 30.0)
    longitude_deg = rng.uniform(-180.0, 100.0)
    site, aim = (
        {"lat_deg": latitude_deg, "lon_deg": longitude_deg + east_deg} for east_deg in (0.0, 80.0)
    )
    return {"type": "ICBM", "launch": site, "aim": aim}


def test_a_flood_of_launches_is_refused_before_it_makes_the_run_late(tmp_path):
    rng = random.Random(44)
    answers = Counter[int]()
    with served(tmp_path) as port, connected(port) as connection:
        _, config = asked(connection, "GET", "/config")
        config["http"] |= {"writes_per_s": 10_000.0}
        assert asked(connection, "PUT", "/config", config)[0] == 200
        watch = Watch(port)
        for _ in range(LAUNCHES):
            status, body = asked(connection, "POST", "/trigger", launch_of(rng))
            answers[status] += 1
            assert status in (ACCEPTED, REFUSED), body
            assert status == ACCEPTED or "late" in body["detail"], body
        time.sleep(AFTER_S)
        watch.over.set()
        watch.join()
    assert answers[ACCEPTED] > 0
    assert watch.late_s
    assert max(watch.late_s) <= LATE_S, answers
