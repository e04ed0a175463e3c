"""A disk that is really full under a spool: the run says so, keeps what it has written, and nothing
of that is lost.
"""

import json
import re
import shutil
import subprocess
import sys

import kafka_broker
import pytest
from kafka_broker import dead_address, messages
from repository import TEST_SCENES

SCENE = str(TEST_SCENES / "pacific_test_range.yaml")
SIZE = "4000k"

#: In a name space of its own: a disk of that size, the command, and what is left on the disk copied
#: out.
ON_A_SMALL_DISK = (
    'mount -t tmpfs -o size=$1 none "$2" && disk=$2 && kept=$3 && shift 3 && "$@";'
    ' code=$?; cp -a "$disk/." "$kept"; exit $code'
)
PROBE = ["unshare", "-rm", "sh", "-c", "mount -t tmpfs -o size=100k none /mnt"]


def can_mount():
    return (
        shutil.which("unshare") is not None
        and subprocess.run(PROBE, capture_output=True, check=False).returncode == 0
    )


@pytest.mark.slow
@pytest.mark.skipif(not can_mount(), reason="this system lets nobody mount a small disk")
def test_what_a_full_disk_kept_arrives_from_it(tmp_path):
    disk = tmp_path / "disk"
    stored = tmp_path / "kept"
    disk.mkdir()
    stored.mkdir()
    with kafka_broker.broker() as broker:
        topic = broker.topic()
        process = opir(dead_address(), topic, disk / "spool", tmp_path, small=(disk, stored))
        assert process.returncode == 5, process.stderr
        result = re.search(
            r"its spool \S+ is full, with (\d+) events that wait: no broker answers", process.stderr
        )
        assert result, process.stderr
        assert "Traceback" not in process.stderr
        assert int(result[1]) > 1000
        remainder = opir(broker.address, topic, stored / "spool", tmp_path, "--set", "targets=[]")
        assert remainder.returncode == 0, remainder.stderr
        assert "of them from the spool of an earlier run" in remainder.stdout + remainder.stderr
        ids = [
            json.loads(message.value())["detection_id"]
            for message in messages(broker.address, topic)
        ]
    assert len(set(ids)) == len(ids) == int(result[1])


def opir(
    server,
    topic,
    spool,
    folder,
    *words,
    small=None,
):
    """Run the scene into Kafka through a spool, which may be on a small disk of its own."""
    kafka = {
        "bootstrap_servers": server,
        "topic": topic,
        **kafka_broker.BRISK,
        "spool": {"path": str(spool)},
    }
    outputs = f"outputs=[{{kafka: {json.dumps(kafka)}}}]"
    command = [sys.executable, "-m", "opir_core", "run", SCENE, "--set", outputs, *words]
    if small is not None:
        command = [
            "unshare",
            "-rm",
            "sh",
            "-c",
            ON_A_SMALL_DISK,
            "sh",
            SIZE,
            *map(str, small),
            *command,
        ]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )
