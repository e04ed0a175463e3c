"""The settings of the sink `kafka`; no heavy imports."""

import re
from itertools import pairwise

from attrs import Factory, frozen

from opir_core.plugin import nested, number, text

_ADDRESS = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+):([0-9]{1,5})")
_TOPIC = re.compile(r"[A-Za-z0-9._-]{1,249}")
_URL = re.compile(r"https?://[A-Za-z0-9._:\[\]-]+(/[A-Za-z0-9._~/-]*)?")
_VARIABLE = re.compile(r"[A-Z_][A-Z0-9_]*")
_NOT_A_VARIABLE = (
    "a variable is named in capitals, digits and _; put the secret into the environment and write"
    " the name of its variable here, never the secret"
)
_HIGHEST_PORT = 65_535

PLAIN_TEXT = "PLAINTEXT"
TLS = "SSL"
SASL = "SASL_PLAINTEXT"
SASL_TLS = "SASL_SSL"


@frozen
class SecurityConfig:
    """Encryption and login. Secrets come from environment variables; a scene has only the
    variables' names.
    """

    protocol: str = text(
        default=PLAIN_TEXT,
        choices=(PLAIN_TEXT, TLS, SASL, SASL_TLS),
        source="Kafka's security.protocol",
        help="plain or encrypted (SSL: TLS), with a login (SASL) or without",
    )
    ca_file: str | None = text(
        default=None, help="file of trusted certificates (PEM); by default the system's", source=""
    )
    certificate_file: str | None = text(
        default=None, help="certificate of the client (PEM)", source=""
    )
    key_file: str | None = text(
        default=None, help="private key of the client's certificate (PEM)", source=""
    )
    key_password_variable: str | None = text(
        default=None, help="environment variable with the password of the key", source=""
    )
    mechanism: str = text(
        default="SCRAM-SHA-512",
        choices=("PLAIN", "SCRAM-SHA-256", "SCRAM-SHA-512"),
        source="Kafka's sasl.mechanism",
        help="login mechanism; PLAIN sends the password itself, so use an encrypted connection",
    )
    username: str | None = text(default=None, help="user name of the login", source="")
    password_variable: str | None = text(
        default=None, help="environment variable with the password of the login", source=""
    )

    def __attrs_post_init__(self) -> None:
        for complaint in self._complaints():
            raise ValueError(complaint)

    def _complaints(self) -> list[str]:
        variables = (self.key_password_variable, self.password_variable)
        if any(name is not None and not _VARIABLE.fullmatch(name) for name in variables):
            return [_NOT_A_VARIABLE]
        has_login = self.username is not None or self.password_variable is not None
        is_sasl = "SASL" in self.protocol
        complaints = []
        if is_sasl and (self.username is None or self.password_variable is None):
            complaints.append(f"{self.protocol} needs username and password_variable")
        if has_login and not is_sasl:
            complaints.append(f"{self.protocol} has no login; {SASL_TLS} has")
        if self.key_file is not None and self.certificate_file is None:
            complaints.append("key_file is of no use without certificate_file")
        if any((self.ca_file, self.certificate_file)) and "SSL" not in self.protocol:
            complaints.append(f"{self.protocol} uses no certificates; {TLS} and {SASL_TLS} do")
        return complaints


def _url_complaint(url: str | None) -> str | None:
    if url is None or _URL.fullmatch(url):
        return None
    return "give http://HOST:PORT or https://HOST, with a path if there is one, without a login"


@frozen
class RegistryConfig:
    """A schema registry with Confluent's interface, and the login there."""

    url: str | None = nested(
        default=None,
        check=_url_complaint,
        help="address before /subjects; without it no schema is registered",
    )
    subject: str | None = text(
        default=None, help="subject of the schema; by default the topic and -value", source=""
    )
    username: str | None = text(default=None, help="user name of the login", source="")
    password_variable: str | None = text(
        default=None, help="environment variable with the password of the login", source=""
    )

    def __attrs_post_init__(self) -> None:
        if self.password_variable is not None and not _VARIABLE.fullmatch(self.password_variable):
            raise ValueError(_NOT_A_VARIABLE)
        if (self.username is None) != (self.password_variable is None):
            raise ValueError("a login needs username and password_variable")
        if self.url is None and (self.subject, self.username) != (None, None):
            raise ValueError("subject and username are of no use without url")


def _servers_complaint(servers: str) -> str | None:
    for server in servers.split(","):
        address = _ADDRESS.fullmatch(server.strip())
        if address is None or not 0 < int(address[2]) <= _HIGHEST_PORT:
            return f"{server.strip()!r} is no host:port; give one or more, with commas between"
    return None


def _topic_complaint(topic: str) -> str | None:
    if not _TOPIC.fullmatch(topic) or topic in (".", ".."):
        return f"{topic!r} is no topic: up to 249 letters, digits, '.', '_' and '-'"
    return None


@frozen
class KafkaConfig:
    """Broker, topic, batches and timeouts. All replicas acknowledge; the producer is idempotent."""

    bootstrap_servers: str = nested(
        default="localhost:9092",
        check=_servers_complaint,
        help="initial brokers, host:port,host:port",
    )
    topic: str = nested(
        default="forge.sensors.raw",
        check=_topic_complaint,
        source="opir-simulator paper (2026)",
        help="topic; the key of a message is its sensor's id (of a track, its number), so these"
        " keep their order",
    )
    encoder: str = text(help="event encoder of the messages", default="forge")
    heartbeat_s: float | None = number(
        default=None,
        unit="s",
        minimum=0.01,
        maximum=3600.0,
        help="interval of messages that say which sensor watched, whatever it saw; without it there"
        " are none",
    )
    compression: str = text(
        default="none",
        choices=("none", "gzip", "snappy", "lz4", "zstd"),
        help="compression of batches; snappy, lz4 and zstd need opir-kafka[compression]",
    )
    batch_bytes: int = number(
        default=1 << 17,
        unit="bytes",
        minimum=1 << 10,
        maximum=1 << 20,
        help="maximum size of a batch",
    )
    client_id: str = text(default="opir", help="name of this client in the broker's logs")
    connect_timeout_s: float = number(
        default=10.0,
        unit="s",
        minimum=0.1,
        maximum=600.0,
        help="timeout of a connection attempt",
    )
    request_timeout_s: float = number(
        default=10.0,
        unit="s",
        minimum=0.1,
        maximum=600.0,
        help="timeout of a request to the broker",
    )
    acknowledgement_timeout_s: float = number(
        default=30.0,
        unit="s",
        minimum=0.1,
        maximum=3600.0,
        help="time without acknowledgement, retries included, after which a batch is sent on a new"
        " connection",
    )
    longest_pause_s: float = number(
        default=5.0,
        unit="s",
        minimum=0.05,
        maximum=600.0,
        help="longest pause between two connection attempts",
    )
    security: SecurityConfig = nested(
        default=Factory(SecurityConfig),
        help="encryption and login; secrets come from the environment",
    )

    registry: RegistryConfig = nested(
        default=Factory(RegistryConfig),
        help="schema registry: messages have the number of their schema",
    )

    def __attrs_post_init__(self) -> None:
        if self.registry.url is not None and self.heartbeat_s is not None:
            raise ValueError(
                "heartbeats are in no schema registry; leave out heartbeat_s or registry"
            )

    @property
    def servers(self) -> tuple[str, ...]:
        """Return the initial brokers."""
        return tuple(server.strip() for server in self.bootstrap_servers.split(","))

    def pauses_s(self) -> list[float]:
        """Return the pauses between connection attempts, s: each twice the one before, up to the
        longest.
        """
        pauses = [0.05]
        while pauses[-1] < self.longest_pause_s:
            pauses.append(min(2.0 * pauses[-1], self.longest_pause_s))
        assert all(pause < longer for pause, longer in pairwise(pauses))
        return pauses
