"""A disk that fails: the n-th call that touches a file of a folder is answered with an error,
Python's or SQLite's own.

    with FailingDisk(folder) as disk:
        disk.fail_at(7, errno.EIO)
        ...
    disk.calls      # what was called, in order, and of which file

Python's calls are those of `os` and of files that it opens to write. SQLite's are taken where its
own tests take them: `xSetSystemCall` of its `unix` interface to files, and the methods of each file
it opens (https://www.sqlite.org/c3ref/vfs.html). Nothing is loaded beforehand, and other files are
left alone.
"""

import _sqlite3
import ctypes as c
import errno
import io
import os
import sqlite3
import threading
from pathlib import Path
from typing import Any
from unittest.mock import patch

OPEN = "open"
WRITE = "write"
SYNC = "fsync"
TRUNCATE = "truncate"
RENAME = "rename"
REMOVE = "unlink"
READ = "read"
#: What a disk is asked that takes bytes.
WRITING = (OPEN, WRITE, SYNC, TRUNCATE, RENAME, REMOVE)
#: Half of the bytes are taken, and no error is raised: the caller writes the rest. If it lasts,
#: what follows is EIO.
SHORT = -1
#: Every answer of a disk that is full, over its quota or a limit, failing, or mounted anew to be
#: read only.
ERRORS = (errno.EIO, errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


class FailingDisk:
    """The files of a folder; `calls` are those seen, as pairs of kind and name of the file."""

    def __init__(self, folder):
        self._folder = os.path.realpath(folder)
        self._lock = threading.Lock()
        self.calls = []
        self.heal()

    def fail_at(
        self,
        number,
        error,
        *,
        lasts=False,
        kinds=WRITING,
        of=lambda _name: True,
    ):
        """Let the call of that number from now on fail, of those of some kinds; with `lasts` every
        later one too.

        Only calls of files whose names `of` is true of count.
        """
        with self._lock:
            self._number = number
            self._error = error
            self._lasts = lasts
            self._kinds = frozenset(kinds)
            self._of = of
            self._seen = 0
            self.failed = 0

    def heal(self):
        """Let every call do what it is asked."""
        self.fail_at(0, 0)

    @property
    def seen(self):
        """How many calls of the kinds were seen since `fail_at`."""
        return self._seen

    def answer(self, kind, path):
        """Count a call; return the error it is answered with, `SHORT`, or 0."""
        name = os.path.realpath(os.fsdecode(path))
        if not name.startswith(self._folder):
            return 0
        with self._lock:
            self.calls.append((kind, Path(name).name))
            if kind not in self._kinds or not self._of(Path(name).name):
                return 0
            self._seen += 1
            is_due = self._number and (
                self._seen >= self._number if self._lasts else self._seen == self._number
            )
            if not is_due:
                return 0
            error = errno.EIO if self._error == SHORT and self.failed else self._error
            if error == SHORT and kind != WRITE:
                return 0
            self.failed += 1
            return error

    def __enter__(self):
        _sqlite().disk = self
        self._patches = [
            patch.object(os, name, python_call) for name, python_call in _python_calls(self).items()
        ]
        self._patches.append(patch.object(io, "open", _opening(self)))
        for overlay in self._patches:
            overlay.start()
        return self

    def __exit__(self, *_error):
        for overlay in self._patches:
            overlay.stop()
        _sqlite().disk = None


def _name_of(descriptor):
    try:
        return str(Path(f"/proc/self/fd/{descriptor}").readlink())
    except OSError:
        return ""


def _raise(error, path):
    raise OSError(error, os.strerror(error), str(path))


def _python_calls(disk):
    """Return the functions of `os` as such a disk has them."""
    real = {
        name: getattr(os, name)
        for name in ("open", "write", "fsync", "ftruncate", "replace", "rename", "unlink")
    }

    def of_descriptor(name, kind):
        def call(descriptor, *remainder):
            error = disk.answer(kind, _name_of(descriptor))
            if error == SHORT:
                return real[name](descriptor, bytes(remainder[0])[: max(1, len(remainder[0]) // 2)])
            return _raise(error, "") if error else real[name](descriptor, *remainder)

        return call

    def of_path(name, kind):
        def call(path, *remainder, **named):
            is_read = name == "open" and not remainder[0] & (os.O_WRONLY | os.O_RDWR)
            error = disk.answer(READ if is_read else kind, path)
            return _raise(error, path) if error else real[name](path, *remainder, **named)

        return call

    return {
        "open": of_path("open", OPEN),
        "write": of_descriptor("write", WRITE),
        "fsync": of_descriptor("fsync", SYNC),
        "ftruncate": of_descriptor("ftruncate", TRUNCATE),
        "replace": of_path("replace", RENAME),
        "rename": of_path("rename", RENAME),
        "unlink": of_path("unlink", REMOVE),
    }


def _opening(disk):
    """Return `io.open` with files whose writes may fail."""
    real = io.open

    class File(io.FileIO):
        def write(self, content):
            error = disk.answer(WRITE, self.name)
            if error == SHORT:
                content = bytes(content)[: max(1, len(content) // 2)]
            elif error:
                _raise(error, self.name)
            return super().write(content)

    def call(path, mode="r", *remainder, **named):
        if mode != "wb" or not isinstance(path, str | os.PathLike):
            return real(path, mode, *remainder, **named)
        error = disk.answer(OPEN, path)
        return _raise(error, path) if error else io.BufferedWriter(File(path, "wb"))

    return call


class _Vfs(c.Structure):
    _fields_ = (
        *((name, c.c_int) for name in ("version", "size", "longest")),
        *((name, c.c_void_p) for name in ("next", "name", "data", "open")),
        *((f"method{number}", c.c_void_p) for number in range(12)),
        *((name, c.c_void_p) for name in ("set_call", "get_call", "next_call")),
    )


#: Methods of a file: version, then close, read, write, truncate, sync and 13 others.
_SYNC_METHOD = 5
_METHODS = 19
_METHOD_TABLE = c.c_void_p * _METHODS
_IOERR_FSYNC = 1034
_FILE_METHOD = c.CFUNCTYPE(c.c_int, c.c_void_p, c.c_int)
_FILE_OPEN = c.CFUNCTYPE(c.c_int, c.c_void_p, c.c_void_p, c.c_void_p, c.c_int, c.c_void_p)
_TRANSFER = c.CFUNCTYPE(c.c_ssize_t, c.c_int, c.c_void_p, c.c_size_t, c.c_int64, use_errno=True)
#: SQLite's names of calls of the system: kind, type, and whether the first argument is a
#: descriptor.
_SYSTEM_CALLS: dict[bytes, tuple[str, Any, bool]] = {
    b"open": (OPEN, c.CFUNCTYPE(c.c_int, c.c_char_p, c.c_int, c.c_int, use_errno=True), False),
    b"pread": (READ, _TRANSFER, True),
    b"pread64": (READ, _TRANSFER, True),
    b"pwrite": (WRITE, _TRANSFER, True),
    b"pwrite64": (WRITE, _TRANSFER, True),
    b"ftruncate": (TRUNCATE, c.CFUNCTYPE(c.c_int, c.c_int, c.c_int64, use_errno=True), True),
    b"unlink": (REMOVE, c.CFUNCTYPE(c.c_int, c.c_char_p, use_errno=True), False),
}


class _Sqlite:
    """SQLite with our calls, for the rest of the process: open files keep their methods; `disk` is
    None at rest.
    """

    def __init__(self):
        self.disk = None
        library = c.CDLL(getattr(_sqlite3, "__file__", None))
        library.sqlite3_vfs_find.restype = c.POINTER(_Vfs)
        self._vfs = library.sqlite3_vfs_find(None)
        get = c.CFUNCTYPE(c.c_void_p, c.c_void_p, c.c_char_p)(self._vfs.contents.get_call)
        put = c.CFUNCTYPE(c.c_int, c.c_void_p, c.c_char_p, c.c_void_p)(self._vfs.contents.set_call)
        position = c.cast(self._vfs, c.c_void_p)
        self._kept = []
        for name, (kind, form, has_descriptor) in _SYSTEM_CALLS.items():
            if address := get(position, name):
                function = form(self._system_call(form(address), kind, has_descriptor))
                self._kept.append(function)
                put(position, name, c.cast(function, c.c_void_p))
        self._names = {}
        self._tables = {}
        self._real_open = _FILE_OPEN(self._vfs.contents.open)
        self._open = _FILE_OPEN(self._opened)
        self._vfs.contents.open = c.cast(self._open, c.c_void_p).value

    def _system_call(self, real, kind, has_descriptor):
        def call(handle, *remainder):
            disk = self.disk
            error = (
                0
                if disk is None
                else disk.answer(kind, _name_of(handle) if has_descriptor else handle)
            )
            if error == SHORT:
                remainder = (remainder[0], max(1, remainder[1] // 2), *remainder[2:])
            elif error:
                c.set_errno(error)
                return -1
            return int(real(handle, *remainder))

        return call

    def _opened(self, vfs, name, file, flags, inputs):
        code = int(
            self._real_open(vfs, name, file, flags, inputs)
        )  # the name as it came: SQLite keeps the pointer
        methods = c.cast(file, c.POINTER(c.c_void_p))
        if code == 0 and name is not None and methods[0]:
            self._names[file] = c.string_at(name)
            methods[0] = self._table(methods[0])
        return code

    def _table(self, address):
        if address not in self._tables:
            table = _METHOD_TABLE.from_buffer_copy(_METHOD_TABLE.from_address(address))
            real = _FILE_METHOD(table[_SYNC_METHOD])

            def sync(file, flags):
                disk = self.disk
                if disk is not None and disk.answer(SYNC, self._names.get(file, b"")):
                    return _IOERR_FSYNC
                return int(real(file, flags))

            made = _FILE_METHOD(sync)
            table[_SYNC_METHOD] = c.cast(made, c.c_void_p).value
            self._tables[address] = table, made
        return c.addressof(self._tables[address][0])


_product: list[_Sqlite] = []


def _sqlite():
    if not _product:
        _product.append(_Sqlite())
    return _product[0]


def can_fail():
    """Return whether this system and this SQLite can be made to fail."""
    try:
        return Path("/proc/self/fd").exists() and bool(_sqlite()) and sqlite3.threadsafety >= 1
    except (AttributeError, OSError, ValueError):
        return False
