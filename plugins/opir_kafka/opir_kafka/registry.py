"""The schema registry: registers the schema of a topic's messages, and frames these with its number.

The interface is that of Confluent's Schema Registry, which Apicurio Registry, Karapace and Redpanda
have too: POST /subjects/SUBJECT/versions returns the number of a schema, the one it has where it is
known. A message is then 0, the number in four bytes, for Protocol Buffers the place of the message
in its file, and the record
(https://docs.confluent.io/platform/current/schema-registry/fundamentals/serdes-develop/index.html).
"""

import asyncio
import base64
import json
import threading
from collections.abc import Callable
from typing import Any
from urllib.error import HTTPError
from urllib.parse import quote
from urllib.request import Request, urlopen

from opir_core.errors import SinkError, reason_of
from opir_core.plugin import EventEncoder, Host, SinkContext
from opir_kafka.connection import secret
from opir_kafka.failures import RegistryAwayError, RegistryRefusalError
from opir_kafka.lanes import Frame
from opir_kafka.settings import KafkaConfig

_MEDIA_TYPE = "application/vnd.schemaregistry.v1+json"

#: By the end of the encoder's media type.
_SCHEMA_TYPES = {"avro": "AVRO", "x-protobuf": "PROTOBUF", "json": "JSON"}

#: Bytes before a record in Avro's single-object encoding: C3 01 and the schema's fingerprint.
_SINGLE_OBJECT = 10

#: Characters of what the registry says that a message repeats.
_MOST_SAID = 200

_REMEDIES = {
    401: "see registry.username and the variable of its password",
    403: "let this login write to the subject, or give another registry.subject",
    404: "see registry.url: the address before /subjects, such as http://HOST:8081 or, of Apicurio,"
    " http://HOST:8080/apis/ccompat/v7",
    409: "the subject has a schema that this one is not compatible with: give another"
    " registry.subject, or another compatibility to this one",
    422: "this registry cannot read the schema; see which types it takes",
}


class SchemaRegistry:
    """A registry, and the schema that it is to have."""

    def __init__(self, config: KafkaConfig, schema_type: str, schema: str) -> None:
        self._settings = config.registry
        self._subject = config.registry.subject or f"{config.topic}-value"
        self._timeout_s = config.request_timeout_s
        self._schema_type = schema_type
        self._schema = schema
        self._number: int | None = None
        self._request = self._registration()

    async def frame(self) -> Frame:
        """Return the function that frames a message; registers the schema first, once.

        Raises `RegistryAwayError` where that is worth another try, else `RegistryRefusalError`.
        """
        if self._number is None:
            async with asyncio.timeout(2.0 * self._timeout_s):
                self._number = await _in_thread(self._registered)
        if self._schema_type == "AVRO":
            return self._avro_frame(b"\0" + self._number.to_bytes(4, "big"))
        place = _message_place(self._schema) if self._schema_type == "PROTOBUF" else b""
        prefix = b"\0" + self._number.to_bytes(4, "big") + place
        return lambda message: prefix + message

    def _avro_frame(self, prefix: bytes) -> Frame:
        from fastavro.schema import fingerprint, to_parsing_canonical_form

        canonical = to_parsing_canonical_form(json.loads(self._schema))
        header = b"\xc3\x01" + bytes.fromhex(fingerprint(canonical, "CRC-64-AVRO"))

        def framed(message: bytes) -> bytes:
            if not message.startswith(header):
                raise RegistryRefusalError(
                    "the spool holds messages of another schema than the registered one; run the"
                    " opir that made them until the spool is empty"
                )
            return prefix + message[_SINGLE_OBJECT:]

        return framed

    def _registration(self) -> Request:
        """Return the request; `SinkError` if its password is missing."""
        settings = self._settings
        address = (
            f"{str(settings.url).rstrip('/')}/subjects/{quote(self._subject, safe='')}/versions"
        )
        document = {"schemaType": self._schema_type, "schema": self._schema}
        request = Request(address, json.dumps(document).encode(), {"Content-Type": _MEDIA_TYPE})
        if settings.username is not None:
            password = secret(settings.password_variable, "registry.password_variable")
            login = base64.b64encode(f"{settings.username}:{password}".encode()).decode()
            request.add_unredirected_header("Authorization", f"Basic {login}")
        return request

    def _registered(self) -> int:
        """Return the number of the schema in the registry."""
        where = f"the schema registry {self._settings.url}"
        try:
            with urlopen(self._request, timeout=self._timeout_s) as answer:
                text = answer.read()
        except HTTPError as error:
            raise self._refusal(where, error) from None
        except OSError as error:
            reason = getattr(error, "reason", error)
            words = reason_of(reason) if isinstance(reason, OSError) else str(reason)
            raise RegistryAwayError(f"{where} does not answer: {words}") from None
        try:
            return int(json.loads(text)["id"])
        except (ValueError, KeyError, TypeError):
            raise RegistryRefusalError(
                f"{where} answers no number of a schema; {_REMEDIES[404]}"
            ) from None

    def _refusal(self, where: str, error: HTTPError) -> SinkError | RegistryAwayError:
        words = f"{where} answers {error.code} for the subject {self._subject}{_said(error)}"
        if error.code not in _REMEDIES and (error.code >= 500 or error.code == 429):
            return RegistryAwayError(words)
        return RegistryRefusalError(f"{words}; {_REMEDIES.get(error.code, _REMEDIES[404])}")


def registry_of(config: KafkaConfig, context: SinkContext) -> SchemaRegistry | None:
    """Return the registry of the settings, None where they name none; `SinkError` for an encoder
    without a schema.
    """
    if config.registry.url is None:
        return None
    encoder = Host.discover().component(EventEncoder, config.encoder)
    content_type = context.make_encoder().content_type
    schema_type = _SCHEMA_TYPES.get(content_type.rpartition("/")[2])
    if encoder.schema is None or schema_type is None:
        raise SinkError(f"kafka: the encoder {config.encoder} has no schema for a registry")
    return SchemaRegistry(config, schema_type, encoder.schema())


def _message_place(schema: str) -> bytes:
    """Return the place of the last message of a `.proto` file: the length of the path, and the
    index, both in zigzag; a path of 0 alone is one byte.
    """
    last_index = sum(line.startswith("message ") for line in schema.splitlines()) - 1
    return bytes((2, 2 * last_index)) if last_index else b"\0"


def _said(error: HTTPError) -> str:
    """Return what the registry says of its refusal, in a line, "" for nothing."""
    try:
        message = json.loads(error.read())["message"]
    except (OSError, ValueError, KeyError, TypeError):
        return ""
    return f": {' '.join(str(message).split())[:_MOST_SAID]}"


async def _in_thread(work: Callable[[], Any]) -> Any:
    """Return what a function returns, called in a thread that does not keep the process alive."""
    loop = asyncio.get_running_loop()
    result: asyncio.Future[Any] = loop.create_future()

    def settle(value: Any, error: BaseException | None) -> None:
        if result.done():
            return
        result.set_result(value) if error is None else result.set_exception(error)

    def call() -> None:
        value = None
        failure: BaseException | None = None
        try:
            value = work()
        except Exception as error:
            failure = error
        if not loop.is_closed():
            loop.call_soon_threadsafe(settle, value, failure)

    threading.Thread(target=call, name="opir kafka registry", daemon=True).start()
    return await result
