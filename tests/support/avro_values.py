"""Values of Avro as JSON has them."""

from datetime import datetime
from typing import Any
from uuid import UUID


def json_value(value: Any) -> Any:
    """Return a value that fastavro decoded as JSON has it."""
    match value:
        case bytes():
            return str(UUID(bytes=value))
        case datetime():
            return value.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        case list():
            return [json_value(each) for each in value]
        case dict():
            return {name: json_value(each) for name, each in value.items()}
        case None | str() | int() | float():
            return value
    return float(value)
