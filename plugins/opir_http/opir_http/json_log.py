"""The log of the service as JSON lines: one object a line, with `time`, `level`, `logger`,
`message` and more keys.
"""

import io
import json
import logging
import sys
import traceback
from collections.abc import Mapping
from datetime import UTC, datetime
from threading import local
from typing import Any, TextIO

_PREFIX = "opir: "


def json_line(level: str, logger: str, message: str, more: Mapping[str, Any] = {}) -> str:
    """Return a line of the log, in ASCII: no character of a message can begin another line."""
    time = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return (
        json.dumps(
            {"time": time, "level": level, "logger": logger, "message": message, **more},
            default=str,
        )
        + "\n"
    )


def log_as_json() -> None:
    """Write all that this process prints and logs as JSON lines on standard error, from now on.

    Standard output carries nothing but the events of a sink that writes there.
    """
    stream = sys.stderr
    handler = logging.StreamHandler(stream)
    handler.setFormatter(_JsonFormatter())
    logging.getLogger().addHandler(handler)
    sys.stdout = _JsonText(stream, "info", sys.stdout)
    sys.stderr = _JsonText(stream, "error", stream)


class _JsonFormatter(logging.Formatter):
    """Log records as JSON lines, with the traceback of an exception under `traceback`."""

    def format(self, record: logging.LogRecord) -> str:
        more = (
            {"traceback": "".join(traceback.format_exception(*record.exc_info))}
            if record.exc_info
            else {}
        )
        return json_line(record.levelname.lower(), record.name, record.getMessage(), more).rstrip(
            "\n"
        )


class _JsonText(io.TextIOBase):
    """A stream that takes text and writes each whole line of it as a JSON line; lines that are JSON
    lines pass.
    """

    def __init__(self, stream: TextIO, level: str, replaced: TextIO) -> None:
        self._stream = stream
        self._level = level
        self._replaced = replaced
        self._begun = local()

    def write(self, text: str) -> int:
        """Take text; what follows the last line break waits for the thread's next one."""
        *lines, self._begun.text = (getattr(self._begun, "text", "") + text).split("\n")
        # One write a line, and each thread its own: their lines do not mix.
        for line in filter(None, lines):
            is_json = line.startswith('{"time": ')
            self._stream.write(
                f"{line}\n"
                if is_json
                else json_line(self._level, "opir", line.removeprefix(_PREFIX))
            )
        return len(text)

    def flush(self) -> None:
        """Send what was written."""
        self._stream.flush()

    def fileno(self) -> int:
        """Return the descriptor of the stream that this one stands for."""
        return self._replaced.fileno()

    @property
    def buffer(self) -> Any:
        """The bytes of the stream that this one stands for."""
        return self._replaced.buffer
