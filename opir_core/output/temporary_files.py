"""Temporary files beside those that they will replace: locked, opir's own, and no link to anything else."""

import fcntl
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import ELOOP
from pathlib import Path

from opir_core.errors import SinkError


def locked(part: Path, path: Path) -> int:
    """Return a descriptor of a temporary file, locked; `SinkError` if another process has it."""
    while True:
        try:
            descriptor = os.open(part, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        except OSError as error:
            if error.errno == ELOOP:
                raise planted("the temporary file", part, "a link") from error
            raise
        try:
            _require_own(descriptor, part)
            is_held = _has_lock(descriptor)
            is_same = _is_file_at(descriptor, part)
        except BaseException:
            os.close(descriptor)
            raise
        if is_held and is_same:
            return descriptor
        os.close(descriptor)
        if not is_held:
            raise SinkError(f"{path} is being written by another run; wait until that has ended, or give another path")


def _require_own(descriptor: int, part: Path) -> None:
    """Raise `SinkError` if a temporary file is a device or a pipe, or has another name too, a hard link."""
    found = os.fstat(descriptor)
    if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
        what = "a hard link" if stat.S_ISREG(found.st_mode) else "a device or a pipe"
        raise planted("the temporary file", part, what)


def _has_lock(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


def _is_file_at(descriptor: int, path: Path) -> bool:
    """Return whether a descriptor is of the file that has the path now: a run that ends renames its own."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


@contextmanager
def held(part: Path) -> Iterator[bool]:
    """Hold the lock of an existing temporary file; yields whether it was free."""
    descriptor = os.open(part, os.O_RDWR | os.O_NOFOLLOW)
    try:
        _require_own(descriptor, part)
        yield _has_lock(descriptor) and _is_file_at(descriptor, part)
    finally:
        os.close(descriptor)


def keep_mode(descriptor: int, target: Path) -> None:
    """Give a temporary file the permissions of the file that it will replace."""
    if target.is_file():
        with suppress(PermissionError):
            os.fchmod(descriptor, target.stat().st_mode & 0o777)


def planted(what: str, path: Path, found: str) -> SinkError:
    """Return the error of something that is no file under a name that opir made up."""
    words = f"{what} {path} cannot be written: {found} has its name, through which opir does not write"
    return SinkError(f"{words}; remove it, or give another path")


def sync_folder(folder: Path) -> None:
    """Make the names in a folder last."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
