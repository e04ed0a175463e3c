"""SHA-256 of files, of one that still grows too."""

import hashlib
import os
import threading
from io import FileIO
from pathlib import Path

_CHUNK = 1 << 20
#: Bytes after which what was written is sent to the disk, so that little is left to wait for at the end.
_SYNCED = 64 << 20
#: Time between two looks at a file that grows, s.
_POLL_S = 0.02


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


class GrowingDigest:
    """The SHA-256 of a file to which bytes are appended: most is done when the file is whole.

    Reading and hashing release the interpreter's lock, so that they take another core, if there is one.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._file = path, FileIO(path)
        self._sum = hashlib.sha256()
        self._done = 0
        self._ended = threading.Event()
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._follow, name=f"opir sha256 {path.name}", daemon=True)
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
        synced, buffer = 0, memoryview(bytearray(_CHUNK))
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
