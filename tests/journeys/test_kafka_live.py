"""The live engine with the Kafka sink: stopping is quick whatever the broker does, and nothing is
lost.
"""

import json
import time

import kafka_broker
import pytest
from kafka_broker import dead_address, messages
from repository import EXAMPLES
from waiting import until

from opir_core.host.host import Host
from opir_core.live.running import LiveRun, LiveSettings
from opir_core.reading import load_scene

SCENE = str(EXAMPLES / "first_light.yaml")
#: Time limit, s, for a run to end after SIGTERM while it waits for a broker that never comes.
STOP_S = 60.0


def run_of(address, topic, spool, host):
    kafka = {
        "bootstrap_servers": address,
        "topic": topic,
        **kafka_broker.BRISK,
        "spool": {"path": str(spool)},
    }
    scene = load_scene(SCENE, overrides=[f"outputs=[{{kafka: {json.dumps(kafka)}}}]"], host=host)
    return LiveRun(scene, host, LiveSettings(speed=None))


def stopped(run):
    began = time.monotonic()
    status = run.stop(within_s=4.0)
    assert time.monotonic() - began < STOP_S
    return status.sinks[0]


@pytest.mark.slow
def test_a_live_run_is_stopped_in_time_without_a_broker_and_the_next_one_delivers_all(
    tmp_path,
):
    host = Host.discover()
    with kafka_broker.broker() as broker:
        topic = broker.topic()
        first = run_of(dead_address(), topic, tmp_path / "spool", host)
        first.start()
        until(lambda: first.status().sinks[0].given == 750)
        reported = stopped(first)
        assert (reported.delivered, reported.spooled, reported.dropped) == (0, 750, 0)
        second = run_of(broker.address, topic, tmp_path / "spool", host)
        second.start()
        until(lambda: second.status().sinks[0].delivered == 1500)
        reported = stopped(second)
        assert (reported.delivered, reported.spooled, reported.dropped, reported.error) == (
            1500,
            0,
            0,
            None,
        )
        ids = [
            json.loads(message.value())["detection_id"]
            for message in messages(broker.address, topic)
        ]
    assert len(ids) == 1500
    assert ids[:750] == ids[750:]
