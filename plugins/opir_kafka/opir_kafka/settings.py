"""What a scene may set of the sink `kafka`. Nothing heavy is imported here."""

import re
from itertools import pairwise

from attrs import Factory, frozen

from opir_core.scene.fields import nested, number, text

_ADDRESS = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+):([0-9]{1,5})")
_TOPIC = re.compile(r"[A-Za-z0-9._-]{1,249}")
_VARIABLE = re.compile(r"[A-Z_][A-Z0-9_]*")
_NEVER_THE_SECRET = (
    "a variable is named in capitals, digits and _; put the secret into the environment and write the name of its"
    " variable here, never the secret"
)
_HIGHEST_PORT = 65_535

PLAIN_TEXT, TLS, SASL, SASL_TLS = "PLAINTEXT", "SSL", "SASL_PLAINTEXT", "SASL_SSL"


@frozen(kw_only=True)
class SecurityConfig:
    """How the broker is spoken to. Secrets are in the environment; what stands here is the variable's name."""

    protocol: str = text(
        default=PLAIN_TEXT,
        choices=(PLAIN_TEXT, TLS, SASL, SASL_TLS),
        source="Kafka's security.protocol",
        help="plain or encrypted (SSL: TLS), with a login (SASL) or without",
    )
    ca_file: str | None = text(
        default=None, help="the file of certificates (PEM) to trust; by default the system's", source=""
    )
    certificate_file: str | None = text(default=None, help="the client's own certificate (PEM)", source="")
    key_file: str | None = text(default=None, help="the key of the client's certificate (PEM)", source="")
    key_password_variable: str | None = text(
        default=None, help="the environment variable that holds the password of the key", source=""
    )
    mechanism: str = text(
        default="SCRAM-SHA-512",
        choices=("PLAIN", "SCRAM-SHA-256", "SCRAM-SHA-512"),
        source="Kafka's sasl.mechanism",
        help="how the login is proven; PLAIN sends the password itself, so give it an encrypted connection",
    )
    username: str | None = text(default=None, help="the name of the login", source="")
    password_variable: str | None = text(
        default=None, help="the environment variable that holds the password of the login", source=""
    )

    def __attrs_post_init__(self) -> None:
        for complaint in self._complaints():
            raise ValueError(complaint)

    def _complaints(self) -> list[str]:
        variables = (self.key_password_variable, self.password_variable)
        if any(name is not None and not _VARIABLE.fullmatch(name) for name in variables):
            return [_NEVER_THE_SECRET]
        has_login, is_sasl = self.username is not None or self.password_variable is not None, "SASL" in self.protocol
        found = []
        if is_sasl and (self.username is None or self.password_variable is None):
            found.append(f"{self.protocol} needs username and password_variable")
        if has_login and not is_sasl:
            found.append(f"{self.protocol} has no login; {SASL_TLS} has")
        if self.key_file is not None and self.certificate_file is None:
            found.append("key_file is of no use without certificate_file")
        if any((self.ca_file, self.certificate_file)) and "SSL" not in self.protocol:
            found.append(f"{self.protocol} uses no certificates; {TLS} and {SASL_TLS} do")
        return found


def _servers_complaint(servers: str) -> str | None:
    for server in servers.split(","):
        found = _ADDRESS.fullmatch(server.strip())
        if found is None or not 0 < int(found[2]) <= _HIGHEST_PORT:
            return f"{server.strip()!r} is no host:port; give one or more, with commas between"
    return None


def _topic_complaint(topic: str) -> str | None:
    if not _TOPIC.fullmatch(topic) or topic in (".", ".."):
        return f"{topic!r} is no topic: up to 249 letters, digits, '.', '_' and '-'"
    return None


@frozen(kw_only=True)
class KafkaConfig:
    """Which broker and topic, and how long is waited. All replicas acknowledge, and the producer is idempotent."""

    bootstrap_servers: str = nested(
        default="localhost:9092", check=_servers_complaint, help="brokers to begin with, host:port,host:port"
    )
    topic: str = nested(
        default="forge.sensors.raw",
        check=_topic_complaint,
        source="opir-simulator paper (2026)",
        help="the topic; the key of a message is its sensor's id, so each sensor's events keep their order",
    )
    encoder: str = text(help="the event encoder that makes the messages", default="forge")
    compression: str = text(
        default="none",
        choices=("none", "gzip", "snappy", "lz4", "zstd"),
        help="how batches are compressed; snappy, lz4 and zstd need opir-kafka[compression]",
    )
    batch_bytes: int = number(
        default=1 << 17, unit="bytes", minimum=1 << 10, maximum=1 << 20, help="the most that a batch may hold"
    )
    client_id: str = text(default="opir", help="what the broker's logs call this program")
    connect_timeout_s: float = number(
        default=10.0,
        unit="s",
        minimum=0.1,
        maximum=600.0,
        help="how long a connection may take before it is tried anew",
    )
    request_timeout_s: float = number(
        default=10.0, unit="s", minimum=0.1, maximum=600.0, help="how long the broker may take to answer a request"
    )
    acknowledgement_timeout_s: float = number(
        default=30.0,
        unit="s",
        minimum=0.1,
        maximum=3600.0,
        help="how long a batch may go without acknowledgement, retries included, before it is sent on a new connection",
    )
    longest_pause_s: float = number(
        default=5.0, unit="s", minimum=0.05, maximum=600.0, help="the longest pause between two tries to connect"
    )
    security: SecurityConfig = nested(
        default=Factory(SecurityConfig), help="encryption and login; secrets come from the environment"
    )

    @property
    def servers(self) -> tuple[str, ...]:
        """Return the brokers one by one."""
        return tuple(server.strip() for server in self.bootstrap_servers.split(","))

    def pauses_s(self) -> list[float]:
        """Return the pauses between tries, each twice the one before, up to the longest."""
        pauses = [0.05]
        while pauses[-1] < self.longest_pause_s:
            pauses.append(min(2.0 * pauses[-1], self.longest_pause_s))
        assert all(one < other for one, other in pairwise(pauses))
        return pauses
