"""Kafka brokers in a process of their own: librdkafka's mock cluster, from the wheel of
confluent-kafka.

    python mock_broker.py BROKERS

prints host:port of each and obeys commands, a line each, until its input ends:

    down [NODE] | up            close every connection and refuse new ones | take them again
    slow MS                     answer each request that much later
    error API CODE ...          answer the next requests of that API with these codes, one each
    clear API                   forget such codes
    topic NAME PARTITIONS       make a topic
    topic-error NAME CODE       what metadata says of a topic
    leader NAME PARTITION NODE  the leader of a partition; -1 for none
"""

import ctypes as c
import glob
import sys
from pathlib import Path

_FUNCTIONS = {
    "conf_new": (c.c_void_p, []),
    "conf_set": (c.c_int, [c.c_void_p, c.c_char_p, c.c_char_p, c.c_char_p, c.c_size_t]),
    "new": (c.c_void_p, [c.c_int, c.c_void_p, c.c_char_p, c.c_size_t]),
    "mock_cluster_new": (c.c_void_p, [c.c_void_p, c.c_int]),
    "mock_cluster_bootstraps": (c.c_char_p, [c.c_void_p]),
    "mock_topic_create": (c.c_int, [c.c_void_p, c.c_char_p, c.c_int, c.c_int]),
    "mock_topic_set_error": (None, [c.c_void_p, c.c_char_p, c.c_int]),
    "mock_partition_set_leader": (c.c_int, [c.c_void_p, c.c_char_p, c.c_int32, c.c_int32]),
    "mock_broker_set_down": (c.c_int, [c.c_void_p, c.c_int32]),
    "mock_broker_set_up": (c.c_int, [c.c_void_p, c.c_int32]),
    "mock_broker_set_rtt": (c.c_int, [c.c_void_p, c.c_int32, c.c_int]),
    "mock_push_request_errors_array": (
        None,
        [c.c_void_p, c.c_int16, c.c_size_t, c.POINTER(c.c_int)],
    ),
    "mock_clear_request_errors": (None, [c.c_void_p, c.c_int16]),
}
_PRODUCER = 0
_EVERY_BROKER = -1
_ONE = 1


class MockCluster:
    """Brokers with the numbers from 1 on."""

    def __init__(self, brokers):
        import confluent_kafka

        wheel = Path(confluent_kafka.__file__).parents[1] / "confluent_kafka.libs"
        libraries = glob.glob(f"{wheel}/librdkafka-*.so*") or ["librdkafka.so.1"]  # noqa: PTH207 - a name to load, not a path
        self._library = c.CDLL(libraries[0])
        for name, (result, arguments) in _FUNCTIONS.items():
            function = getattr(self._library, f"rd_kafka_{name}")
            function.restype = result
            function.argtypes = arguments
        complaint = c.create_string_buffer(512)
        settings = self._library.rd_kafka_conf_new()
        self._library.rd_kafka_conf_set(settings, b"log_level", b"0", complaint, 512)
        client = self._library.rd_kafka_new(_PRODUCER, settings, complaint, 512)
        self._cluster = self._library.rd_kafka_mock_cluster_new(client, brokers)

    @property
    def address(self):
        reported = self._library.rd_kafka_mock_cluster_bootstraps(self._cluster)
        return reported.decode()

    def topic(self, name, partitions):
        self._library.rd_kafka_mock_topic_create(
            self._cluster, name.encode(), int(partitions), _ONE
        )

    def topic_error(self, name, code):
        self._library.rd_kafka_mock_topic_set_error(self._cluster, name.encode(), int(code))

    def leader(self, name, partition, node):
        self._library.rd_kafka_mock_partition_set_leader(
            self._cluster, name.encode(), int(partition), int(node)
        )

    def down(self, node=_EVERY_BROKER):
        self._library.rd_kafka_mock_broker_set_down(self._cluster, int(node))

    def up(self):
        self._library.rd_kafka_mock_broker_set_up(self._cluster, _EVERY_BROKER)

    def slow(self, milliseconds):
        self._library.rd_kafka_mock_broker_set_rtt(self._cluster, _EVERY_BROKER, int(milliseconds))

    def error(self, api, *codes):
        array = (c.c_int * len(codes))(*map(int, codes))
        self._library.rd_kafka_mock_push_request_errors_array(
            self._cluster, int(api), len(codes), array
        )

    def clear(self, api):
        self._library.rd_kafka_mock_clear_request_errors(self._cluster, int(api))


def main():
    cluster = MockCluster(int(sys.argv[1]))
    sys.stdout.write(f"{cluster.address}\n")
    sys.stdout.flush()
    for line in sys.stdin:
        command, *arguments = line.split()
        getattr(cluster, command.replace("-", "_"))(*arguments)
        sys.stdout.write("done\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
