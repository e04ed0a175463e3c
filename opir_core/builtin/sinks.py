"""Core's own sinks: JSON lines in a file or on standard output, memory, and nowhere; imported when they are built."""

from typing import TYPE_CHECKING, Any

from attrs import frozen

from opir_core.plugin.components import SinkModel
from opir_core.scene.fields import text

if TYPE_CHECKING:
    from opir_core.interfaces.contexts import SinkContext
    from opir_core.interfaces.protocols import Sink


@frozen
class JsonlConfig:
    """Where lines of events go."""

    path: str = text(
        help="the file, in a folder that exists, overwritten (or added to, with a spool); - is standard output",
        default="events.jsonl",
    )
    encoder: str = text(help="the event encoder that makes the lines", default="forge")


@frozen
class MemoryConfig:
    """How events kept in memory are shown."""

    encoder: str = text(help="the event encoder that makes events of what is kept, when asked", default="forge")


def _jsonl(config: JsonlConfig, context: "SinkContext") -> "Sink":
    from opir_core.builtin.line_file import LineFile

    return LineFile(config.path, context.make_encoder(), appends=context.resumes)


def _memory(_config: MemoryConfig, context: "SinkContext") -> "Sink":
    from opir_core.builtin.memory_sinks import MemorySink

    return MemorySink(context.make_encoder)


def _null(_config: Any, _context: "SinkContext") -> "Sink":
    from opir_core.builtin.memory_sinks import Nowhere

    return Nowhere()


SINKS = (
    SinkModel(
        name="jsonl", summary="one event a line, to a file or to standard output", config=JsonlConfig, build=_jsonl
    ),
    SinkModel(
        name="memory", summary="windows kept in memory, as columns and as events", config=MemoryConfig, build=_memory
    ),
    SinkModel(name="null", summary="nothing is kept and nothing encoded", build=_null),
)
