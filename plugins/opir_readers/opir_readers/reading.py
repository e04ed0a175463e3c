"""Which reader a file is for, by its content, and what that reader makes of it."""

import zlib
from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import Any

from attrs import fields_dict, frozen

from opir_core.plugin import BadFileError, FileReader, ReaderContext
from opir_core.scene import file_bytes, text_of
from opir_readers.csv_layout import is_table
from opir_readers.json_text import table_of_json
from opir_readers.likeness import likeness
from opir_readers.parquet_text import MAGIC, text_of_parquet

_LARGEST_FILE_BYTES = 64_000_000
_GZIP = b"\x1f\x8b"

#: How files of other kinds than text begin, and what they are.
_BINARY = (
    (b"\x1f\x9d", "is compressed by compress (.Z): unpack it with uncompress or gzip -d"),
    (b"BZh", "is compressed by bzip2: unpack it with bunzip2"),
    (b"\xfd7zXZ", "is compressed by xz: unpack it with unxz"),
    (b"\x28\xb5\x2f\xfd", "is compressed by zstd: unpack it with unzstd"),
    (b"PK\x03\x04", "is a ZIP file, a KMZ or a spreadsheet: unpack it, or export CSV"),
    (b"\x89HDF", "is HDF5 or netCDF 4, which is not read: export CSV"),
    (b"CDF\x01", "is netCDF, which is not read: export CSV"),
    (b"CDF\x02", "is netCDF, which is not read: export CSV"),
    (b"MATLAB 5.0", "is a MATLAB file: export CSV (writetable)"),
    (b"\xd0\xcf\x11\xe0", "is an Excel or Word file: export CSV"),
    (b"\x93NUMPY", "is a NumPy array: export CSV (numpy.savetxt with header=…)"),
    (b"SQLite format", "is an SQLite database: export a table as CSV"),
    (_GZIP, "is compressed twice: unpack it once"),
    (b"DAF/SPK", "is a SPICE kernel, which is not read: export its states as OEM"),
    (b"%PDF", "is PDF, which is not read"),
    (b"\x89PNG", "is a picture"),
)


#: Bytes that no text has, and the least share of others in it.
_CONTROLS = bytes([*range(9), *range(14, 26), *range(28, 32), 127])
_LEAST_TEXT = 0.99


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
    kind = next((words for head, words in _BINARY if content.startswith(head)), "")
    if kind:
        raise BadFileError(kind)
    return FileText(_decoded(content), digest)


def _decoded(content: bytes) -> str:
    """Return the text of bytes: UTF-8, UTF-16 with its mark or, as spreadsheets on Windows save it,
    Windows-1252.
    """
    try:
        return text_of(content)
    except ValueError as error:
        if content[1:2] == b"\0" == content[3:4]:
            raise BadFileError("is UTF-16 without a byte-order mark; save it as UTF-8") from error
        if len(content.translate(None, _CONTROLS)) < _LEAST_TEXT * len(content) or b"\0" in content:
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


def reader_of(text: str, readers: Sequence[FileReader], name: str | None = None) -> FileReader:
    """Return the reader of a text: the one of a name, or the only one that recognises it.

    Raises `BadFileError` where there is none, or several.
    """
    known = ", ".join(reader.name for reader in readers)
    if name is not None:
        found = [reader for reader in readers if reader.name == name]
        if not found:
            raise BadFileError(f"there is no reader {name!r}; there are {known}")
        return found[0]
    found = [reader for reader in readers if reader.recognises(text)]
    if len(found) > 1:
        names = " and ".join(reader.name for reader in found)
        raise BadFileError(
            f"may be for several readers, {names}; say which with --as NAME, or format: NAME in a"
            f" scene"
        )
    if not found:
        table = table_of_json(text)
        if table is not None and any(reader.recognises(table) for reader in readers):
            return reader_of(table, readers)
        like = likeness(text) or (
            "a table of text" if is_table(text) else "text without lines of numbers"
        )
        summaries = "; ".join(f"{reader.name} ({reader.summary})" for reader in readers)
        raise BadFileError(
            f"is of no format that is read: it looks like {like}; read are {summaries}"
        )
    return found[0]


def content_of(text: str, reader: FileReader, settings: Mapping[str, Any], epoch_us: int) -> Any:
    """Return what a reader makes of a text, with those settings that are set (not None, not empty).

    Raises `BadFileError` for a setting that the reader does not have, and for what the reader
    refuses.
    """
    given = {name: value for name, value in settings.items() if value is not None and value != {}}
    unknown = [name for name in given if name not in fields_dict(reader.config)]
    if unknown:
        own = ", ".join(fields_dict(reader.config)) or "none"
        raise BadFileError(
            f"is read as {reader.name}, which has no {' and no '.join(unknown)}; omit"
            f" {' and '.join(unknown)} (its settings: {own})"
        )
    return reader.build(reader.config(**given), ReaderContext(text=text, epoch_us=epoch_us))
