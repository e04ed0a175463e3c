"""Standard streams that take any text: closed ones, consoles that are not UTF-8, characters that
would act on these.
"""

import io
import os
import sys
from typing import Any

#: Characters that act instead of being shown: C1 controls, marks of direction (Unicode UAX 9),
#: separators of lines.
_ACTING = (
    *range(0x80, 0xA0),
    0x061C,
    0x200E,
    0x200F,
    *range(0x2028, 0x202F),
    *range(0x2066, 0x206A),
)
_ESCAPES = {code: f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" for code in _ACTING}

#: The same, and the other controls but line feed and tab, for text that nobody coloured.
_ALL_ESCAPES = {**{code: f"\\x{code:02x}" for code in (*range(9), *range(11, 32), 127)}, **_ESCAPES}


class _Closed(io.TextIOBase):
    """A standard stream that was closed: text is lost, as whoever closed it wants it; `fileno` is
    the closed one's.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def write(self, text: str) -> int:
        return len(text)

    def fileno(self) -> int:
        return self._descriptor


def plain_text(text: str) -> str:
    r"""Return text with control characters but line feeds and tabs written out.

    >>> plain_text("red \x1b[31m \u202ereversed")
    'red \\x1b[31m \\u202ereversed'
    """
    return text.translate(_ALL_ESCAPES)


def open_streams() -> None:
    """Make standard output and standard error take any text; closed ones become the null device.

    What a console cannot show, and what would act on it, is written out as in Python (`\\u202e`). A
    closed standard output cannot be written to, so that no event is lost in silence.
    """
    for descriptor, name, mode in (
        (0, "stdin", os.O_RDONLY),
        (1, "stdout", os.O_RDONLY),
        (2, "stderr", os.O_WRONLY),
    ):
        try:
            os.fstat(descriptor)
        except OSError:
            # The lowest free descriptor is this one: no file of the run must get it.
            os.open(os.devnull, mode)
        if getattr(sys, name) is None and descriptor:
            setattr(sys, name, _Closed(descriptor))
    for stream in (sys.stdout, sys.stderr):
        _escape(stream)


def _escape(stream: Any) -> None:
    if not hasattr(stream, "reconfigure"):
        return
    stream.reconfigure(errors="backslashreplace")
    write = stream.write

    def written(text: str) -> int:
        try:
            return int(write(text.translate(_ESCAPES)))
        except OSError as error:
            error.filename = stream.name
            raise

    stream.write = written
