"""The files of a run, an export, a report or a study as one transaction: all are the new ones, or
all those before.

A file is written under a temporary name, `events.jsonl.part`, in the folder of its path, and locked
there. When every file is on disk and the manifest, with the SHA-256 of each, lies complete under
its temporary name, the files are renamed, the manifest last. A process that is killed before leaves
the files that were there; one that is killed while they are renamed is finished by
`finish_interrupted`, when the files are next written or read.

Only regular files are replaced. A path that the user gives may be a link, which stays one, or a
device or pipe, which is written through; under a name that opir makes up neither is written to.
"""

import json
import os
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from attrs import frozen

from opir_core.errors import SinkError, reason_of, unwritable
from opir_core.output.temporary_files import (
    GrowingDigest,
    file_digest,
    held,
    is_file_at,
    keep_mode,
    locked,
    planted,
    sync_path,
    write_all,
)

#: What is appended to a path while its file is written.
TEMPORARY = ".part"
#: The key of a manifest that lists the files of its run: kind, name from the manifest's folder,
#: bytes and SHA-256.
FILES_KEY = "written_files"
#: Name of the list of a folder's files while they are put in place, with `TEMPORARY`.
_LIST = ".opir"


@frozen(eq=False, repr=False)
class _Staged:
    kind: str
    path: Path
    target: Path
    part: Path
    descriptor: int
    growing: GrowingDigest | None


class OutputFiles:
    """Files that are put in place together; ends with `commit`, `keep` or `abandon`.

    As a context it commits at the end, and abandons at an error. `manifest` is the file that lists
    the others. Instead, several files may have a `folder`, made if it is missing, with a list of
    them until all are in place. `is_made_up` is whether opir made up the name of either.
    """

    def __init__(
        self, manifest: Path | None = None, *, folder: Path | None = None, is_made_up: bool = False
    ) -> None:
        self._staged: list[_Staged] = []
        self._made: list[Path] = []
        self._record: _Staged | None = None
        self._is_kept = folder is None
        self._manifest = manifest
        if folder is not None:
            self.make_folder(folder, is_made_up=is_made_up)
            self._manifest = folder / _LIST
        if self._manifest is not None and _is_replaceable(
            "manifest", self._manifest, is_made_up or not self._is_kept
        ):
            finish_interrupted(self._manifest)
            self._record = self._open(
                "manifest", self._manifest, only_appends=False, is_made_up=is_made_up
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, error: object, _trace: TracebackType | None
    ) -> None:
        self.commit({}) if error is None else self.abandon()

    def stage(
        self,
        path: str | Path,
        *,
        only_appends: bool = False,
        kind: str = "events",
        is_made_up: bool = False,
    ) -> Path:
        """Return where the file of a path is written until all are whole; the path itself if it is
        no regular file.

        `only_appends` promises that bytes once written are not changed, so that they are hashed
        meanwhile. Raises `SinkError` if another process writes this path, nothing can be written
        there, or a default path, `is_made_up`, is not a regular file.
        """
        path = Path(path)
        if not _is_replaceable(kind, path, is_made_up):
            return path
        staged = self._open(kind, path, only_appends=only_appends, is_made_up=is_made_up)
        self._staged.append(staged)
        return staged.part

    @contextmanager
    def writing(self, path: Path, kind: str, *, is_made_up: bool = False) -> Iterator[Path]:
        """Yield where to write a file; an `OSError` meanwhile is raised as a `SinkError` with path
        and remedy.
        """
        try:
            yield self.stage(path, kind=kind, is_made_up=is_made_up)
        except OSError as error:
            raise unwritable(_words(kind), path, error) from error

    def write(self, path: Path, content: bytes, kind: str, *, is_made_up: bool = False) -> None:
        """Write a file; raises `SinkError` if that is not possible."""
        with self.writing(path, kind, is_made_up=is_made_up) as place:
            place.write_bytes(content)

    def make_folder(self, path: Path, *, parents: bool = False, is_made_up: bool = False) -> None:
        """Make a folder, which may be there already, and remove it again if the files are
        abandoned.

        `parents` makes those above it too. Raises `SinkError` if that is not possible.
        """
        missing = [folder for folder in (path, *path.parents) if not folder.exists()]
        if is_made_up and path.is_symlink():
            raise planted("the folder", path, "a link")
        try:
            path.mkdir(parents=parents, exist_ok=True)
        except FileExistsError as error:
            raise SinkError(f"the folder {path} is a file; give the path of a folder") from error
        except OSError as error:
            raise unwritable("the folder", path, error) from error
        self._made += missing

    @property
    def parts(self) -> Sequence[Path]:
        """The temporary files, without that of the manifest."""
        return tuple(staged.part for staged in self._staged)

    def commit(self, manifest: Mapping[str, Any]) -> Mapping[str, Any]:
        """Put all files in place and return the manifest with the SHA-256 of each; raise
        `SinkError` if that fails.

        If it fails after the manifest was written, the temporary files stay, and what next reads or
        writes them puts them in place; before, they are removed.
        """
        is_recorded = False
        try:
            document = {**manifest, FILES_KEY: [self._described(staged) for staged in self._staged]}
            _sync_folders(self._all(), self._made)
            self._write_manifest(document)
            is_recorded = self._record is not None
            _rename(self._staged, is_recorded=is_recorded)
            if (
                self._record is not None and self._is_kept
            ):  # last on the disk too, which may order nothing
                _rename([self._record], is_recorded=True)
            if self._record is not None and not self._is_kept:
                with suppress(OSError):
                    self._record.part.unlink()
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
        self._staged = []
        self._record = None

    def abandon(self) -> None:
        """Remove the temporary files; the files of an earlier run are as they were."""
        for staged in self._all():
            with suppress(OSError):
                if is_file_at(staged.descriptor, staged.part):
                    staged.part.unlink()
        for folder in self._made:
            with suppress(OSError):
                folder.rmdir()
        self.keep()

    def _all(self) -> list[_Staged]:
        return [*self._staged, *([self._record] if self._record else [])]

    def _open(self, kind: str, path: Path, *, only_appends: bool, is_made_up: bool) -> _Staged:
        target = (
            Path(os.path.realpath(path.parent), path.name)
            if is_made_up
            else Path(os.path.realpath(path))
        )
        temporary = target.with_name(target.name + TEMPORARY)
        try:
            descriptor = locked(temporary, path)
            with ExitStack() as closing:
                closing.callback(os.close, descriptor)
                os.ftruncate(descriptor, 0)
                keep_mode(descriptor, target)
                growing = GrowingDigest(temporary) if only_appends else None
                closing.pop_all()
        except OSError as error:
            raise unwritable(_words(kind), path, error) from error
        return _Staged(kind, path, target, temporary, descriptor, growing)

    def _described(self, staged: _Staged) -> Mapping[str, Any]:
        """Return the entry of a file in the manifest, once its content is on disk."""
        _require_in_place(staged)
        try:
            os.fsync(staged.descriptor)
            size = os.fstat(staged.descriptor).st_size
            sha256 = staged.growing.result(size) if staged.growing else file_digest(staged.part)
        except OSError as error:
            raise unwritable(_words(staged.kind), staged.path, error) from error
        folder = Path.cwd() if self._record is None else self._record.target.parent
        name = Path(os.path.relpath(staged.target, folder)).as_posix()
        return {"kind": staged.kind, "name": name, "bytes": size, "sha256": sha256}

    def _write_manifest(self, document: Mapping[str, Any]) -> None:
        if self._manifest is None:
            return
        text = (json.dumps(document, indent=2) + "\n").encode()
        try:
            if self._record is None:  # no regular file
                self._manifest.write_bytes(text)
                return
            _require_in_place(self._record)
            write_all(self._record.descriptor, text)
            os.fsync(self._record.descriptor)
        except OSError as error:
            raise unwritable("the manifest", self._manifest, error) from error


def _require_in_place(staged: _Staged) -> None:
    """Raise `SinkError` if the temporary file of a path is no longer the one that was opened."""
    if not is_file_at(staged.descriptor, staged.part):
        words = f"another process removed or replaced {staged.part.name} while it was written"
        raise SinkError(f"{_words(staged.kind)} {staged.path}: {words}; run again")


def finish_interrupted(manifest: Path) -> bool:
    """Put the files in place of a process that was killed while it did so; return whether there
    were any.

    Nothing is done while another process holds the files, or if one of them is not what the
    manifest says.
    """
    target = Path(os.path.realpath(manifest))
    record = target.with_name(target.name + TEMPORARY)
    if not record.is_file():
        return False
    with (
        suppress(OSError, SinkError, ValueError, KeyError, TypeError, RecursionError),
        held(record) as is_held,
    ):
        if not is_held:
            return False
        document = json.loads(record.read_bytes())
        entries = [(target.parent / entry["name"], entry) for entry in document[FILES_KEY]]
        moves = [path for path, entry in entries if not _is_there(path, entry)]
        for path in moves:
            path.with_name(path.name + TEMPORARY).replace(path)
        for folder in {
            path.parent for path, _entry in entries
        }:  # what was moved before it was interrupted too
            sync_path(folder)
        record.replace(target) if set(document) != {FILES_KEY} else record.unlink()
        sync_path(target.parent)
        return True
    return False


def _is_there(path: Path, entry: Mapping[str, Any]) -> bool:
    """Return whether a file is in place, False if it is under its temporary name; `ValueError` if
    it is neither.
    """
    temporary = path.with_name(path.name + TEMPORARY)
    for place in (temporary, path):
        is_whole = (
            place.is_file()
            and place.stat().st_size == entry["bytes"]
            and file_digest(place) == entry["sha256"]
        )
        if is_whole:
            return place == path
    raise ValueError(entry["name"])


def _rename(files: Sequence[_Staged], *, is_recorded: bool) -> None:
    """Rename temporary files in order, and make that last."""
    for staged in files:
        try:
            staged.part.replace(staged.target)
        except OSError as error:
            words = (
                f"{_words(staged.kind)} {staged.path} cannot be put in place: {reason_of(error)}"
            )
            way = (
                f"; all are whole under temporary names ({staged.part.name}), and the next command"
                f" finishes that"
            )
            raise SinkError(f"{words}{way if is_recorded else ''}") from error
    try:
        _sync_folders(files)
    except SinkError as error:
        raise SinkError(
            f"{error}; the files are in place, but a power cut may still undo that"
        ) from error


def _words(kind: str) -> str:
    return {"events": "jsonl:", "manifest": "the manifest"}.get(kind, f"the {kind} file")


def _is_replaceable(kind: str, path: Path, is_made_up: bool) -> bool:
    """Return whether a path is a regular file, or nothing yet; `SinkError` for anything else if
    opir made its name up.

    A folder is left to whoever opens it.
    """
    try:
        with suppress(OSError):
            mode = path.lstat().st_mode
            if is_made_up and not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                raise planted(
                    _words(kind), path, "a link" if stat.S_ISLNK(mode) else "a device or a pipe"
                )
        os.fsencode(path)
        return bool(path.name) and "\0" not in str(path) and (path.is_file() or not path.exists())
    except ValueError:  # half a surrogate pair: no path
        return False


def _sync_folders(files: Sequence[_Staged], folders: Sequence[Path] = ()) -> None:
    """Make the names of files, and of folders that were made, last."""
    for folder in {
        *(staged.target.parent for staged in files),
        *(made_folder.parent for made_folder in folders),
    }:
        try:
            sync_path(folder)
        except OSError as error:
            raise unwritable("the folder", folder, error) from error
