"""The AsyncAPI document of the topic, generated from settings and schemas."""

import json
import re
from collections.abc import Mapping
from typing import Any

from opir_core import __version__
from opir_core.output import heartbeat_schema
from opir_core.plugin import EncoderContext, EventEncoder, Host
from opir_core.reading import HEARTBEAT_FORMAT
from opir_kafka.settings import KafkaConfig

#: The media type of a JSON Schema of that draft, as AsyncAPI's multi-format schemas name it.
_SCHEMA_FORMAT = "application/schema+json;version=draft-2020-12"
_SENSOR = "The sensor's id"


def asyncapi_document(config: KafkaConfig | None = None) -> dict[str, Any]:
    """Return the document (AsyncAPI 3.0,
    https://www.asyncapi.com/docs/reference/specification/v3.0.0) of an output, by default of one
    with the default settings.
    """
    output = config or KafkaConfig()
    messages = _messages()
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "opir detection events and tracks",
            "version": __version__,
            "description": "Simulated detections of overhead infrared sensors, and tracks. Each"
            " sensor's events are in"
            " order, and each track's; a message may arrive twice, with the same bytes.",
            "license": {"name": "Apache-2.0"},
        },
        "defaultContentType": "application/json",
        "servers": {"kafka": {"host": output.bootstrap_servers, "protocol": "kafka"}},
        "channels": {
            "detections": {
                "address": output.topic,
                "servers": [{"$ref": "#/servers/kafka"}],
                "description": f"One of these, by the output's encoder; here {output.encoder}. The"
                " encoders forge-bands and forge-tracks add band irradiances or track states to"
                " forge's messages. With heartbeat_s the messages heartbeat say which sensors watched.",
                "messages": {name: {"$ref": f"#/components/messages/{name}"} for name in messages},
                "bindings": {"kafka": {"bindingVersion": "0.5.0"}},
            }
        },
        "operations": {
            "sendDetection": {
                "action": "send",
                "summary": "opir sends; a fusion pipeline receives.",
                "channel": {"$ref": "#/channels/detections"},
                "messages": [
                    {"$ref": f"#/channels/detections/messages/{name}"} for name in messages
                ],
            }
        },
        "components": {"messages": messages},
    }


def asyncapi_text(config: KafkaConfig | None = None) -> str:
    """Return the document of an output as YAML."""
    import yaml

    return yaml.safe_dump(asyncapi_document(config), sort_keys=False, allow_unicode=True, width=120)


def _messages() -> dict[str, Any]:
    """Return the messages of the installed encoders with a JSON Schema by name, those with the same
    schema once.
    """
    host = Host.discover()
    texts: dict[str, EventEncoder] = {}
    for name in host.names(EventEncoder):
        encoder = host.component(EventEncoder, name)
        if encoder.schema is not None and '"$schema"' in (text := encoder.schema()):
            texts.setdefault(text, encoder)
    messages = {
        encoder.name: _of_encoder(encoder, _payload(encoder.name, text))
        for text, encoder in texts.items()
    }
    version = f"{HEARTBEAT_FORMAT.name}-{HEARTBEAT_FORMAT.version}"
    return {**messages, "heartbeat": _message("heartbeat", version, _SENSOR, heartbeat_schema())}


def _payload(name: str, text: str) -> dict[str, Any]:
    """Return a schema whose references begin at the root of the document, as AsyncAPI reads them;
    an identifier of its own would be another root.
    """
    place = f'"#/components/messages/{name}/payload/schema/$defs/'
    schema: dict[str, Any] = json.loads(text.replace('"#/$defs/', place))
    schema.pop("$id", None)
    return schema


def _same_major(version: str) -> str:
    """Return the pattern of a version and of all minor versions of its major."""
    major, dot, _minor = version.rpartition(".")
    return f"^{re.escape(major + dot)}[0-9]+$"


def _of_encoder(encoder: EventEncoder, payload: Mapping[str, Any]) -> dict[str, Any]:
    version = encoder.build(encoder.config(), EncoderContext(sensors=(), epoch_us=0)).schema_version
    source = "The track's number" if encoder.encodes_tracks else _SENSOR
    return _message(encoder.name, version, source, payload)


def _message(name: str, version: str, source: str, payload: Mapping[str, Any]) -> dict[str, Any]:
    """Return a message of a schema version; its key is `source`."""
    headers = {
        "type": "object",
        "properties": {
            "content-type": {"const": "application/json"},
            "schema-version": {"type": "string", "pattern": _same_major(version)},
        },
        "required": ["content-type", "schema-version"],
    }
    key = {"type": "string", "description": f"{source}, UTF-8; it determines the partition."}
    return {
        "name": name,
        "title": payload["title"],
        "contentType": "application/json",
        "headers": headers,
        "payload": {"schemaFormat": _SCHEMA_FORMAT, "schema": payload},
        "bindings": {"kafka": {"key": key, "bindingVersion": "0.5.0"}},
    }
