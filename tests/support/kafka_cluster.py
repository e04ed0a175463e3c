"""Apache Kafka itself, one node or several on loopback (KRaft), from its artefacts in a Maven
repository.

Java 17 or later and Maven are needed; `why_absent` says what is missing. Nodes log to files in the
folder of a cluster.
"""

import base64
import fcntl
import hashlib
import os
import shutil
import signal
import socket
import subprocess
import time
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import confluent_kafka
from confluent_kafka.admin import AdminClient, NewTopic
from waiting import until

POM = Path(__file__).parent / "kafka" / "pom.xml"

#: Memory of a node: a cluster of three fits into a small machine.
_HEAP = ("-Xms96m", "-Xmx320m", "-XX:+UseSerialGC", "-XX:TieredStopAtLevel=1")
_START_S = 120.0

_COMMON = {
    "process.roles": "broker,controller",
    "controller.listener.names": "CONTROLLER",
    "inter.broker.listener.name": "PLAINTEXT",
    "auto.create.topics.enable": "false",
    "controlled.shutdown.retry.backoff.ms": "200",
    "group.initial.rebalance.delay.ms": "0",
    "offsets.topic.num.partitions": "3",
    "transaction.state.log.num.partitions": "3",
    "replica.lag.time.max.ms": "3000",
    "broker.session.timeout.ms": "4000",
    "broker.heartbeat.interval.ms": "500",
    "unclean.leader.election.enable": "false",
}


@cache
def why_absent():
    """Return why there is no Kafka on this machine, or ""."""
    missing = [name for name in ("java", "mvn") if shutil.which(name) is None]
    if missing:
        return f"Apache Kafka is left out: there is no {' and no '.join(missing)}"
    try:
        classpath()
    except (OSError, subprocess.SubprocessError) as error:
        output = getattr(error, "stdout", b"") or b""
        return (
            f"Apache Kafka is left out: Maven does not get it ({error})"
            f" {output.decode(errors='replace')[-300:]}"
        )
    return ""


@cache
def classpath():
    """Return the class path of Kafka; Maven fetches what is not in its repository yet.

    One process at a time asks Maven: two that fill its repository spoil each other's files.
    """
    mark = hashlib.sha256(POM.read_bytes()).hexdigest()[:16]
    cache_folder = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "opir-tests"
    cache_folder.mkdir(parents=True, exist_ok=True)
    stored = cache_folder / f"kafka-{mark}.txt"
    with (cache_folder / "kafka.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (stored.is_file() and _all_there(stored)):
            _ask_maven(stored)
    return stored.read_text().strip()


def _all_there(stored):
    """Return whether the files of a stored class path exist."""
    return all(Path(path).is_file() for path in stored.read_text().strip().split(os.pathsep))


def _ask_maven(stored):
    """Write the class path into a file."""
    temporary = stored.with_suffix(f".{os.getpid()}")
    words = [
        "mvn",
        "-B",
        "-q",
        "-f",
        str(POM),
        "dependency:build-classpath",
        f"-Dmdep.outputFile={temporary}",
    ]
    subprocess.run(words, check=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=300)
    temporary.replace(stored)


def java(main, *words, timeout_s=_START_S):
    """Run a Java main class of Kafka and return what it prints; `AssertionError` with it if it
    fails.
    """
    command = ["java", *_HEAP, "-cp", classpath(), main, *words]
    done = subprocess.run(
        command,
        check=False,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=timeout_s,
    )
    assert done.returncode == 0, f"{main} ends with {done.returncode}: {done.stdout}"
    return done.stdout


class Node:
    """A broker that is a controller too."""

    def __init__(self, folder, settings):
        self._log = folder / "log.txt"
        self._settings = folder / "server.properties"
        folder.mkdir(parents=True)
        lines = {**settings, "log.dirs": str(folder / "data")}
        self._settings.write_text("".join(f"{key}={value}\n" for key, value in lines.items()))
        self._process = None

    def format(self, cluster_id):
        """Make the folder of the log."""
        java("kafka.tools.StorageTool", "format", "-t", cluster_id, "-c", str(self._settings))

    def start(self):
        """Start the process; it answers later."""
        with self._log.open("ab") as log:
            command = ["java", *_HEAP, "-cp", classpath(), "kafka.Kafka", str(self._settings)]
            self._process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)

    def send(self, number):
        """Send a signal to the process."""
        assert self._process is not None
        self._process.send_signal(number)

    def stop(self, number=signal.SIGTERM):
        """End the process, in order or (SIGKILL) not, and wait for its end."""
        if self._process is None:
            return
        self.send(number)
        try:
            self._process.wait(60.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(30.0)
        self._process = None


class Cluster:
    """Nodes that form a cluster; clients without a login use the listener PLAINTEXT."""

    can_be_spoilt = False

    def __init__(
        self,
        folder,
        nodes=1,
        listeners=(),
        settings=None,
    ):
        self._admin = None
        names = ["PLAINTEXT", *listeners]
        ports = [_free_ports(len(names) + 1) for _ in range(nodes)]
        voters = ",".join(
            f"{number + 1}@127.0.0.1:{node_ports[-1]}" for number, node_ports in enumerate(ports)
        )
        self._ports = {
            name: [node_ports[place] for node_ports in ports] for place, name in enumerate(names)
        }
        self.nodes = [
            Node(
                folder / f"node{number + 1}",
                {
                    **_COMMON,
                    "node.id": str(number + 1),
                    "controller.quorum.voters": voters,
                    "listeners": _listeners([*names, "CONTROLLER"], node_ports),
                    "advertised.listeners": _listeners(names, node_ports),
                    "listener.security.protocol.map": "PLAINTEXT:PLAINTEXT,CONTROLLER:PLAINTEXT,"
                    "SASL_PLAINTEXT:SASL_PLAINTEXT,SSL:SSL",
                    "offsets.topic.replication.factor": str(nodes),
                    "transaction.state.log.replication.factor": str(nodes),
                    "transaction.state.log.min.isr": "1",
                    **(settings or {}),
                },
            )
            for number, node_ports in enumerate(ports)
        ]
        cluster_id = base64.urlsafe_b64encode(os.urandom(16)).decode().rstrip("=")
        for node in self.nodes:
            node.format(cluster_id)
            node.start()
        self.wait_for_brokers(nodes)

    def addresses(self, listener="PLAINTEXT"):
        """Return the bootstrap servers of a listener."""
        return ",".join(f"127.0.0.1:{port}" for port in self._ports[listener])

    @property
    def address(self):
        """Return the bootstrap servers of the listener without a login."""
        return self.addresses()

    def admin(self):
        """Return a client that may do all; it lives as long as the cluster, for its answers come
        later.
        """
        if self._admin is None:
            self._admin = AdminClient({"bootstrap.servers": self.address, "log_level": 0})
        return self._admin

    def brokers(self):
        """Return the number of brokers in the cluster; 0 if none answers."""
        try:
            return len(self.admin().list_topics(timeout=2.0).brokers)
        except confluent_kafka.KafkaException:
            return 0

    def wait_for_brokers(self, count):
        """Wait until a number of brokers are in the cluster."""
        until(lambda: self.brokers() == count, within_s=_START_S)

    def topic(self, partitions=3, replicas=1, name="", **settings):
        """Make a topic and return its name."""
        name = name or f"opir-{os.getpid()}-{time.time_ns()}"
        config = {key.replace("_", "."): value for key, value in settings.items()}
        self.admin().create_topics([NewTopic(name, partitions, replicas, config=config)])[
            name
        ].result(60.0)
        until(lambda: len(self.partitions(name)) == partitions, within_s=60.0)
        return name

    def partitions(self, topic):
        """Return the partitions of a topic by number, each with its leader and its replicas in
        sync.
        """
        result = self.admin().list_topics(topic, timeout=30.0).topics[topic].partitions
        return {
            number: metadata
            for number, metadata in result.items()
            if metadata.error is None and metadata.leader >= 0
        }

    def heal(self):
        """Do nothing: who stops a node starts it again."""

    def close(self):
        """End all nodes at once."""
        for node in self.nodes:
            node.stop(signal.SIGKILL)


@contextmanager
def cluster(folder, nodes=1, **settings):
    """Run a cluster; a machine without Java or Maven raises `AssertionError`, see `why_absent`."""
    assert not why_absent()
    started = Cluster(folder, nodes, **settings)
    try:
        yield started
    finally:
        started.close()


def _listeners(names, ports):
    return ",".join(f"{name}://127.0.0.1:{port}" for name, port in zip(names, ports, strict=False))


def _free_ports(count):
    """Return ports that nobody listens on."""
    bound = [socket.socket() for _ in range(count)]
    try:
        for listening in bound:
            listening.bind(("127.0.0.1", 0))
        return [listening.getsockname()[1] for listening in bound]
    finally:
        for listening in bound:
            listening.close()
