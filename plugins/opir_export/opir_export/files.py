"""Files that are complete or not there: written under another name, then renamed."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from opir_core.errors import SinkError, unwritable


@contextmanager
def new_file(path: Path, what: str) -> Iterator[Path]:
    """Yield a path to write to, which replaces `path` when the context ends without an error.

    Raises `SinkError` with the path and the remedy if the system does not permit it.
    """
    if path.is_dir():
        raise unwritable(what, path, IsADirectoryError(21, "is a folder"))
    part = path.with_name(f".{path.name}.part")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        _remove(part)
        raise unwritable(what, path, error) from error
    except BaseException:
        _remove(part)
        raise


def write_bytes(path: Path, content: bytes, what: str) -> None:
    """Write a file; raises `SinkError` if that is not possible."""
    with new_file(path, what) as part:
        part.write_bytes(content)


def new_folder(path: Path, what: str) -> None:
    """Make a folder, which may be there already; raises `SinkError` if that is not possible."""
    try:
        path.mkdir(exist_ok=True)
    except FileExistsError as error:
        raise SinkError(f"{what} {path} is a file; give the path of a folder") from error
    except OSError as error:
        raise unwritable(what, path, error) from error


def _remove(part: Path) -> None:
    with suppress(OSError):
        part.unlink(missing_ok=True)
