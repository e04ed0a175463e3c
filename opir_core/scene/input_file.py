"""Files that a user names, read whole: never a pipe or a device, which would let a command wait
without end.
"""

import os
import stat
from errno import EISDIR, ENOENT
from pathlib import Path

#: What is no file, and how to say so.
_KINDS = (
    (stat.S_ISFIFO, "it is a pipe (FIFO)"),
    (stat.S_ISSOCK, "it is a socket"),
    (stat.S_ISCHR, "it is a device"),
    (stat.S_ISBLK, "it is a device"),
)

#: A pipe is opened without waiting for somebody to write into it.
_READING = (
    os.O_RDONLY
    | getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_BINARY", 0)
    | getattr(os, "O_CLOEXEC", 0)
)

#: Marks at the beginning of a text, and the encoding of which each is.
_BYTE_ORDER_MARKS = {b"\xef\xbb\xbf": "utf-8", b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}


class NotAFileError(OSError):
    """A path that names a pipe, a socket or a device; `strerror` says which, and the way out."""


def file_bytes(path: str | os.PathLike[str], most_bytes: int | None = None) -> bytes:
    """Return the content of a regular file; with `most_bytes`, no more than one byte above these.

    Raises `OSError`: `NotAFileError` at once for a pipe, a socket or a device, `IsADirectoryError`
    for a folder.
    """
    # Before opening, because to open a device may act on it; after it, because the path may have
    # changed.
    try:
        _require_file(Path(path).stat().st_mode, path)
    except FileNotFoundError:
        words = (
            "no such file"
            if Path(path).is_absolute()
            else "no such file, relative to the working directory"
        )
        raise FileNotFoundError(ENOENT, words) from None
    with os.fdopen(os.open(path, _READING), "rb") as file:
        _require_file(os.fstat(file.fileno()).st_mode, path)
        return file.read() if most_bytes is None else file.read(most_bytes + 1)


def text_of(content: bytes) -> str:
    """Return the text of a file's content, UTF-8 or with a byte-order mark UTF-16, every line ended
    by a line feed.

    Raises `ValueError` with the line and the byte where it is no such text.
    """
    mark = next((mark for mark in _BYTE_ORDER_MARKS if content.startswith(mark)), b"")
    encoding = _BYTE_ORDER_MARKS.get(mark, "utf-8")
    try:
        text = content[len(mark) :].decode(encoding)
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start + len(mark)) + 1
        byte = content[error.start + len(mark)]
        raise ValueError(
            f"line {line}: is not UTF-8 text (byte 0x{byte:02x}); save the file as UTF-8"
        ) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise ValueError(f"line {line}: is not text: it contains zero bytes")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _require_file(mode: int, path: str | os.PathLike[str]) -> None:
    if stat.S_ISREG(mode):
        return
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(EISDIR, os.strerror(EISDIR), os.fspath(path))
    description = next(
        (words for is_kind, words in _KINDS if is_kind(mode)), "it is no regular file"
    )
    raise NotAFileError(
        0, f"{description}; write its content to a file and give that", os.fspath(path)
    )
