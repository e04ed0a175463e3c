"""Connections: producers that are started and closed within deadlines.

aiokafka's `start()` fails at once if no broker answers, with the reason only in its log; with
idempotence its `stop()` and every batch wait for ever for a broker that is gone. So every await
here has a deadline, and the tasks that a producer leaves in the loop, which belongs to this sink
alone, are cancelled.
"""

import asyncio
import logging
import os
import ssl
from collections.abc import Awaitable, Callable
from typing import Any

from aiokafka import AIOKafkaProducer
from aiokafka.conn import create_conn
from aiokafka.errors import KafkaConnectionError

from opir_core.errors import SinkError, install_command
from opir_kafka.failures import ClosedError, cause_of
from opir_kafka.settings import KafkaConfig, SecurityConfig

Connector = Callable[[], Awaitable[AIOKafkaProducer]]

#: Prefix of the names of this sink's own tasks; all others in its loop are its producer's.
OURS = "opir kafka"
#: Time, s, for each of the three steps of closing a producer.
_CLOSE_STEP_S = 0.4
_RETRY_PAUSE_MS = 100

_log = logging.getLogger(__name__)
# aiokafka logs every failed attempt; without a handler Python would print them into the user's
# terminal.
logging.getLogger("aiokafka").addHandler(logging.NullHandler())
# At level DEBUG it logs every request, also the login with its password.
logging.getLogger("aiokafka.conn").addFilter(
    lambda record: "SaslAuthenticate" not in record.getMessage()
)


def connector(config: KafkaConfig) -> Connector:
    """Return a function that connects a producer; `SinkError` if certificates, secrets or codecs
    are missing.
    """
    _require_codec(config.compression)
    security = _security_arguments(config.security)

    async def connect() -> AIOKafkaProducer:
        producer = AIOKafkaProducer(
            bootstrap_servers=list(config.servers),
            client_id=config.client_id,
            acks="all",
            enable_idempotence=True,
            compression_type=None if config.compression == "none" else config.compression,
            max_batch_size=config.batch_bytes,
            request_timeout_ms=round(config.request_timeout_s * 1000),
            retry_backoff_ms=_RETRY_PAUSE_MS,
            **security,
        )
        try:
            async with asyncio.timeout(config.connect_timeout_s):
                await producer.start()
        except BaseException as error:
            await close_producer(producer)
            if isinstance(error, KafkaConnectionError):
                await probe(config)
                raise ClosedError from error
            raise
        return producer

    return connect


async def close_producer(producer: AIOKafkaProducer) -> None:
    """Close a producer within a deadline, even if the caller is cancelled."""
    await asyncio.shield(asyncio.create_task(_close(producer), name=f"{OURS} closing"))


async def _close(producer: AIOKafkaProducer) -> None:
    await _ended(producer.stop())
    tasks = {task for task in asyncio.all_tasks() if not task.get_name().startswith(OURS)}
    for task in tasks:
        task.cancel()
    if tasks:
        await asyncio.wait(tasks, timeout=_CLOSE_STEP_S)
    await _ended(producer.client.close())


async def _ended(step: Awaitable[Any]) -> None:
    try:
        async with asyncio.timeout(_CLOSE_STEP_S):
            await step
    except Exception as error:  # an error in closing changes nothing
        _log.debug("closing: %r", error)


async def probe(config: KafkaConfig, *servers: str) -> None:
    """Connect to one broker after the other, by default to those of the settings; raise why none
    takes the connection, which aiokafka only logs.
    """
    reason: Exception | None = None
    security = _security_arguments(config.security)
    timeout_ms = round(config.request_timeout_s * 1000)
    for server in servers or config.servers:
        host, _, port = server.rpartition(":")
        try:
            async with asyncio.timeout(config.connect_timeout_s):
                connection = await create_conn(
                    host.strip("[]"), int(port), request_timeout_ms=timeout_ms, **security
                )
        except Exception as error:
            reason = reason or cause_of(error, is_encrypted="SSL" in config.security.protocol)
        else:
            connection.close()
            return
    if reason is not None:
        raise reason


def _security_arguments(security: SecurityConfig) -> dict[str, Any]:
    arguments: dict[str, Any] = {"security_protocol": security.protocol}
    if "SSL" in security.protocol:
        arguments["ssl_context"] = _tls(security)
    if "SASL" in security.protocol:
        arguments["sasl_mechanism"] = security.mechanism
        arguments["sasl_plain_username"] = security.username
        arguments["sasl_plain_password"] = secret(
            security.password_variable, "security.password_variable"
        )
    return arguments


def _tls(security: SecurityConfig) -> ssl.SSLContext:
    password = security.key_password_variable and secret(
        security.key_password_variable, "security.key_password_variable"
    )
    try:
        context = ssl.create_default_context(cafile=security.ca_file)
        if security.certificate_file is not None:
            # Without a password OpenSSL would ask for one on the terminal.
            context.load_cert_chain(security.certificate_file, security.key_file, password or "")
    except (OSError, ValueError) as error:
        reasons = (getattr(error, "strerror", None), getattr(error, "reason", None))
        reason = next(filter(None, reasons), "they cannot be read")
        raise SinkError(
            f"kafka: the certificates of security cannot be used: {str(reason).lower()}"
        ) from None
    return context


def secret(variable: str | None, key: str) -> str:
    """Return the value of an environment variable that a setting names; `SinkError` if it is not
    set.
    """
    value = os.environ.get(variable or "")
    if not value:
        raise SinkError(
            f"kafka: the environment variable that {key} names is not set; set it to the secret"
        )
    return value


def _require_codec(compression: str) -> None:
    from aiokafka import codec

    if compression != "none" and not getattr(codec, f"has_{compression}")():
        remedy = install_command("opir-kafka", "compression")
        raise SinkError(f"kafka: {compression} is not installed; {remedy}")
