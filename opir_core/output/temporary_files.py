"""Temporary files beside those that they will replace: locked, opir's own, no link to anything
else; their SHA-256.
"""

import hashlib
import os
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import ELOOP
from io import FileIO
from pathlib import Path

from opir_core.errors import SinkError

try:
    import fcntl
except ImportError as error:
    raise SinkError(
        "opir writes files on Linux and macOS only: this system has no locks of POSIX (fcntl). On"
        " Windows, run opir in WSL; opir_core.simulate works without files"
    ) from error

_CHUNK = 1 << 20
#: Bytes after which what was written is sent to the disk, so that little is left to wait for at the
#: end.
_SYNCED = 64 << 20
#: What became of a file under a run.
REMOVED = "another process removed it"
REPLACED = "another process put another file in its place"
#: Time between two looks at a file that grows, s.
_POLL_S = 0.02


def locked(temporary: Path, path: Path) -> int:
    """Return a descriptor of a temporary file, locked; `SinkError` if another process has it."""
    while True:
        try:
            descriptor = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        except OSError as error:
            if error.errno == ELOOP:
                raise planted("the temporary file", temporary, "a link") from error
            raise
        try:
            _require_own(descriptor, temporary)
            is_held = _has_lock(descriptor)
            is_same = is_file_at(descriptor, temporary)
        except BaseException:
            os.close(descriptor)
            raise
        if is_held and is_same:
            return descriptor
        os.close(descriptor)
        if not is_held:
            raise SinkError(
                f"{path} is being written by another run; wait until that has ended, or give"
                f" another path"
            )


def is_file_at(descriptor: int, path: Path) -> bool:
    """Return whether a descriptor is of the file that has the path now: a run that ends renames its
    own.
    """
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


class GrowingFile:
    """An open file that only this process cuts: it notices that its name or its bytes are gone.

    `size` is what this process knows it to have at least: it grows after a write, and falls before
    a cut. A device, a pipe and a file without a name from
    the start have no fault.
    """

    def __init__(self, descriptor: int) -> None:
        status = os.fstat(descriptor)
        self._descriptor = descriptor
        self._is_watched = stat.S_ISREG(status.st_mode) and status.st_nlink > 0
        self.size = status.st_size

    def fault(self) -> str:
        """Return what became of the file, "" if nothing did."""
        known_size = self.size  # before the look: another thread may write between the two
        status = os.fstat(self._descriptor)
        if not self._is_watched:
            return ""
        if not status.st_nlink:
            return REMOVED
        return _cut(status.st_size, known_size)


class NamedFile:
    """The file that a path names, of which at least `floor` bytes stay where it has so many."""

    def __init__(self, path: Path, floor: int) -> None:
        self._path = path
        self._floor = floor
        self._size = 0
        self._status: os.stat_result | None = None
        with suppress(OSError):
            self._status = path.stat()

    def fault(self) -> str:
        """Return what became of the file, "" if nothing did."""
        known_size = self._size  # before the look: another thread may look between the two
        try:
            status = self._path.stat()
        except FileNotFoundError:
            return REMOVED
        except OSError:  # a disk that fails says so where it is written
            return ""
        if self._status is None or not os.path.samestat(status, self._status):
            return REPLACED
        self._size = max(known_size, min(status.st_size, self._floor))
        return _cut(status.st_size, known_size)


def _cut(size: int, known_size: int) -> str:
    words = f"another process cut it off at {size} of {known_size} bytes"
    return words if size < known_size else ""


def _require_own(descriptor: int, temporary: Path) -> None:
    """Raise `SinkError` if a temporary file is a device or a pipe, or has another name too, a hard
    link.
    """
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1:
        file_kind = "a hard link" if stat.S_ISREG(status.st_mode) else "a device or a pipe"
        raise planted("the temporary file", temporary, file_kind)


def _has_lock(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


@contextmanager
def held(temporary: Path) -> Iterator[bool]:
    """Hold the lock of an existing temporary file; yields whether it was free."""
    descriptor = os.open(temporary, os.O_RDWR | os.O_NOFOLLOW)
    try:
        _require_own(descriptor, temporary)
        yield _has_lock(descriptor) and is_file_at(descriptor, temporary)
    finally:
        os.close(descriptor)


def keep_mode(descriptor: int, target: Path) -> None:
    """Give a temporary file the permissions of the file that it will replace."""
    if target.is_file():
        with suppress(PermissionError):
            os.fchmod(descriptor, target.stat().st_mode & 0o777)


def planted(kind: str, path: Path, obstacle: str) -> SinkError:
    """Return the error of a default path that is not a regular file."""
    words = (
        f"{kind} {path} cannot be written: {obstacle} has its name, through which opir does not"
        f" write"
    )
    return SinkError(f"{words}; remove it, or give another path")


def write_all(descriptor: int, content: bytes | memoryview) -> None:
    """Write all of a content into a file; raises `OSError`."""
    remaining = memoryview(content)
    while remaining:
        remaining = remaining[os.write(descriptor, remaining) :]


def sync_path(path: Path) -> None:
    """Make the content of a file, or the names in a folder, last."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


class GrowingDigest:
    """The SHA-256 of a file to which bytes are appended: most is done when the file is whole.

    Reading and hashing release the interpreter's lock, so that they take another core, if there is
    one.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = FileIO(path)
        self._sum = hashlib.sha256()
        self._done = 0
        self._ended = threading.Event()
        self._error: OSError | None = None
        self._thread = threading.Thread(
            target=self._follow, name=f"opir sha256 {path.name}", daemon=True
        )
        self._thread.start()

    def result(self, size: int) -> str:
        """Return the digest of the first `size` bytes, once the file is whole; raises `OSError`."""
        self.stop()
        if self._error is not None:
            raise self._error
        return self._sum.hexdigest() if self._done == size else file_digest(self._path)

    def stop(self) -> None:
        """Read what is left and end the thread."""
        self._ended.set()
        self._thread.join()

    def _follow(self) -> None:
        try:
            self._read()
        except OSError as error:
            self._error = error
        self._file.close()

    def _read(self) -> None:
        synced = 0
        buffer = memoryview(bytearray(_CHUNK))
        while True:
            is_last = self._ended.is_set()
            while count := self._file.readinto(buffer):
                self._sum.update(buffer[:count])
                self._done += count
                if self._done - synced >= _SYNCED:
                    os.fsync(self._file.fileno())
                    synced = self._done
            if is_last:
                return
            self._ended.wait(_POLL_S)
