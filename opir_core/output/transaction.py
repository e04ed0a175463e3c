"""The files of a batch run as one transaction: all of them are the new run's, or all are those of the run before.

A file is written under a temporary name, `events.jsonl.part`, in the folder of its path, and locked there. When the run
is whole, every file is on disk and the manifest, with the SHA-256 of each, lies complete under its temporary name, the
files are renamed, the manifest last. A run that is killed before leaves the files that were there; one that is killed
while they are renamed is finished by `finish_interrupted`, when the files are next written or read.
"""

import hashlib
import json
import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Any

from attrs import frozen

from opir_core.errors import SinkError, reason_of, unwritable

try:
    import fcntl
except ImportError:  # Windows: files are replaced whole, and not locked
    _HAS_LOCKS = False
else:
    _HAS_LOCKS = True

#: What is appended to a path while its file is written.
TEMPORARY = ".part"
#: The key of a manifest that lists the files of its run: kind, name from the manifest's folder, bytes and SHA-256.
FILES_KEY = "written_files"
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
        self._path = path
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
            descriptor = os.open(self._path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
        except OSError as error:
            self._error = error
            return
        with FileIO(descriptor, "rb") as file:
            try:
                self._read(file)
            except OSError as error:
                self._error = error

    def _read(self, file: FileIO) -> None:
        synced, buffer = 0, memoryview(bytearray(_CHUNK))
        while True:
            is_last = self._ended.is_set()
            while count := file.readinto(buffer):
                self._sum.update(buffer[:count])
                self._done += count
                if self._done - synced >= _SYNCED:
                    os.fsync(file.fileno())
                    synced = self._done
            if is_last:
                return
            self._ended.wait(_POLL_S)


@frozen(eq=False)
class _Staged:
    kind: str
    path: Path
    target: Path
    part: Path
    descriptor: int
    growing: GrowingDigest | None


class OutputFiles:
    """The files of a batch run; ends with `commit`, `keep` or `abandon`."""

    def __init__(self, manifest: Path | None = None) -> None:
        self._staged: list[_Staged] = []
        self._record: _Staged | None = None
        if manifest is not None and _is_replaceable(manifest):
            finish_interrupted(manifest)
            self._record = self._open("manifest", manifest, only_appends=False)
        self._manifest = manifest

    def stage(self, path: str | Path, *, only_appends: bool = False, kind: str = "events") -> Path:
        """Return where the file of a path is written until the run is whole; the path itself if it is no regular file.

        `only_appends` promises that bytes once written are not changed, so that they are hashed while the run goes on.
        Raises `SinkError` if another run writes this path, or nothing can be written there.
        """
        path = Path(path)
        if not _is_replaceable(path):
            return path
        staged = self._open(kind, path, only_appends=only_appends)
        self._staged.append(staged)
        return staged.part

    @property
    def parts(self) -> Sequence[Path]:
        """The temporary files, without that of the manifest."""
        return tuple(staged.part for staged in self._staged)

    def commit(self, manifest: Mapping[str, Any]) -> Mapping[str, Any]:
        """Put all files in place and return the manifest with the SHA-256 of each; raise `SinkError` if that fails.

        If it fails after the manifest was written, the temporary files stay, and what next reads or writes them
        puts them in place; before, they are removed.
        """
        is_recorded = False
        try:
            document = {**manifest, FILES_KEY: [self._described(staged) for staged in self._staged]}
            _sync_folders(self._staged)
            self._write_manifest(document)
            is_recorded = self._record is not None
            _rename([*self._staged, *([self._record] if self._record else [])])
        except BaseException:
            self.keep() if is_recorded else self.abandon()
            raise
        self.keep()
        return document

    def keep(self) -> None:
        """Leave the temporary files as they are and release their locks."""
        for staged in self._all():
            if staged.growing is not None:
                staged.growing.stop()
            with suppress(OSError):
                os.close(staged.descriptor)
        self._staged, self._record = [], None

    def abandon(self) -> None:
        """Remove the temporary files; the files of an earlier run are as they were."""
        for staged in self._all():
            with suppress(OSError):
                staged.part.unlink()
        self.keep()

    def _all(self) -> list[_Staged]:
        return [*self._staged, *([self._record] if self._record else [])]

    def _open(self, kind: str, path: Path, *, only_appends: bool) -> _Staged:
        target = Path(os.path.realpath(path))  # a link stays one
        part = target.with_name(target.name + TEMPORARY)
        try:
            descriptor = _locked(part, path)
            with ExitStack() as closing:
                closing.callback(os.close, descriptor)
                os.ftruncate(descriptor, 0)
                _keep_mode(descriptor, target)
                closing.pop_all()
        except OSError as error:
            raise unwritable(_words(kind), path, error) from error
        growing = GrowingDigest(part) if only_appends else None
        return _Staged(kind, path, target, part, descriptor, growing)

    def _described(self, staged: _Staged) -> Mapping[str, Any]:
        """Return the entry of a file in the manifest, once its content is on disk."""
        try:
            os.fsync(staged.descriptor)
            size = os.fstat(staged.descriptor).st_size
            sha256 = staged.growing.result(size) if staged.growing else file_digest(staged.part)
        except OSError as error:
            raise unwritable(_words(staged.kind), staged.path, error) from error
        folder = Path.cwd() if self._record is None else self._record.target.parent
        return {"kind": staged.kind, "name": _name_from(folder, staged.target), "bytes": size, "sha256": sha256}

    def _write_manifest(self, document: Mapping[str, Any]) -> None:
        if self._manifest is None:
            return
        text = (json.dumps(document, indent=2) + "\n").encode()
        try:
            if self._record is None:  # no regular file
                self._manifest.write_bytes(text)
                return
            rest = memoryview(text)
            while rest:
                rest = rest[os.write(self._record.descriptor, rest) :]
            os.fsync(self._record.descriptor)
        except OSError as error:
            raise unwritable("the manifest", self._manifest, error) from error


def finish_interrupted(manifest: Path) -> bool:
    """Put the files of a run in place that was whole, and was killed while it did so; return whether there was one.

    Nothing is done while another run holds the files, or if one of them is not what the manifest says.
    """
    target = Path(os.path.realpath(manifest))
    record = target.with_name(target.name + TEMPORARY)
    if not record.is_file():
        return False
    with suppress(OSError, ValueError, KeyError, TypeError), _holding(record) as is_held:
        if not is_held:
            return False
        entries = [(target.parent / entry["name"], entry) for entry in json.loads(record.read_bytes())[FILES_KEY]]
        moves = [path for path, entry in entries if not _is_there(path, entry)]
        for path in moves:
            path.with_name(path.name + TEMPORARY).replace(path)
        record.replace(target)
        for folder in {target.parent, *(path.parent for path in moves)}:
            _sync_folder(folder)
        return True
    return False


def _is_there(path: Path, entry: Mapping[str, Any]) -> bool:
    """Return whether a file is in place, False if it is under its temporary name; `ValueError` if it is neither."""
    part = path.with_name(path.name + TEMPORARY)
    for place in (part, path):
        is_whole = place.is_file() and place.stat().st_size == entry["bytes"] and file_digest(place) == entry["sha256"]
        if is_whole:
            return place == path
    raise ValueError(entry["name"])


def _rename(files: Sequence[_Staged]) -> None:
    """Rename temporary files in order, and make that last."""
    for staged in files:
        try:
            if not _HAS_LOCKS:
                os.close(staged.descriptor)
            staged.part.replace(staged.target)
        except OSError as error:
            words = f"{_words(staged.kind)} {staged.path} cannot be put in place: {reason_of(error)}"
            way = f"the run is whole under temporary names ({staged.part.name}); `opir score` or `opir run` finishes it"
            raise SinkError(f"{words}; {way}") from error
    try:
        _sync_folders(files)
    except SinkError as error:
        raise SinkError(f"{error}; the files of this run are in place, but a power cut may still undo that") from error


def _words(kind: str) -> str:
    return {"events": "jsonl:", "manifest": "the manifest"}.get(kind, f"the {kind} file")


def _is_replaceable(path: Path) -> bool:
    """Return whether a path is a regular file, or nothing yet."""
    try:
        os.fsencode(path)
        return bool(path.name) and "\0" not in str(path) and (path.is_file() or not path.exists())
    except ValueError:  # half a surrogate pair: no path
        return False


def _name_from(folder: Path, path: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # Windows: another drive
        return path.as_posix()


def _locked(part: Path, path: Path) -> int:
    """Return a descriptor of a temporary file, locked; `SinkError` if another process has it."""
    while True:
        descriptor = os.open(part, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666)
        try:
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


def _has_lock(descriptor: int) -> bool:
    if not _HAS_LOCKS:
        return True
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
def _holding(part: Path) -> Iterator[bool]:
    """Hold the lock of an existing temporary file; yields whether it was free."""
    descriptor = os.open(part, os.O_RDWR)
    try:
        yield _has_lock(descriptor) and _is_file_at(descriptor, part)
    finally:
        os.close(descriptor)


def _keep_mode(descriptor: int, target: Path) -> None:
    """Give a temporary file the permissions of the file that it will replace."""
    if hasattr(os, "fchmod") and target.is_file():
        with suppress(PermissionError):
            os.fchmod(descriptor, target.stat().st_mode & 0o777)


def _sync_folders(files: Sequence[_Staged]) -> None:
    for folder in {staged.target.parent for staged in files}:
        try:
            _sync_folder(folder)
        except OSError as error:
            raise unwritable("the folder", folder, error) from error


def _sync_folder(folder: Path) -> None:
    if not _HAS_LOCKS:  # Windows opens no folders
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
