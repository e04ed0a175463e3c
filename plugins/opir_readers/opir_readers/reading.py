"""Which reader a file is for, by its content, and what that reader makes of it."""

import zlib
from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import Any

import numpy as np
from attrs import fields_dict, frozen

from opir_core.errors import Problem, SceneError
from opir_core.plugin import BadFileError, FileReader, ReaderContext
from opir_core.scene import file_bytes, text_of
from opir_readers.csv_layout import is_table
from opir_readers.json_text import table_of_json
from opir_readers.likeness import likeness
from opir_readers.parquet_text import MAGIC, text_of_parquet
from opir_readers.published import published

_LARGEST_FILE_BYTES = 64_000_000
#: The most values of a text: of XML and JSON each takes up to 300 bytes, and a second for 200 000.
_MOST_VALUES = 2_500_000
_GZIP = b"\x1f\x8b"

#: What separates values: blanks, of which several count once, and marks, between which a value may
#: be empty.
_BLANK = 1
_MARK = 2
_SEPARATORS = np.array(
    [_MARK if code in b",;[{<\n\t" else _BLANK if code <= 32 else 0 for code in range(256)],
    np.uint8,
)
_BLOCK_BYTES = 1 << 20
_NEIGHBOURS = (slice(None, -1), slice(1, None))

#: Bytes that no text has.
_CONTROLS = bytes([*range(9), *range(14, 26), *range(28, 32), 127])


@frozen
class FileText:
    """The text of a file and the SHA-256 of its bytes."""

    text: str
    sha256: str


def file_text(path: str) -> FileText:
    """Return the text of a file, gzip or not, of Parquet that of its table.

    Raises `BadFileError` where it cannot be read.
    """
    if not path:
        raise BadFileError("the path is empty; give that of a file")
    try:
        content = file_bytes(path, _LARGEST_FILE_BYTES)
    except OSError as error:
        raise BadFileError(f"cannot be read: {error.strerror or error}") from error
    digest = sha256(content).hexdigest()
    if content.startswith(_GZIP):
        content = _unpacked(content)
    if len(content) > _LARGEST_FILE_BYTES:
        raise BadFileError(f"is larger than {_LARGEST_FILE_BYTES} bytes; keep only the burn")
    if content.startswith(MAGIC):
        return FileText(text_of_parquet(content), digest)
    for head, words in published("beginnings")["bytes"]:
        if content.startswith(head.encode("latin-1")):
            raise BadFileError(words)
    _require_few_values(content)
    return FileText(_decoded(content), digest)


def _require_few_values(content: bytes) -> None:
    """Raise `BadFileError` for more values than are read: each takes many times its bytes."""
    count = 0
    for start in range(0, len(content), _BLOCK_BYTES):
        block = content[start : start + _BLOCK_BYTES + 1]
        before, after = (_SEPARATORS[np.frombuffer(block, np.uint8)[rows]] for rows in _NEIGHBOURS)
        begins = (before > 0) & (after == 0)
        is_empty = (before == _MARK) & (after == _MARK)
        count += int(np.count_nonzero(begins | is_empty))
    if count > _MOST_VALUES:
        raise BadFileError(
            f"has {count} values; at most {_MOST_VALUES} are read: keep the burn, or fewer columns"
        )


def _decoded(content: bytes) -> str:
    """Return the text of bytes: UTF-8, UTF-16 with its mark or, as spreadsheets on Windows save it,
    Windows-1252.
    """
    try:
        return text_of(content)
    except ValueError as error:
        if content[1:2] == b"\0" == content[3:4]:
            raise BadFileError("is UTF-16 without a byte-order mark; save it as UTF-8") from error
        is_text = len(content.translate(None, _CONTROLS)) >= 0.99 * len(content)
        if not is_text or b"\0" in content:
            raise BadFileError(
                "is binary, not text; export CSV, or a format that is read"
            ) from error
        try:
            return text_of(content.decode("cp1252").encode())
        except ValueError:
            raise BadFileError(str(error)) from error


def _unpacked(content: bytes) -> bytes:
    """Return the content of a gzip file, at most a byte above the largest: a small one may hold
    endless zeros.
    """
    packed = zlib.decompressobj(wbits=31)
    try:
        unpacked = packed.decompress(content, _LARGEST_FILE_BYTES + 1)
    except zlib.error as error:
        raise BadFileError(f"is no whole gzip file: {error}") from error
    if not packed.eof and len(unpacked) <= _LARGEST_FILE_BYTES:
        raise BadFileError("is no whole gzip file: its end is missing")
    return unpacked


def refused(path: str, error: BadFileError) -> SceneError:
    """Return the error of a command about a file."""
    return SceneError([Problem("", str(error))], source=path)


def reader_of(
    text: str,
    readers: Sequence[FileReader],
    name: str | None = None,
    columns: Mapping[str, str] | None = None,
) -> FileReader:
    """Return the reader of a text: the one of a name, or the only one that recognises it.

    With a map of columns only readers that know its quantities count; it makes a table of any
    names theirs. Raises `BadFileError` where there is none, or several.
    """
    if name is not None:
        return _named(readers, name)
    matches = [reader for reader in readers if reader.recognises(text)]
    if columns:
        matches = _readers_of_columns(text, matches, readers, columns)
    if len(matches) > 1:
        names = " and ".join(reader.name for reader in matches)
        raise BadFileError(
            f"may be for several readers, {names}; say which with --as NAME, or format: NAME in a"
            " scene"
        )
    if matches:
        return matches[0]
    table = table_of_json(text)
    if table is not None and any(reader.recognises(table) for reader in readers):
        return reader_of(table, readers)
    kind = "a table of text" if is_table(text) else "text without lines of numbers"
    summaries = "; ".join(f"{reader.name} ({reader.summary})" for reader in readers)
    raise BadFileError(
        f"is of no format that is read: it looks like {likeness(text) or kind}; read are"
        f" {summaries}"
    )


def _named(readers: Sequence[FileReader], name: str) -> FileReader:
    """Return the reader of a name; raises `BadFileError`."""
    for reader in readers:
        if reader.name == name:
            return reader
    known = ", ".join(reader.name for reader in readers)
    raise BadFileError(f"there is no reader {name!r}; there are {known}")


def _readers_of_columns(
    text: str,
    matches: list[FileReader],
    readers: Sequence[FileReader],
    columns: Mapping[str, str],
) -> list[FileReader]:
    """Return the readers that know the quantities of a column map: of those that recognise the
    text or, of a table, of all; those that recognise it where none knows them, or has columns.
    """
    with_columns = [reader for reader in readers if "columns" in fields_dict(reader.config)]
    knowing = [reader for reader in with_columns if _knows(reader, columns)]
    known = [reader for reader in matches if reader in knowing]
    is_of_columns = is_table(table_of_json(text) or text)
    if known or not is_of_columns or not all(reader in with_columns for reader in matches):
        return known or matches
    return knowing or matches


def _knows(reader: FileReader, columns: Mapping[str, str]) -> bool:
    """Return whether a reader has all quantities of a column map."""
    try:
        reader.config(columns=columns)
    except ValueError:
        return False
    return True


def content_of(text: str, reader: FileReader, settings: Mapping[str, Any], epoch_us: int) -> Any:
    """Return what a reader makes of a text, with those settings that are set (not None, not empty).

    Raises `BadFileError` for a setting that the reader does not have, and for what the reader
    refuses.
    """
    known = fields_dict(reader.config)
    values = {name: value for name, value in settings.items() if value is not None and value != {}}
    unknown = [name for name in values if name not in known]
    if unknown:
        raise BadFileError(
            f"is read as {reader.name}, which has no {' and no '.join(unknown)}; omit"
            f" {' and '.join(unknown)} (its settings: {', '.join(known) or 'none'})"
        )
    try:
        config = reader.config(**values)
    except ValueError as error:
        raise BadFileError(f"{reader.name}: {error.args[0]}") from error
    return reader.build(config, ReaderContext(text=text, epoch_us=epoch_us))
