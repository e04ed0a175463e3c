"""Versions of the formats that opir writes, and the promise by which they are read.

A version is MAJOR.MINOR. A minor version adds optional fields, nothing else: a reader ignores
fields that it does not know, and says so once for a file of a greater minor version than its own.
It refuses a greater major version, and one that is older than it reads, by name.
"""

import re
from pathlib import Path
from typing import NamedTuple

from opir_core.errors import Problem, SceneError
from opir_core.host.registry import warn

_VERSION = re.compile(r"([0-9]{1,6})(?:\.([0-9]{1,6}))?")


class Format(NamedTuple):
    """A format that opir writes: its name, the version that is written, and the oldest major
    version that is read.
    """

    name: str
    version: str
    oldest_major: int

    @property
    def major(self) -> int:
        """The major version that is written."""
        return int(self.version.partition(".")[0])

    def refusal(self, version: object) -> str:
        """Return why a version is not read, "" if it is."""
        numbers = self._numbers(version)
        if numbers is None:
            return f"{version!r} is no version, such as {self.version}"
        if self.oldest_major <= numbers[0] <= self.major:
            return ""
        majors = range(self.oldest_major, self.major + 1)
        read = " and ".join(f"{major}.x" for major in majors)
        words = f"of {self.name} version {version}, where {read} is read: run the scene anew, or"
        if numbers[0] > self.major:
            return f"{words} read it with an opir as new as the one that wrote it"
        return f"{words} read it with the opir that wrote it"

    def note(self, version: object) -> str:
        """Return what there is to say of a version that is read, "" for nothing."""
        numbers = self._numbers(version)
        if numbers is None or numbers <= (self.major, int(self.version.partition(".")[2])):
            return ""
        words = f"of {self.name} version {version}; this opir knows {self.version}"
        return f"{words}, and ignores fields that it does not know"

    def _numbers(self, version: object) -> tuple[int, int] | None:
        match = _VERSION.fullmatch(str(version).removeprefix(f"{self.name}-"))
        return None if match is None else (int(match[1]), int(match[2] or 0))

    def require_readable(self, version: object, path: Path, place: str) -> None:
        """Raise `SceneError` if a version is not read; log what there is to say of it.

        `place` is where in the file the version stands.
        """
        refusal = self.refusal(version)
        if refusal:
            raise SceneError([Problem(place, refusal)], source=str(path))
        note = self.note(version)
        if note:
            warn(f"{path}: {note}")


class StatedVersions:
    """The versions that the lines of one file state; each is judged once."""

    def __init__(self, stated: Format, path: Path) -> None:
        self._format = stated
        self._path = path
        self._judged: set[str] = set()

    def judge(self, version: object, place: str) -> None:
        """Judge a version as `Format.require_readable` does; a line that states none is read."""
        text = "" if version is None else str(version)
        if text and text not in self._judged:
            self._format.require_readable(version, self._path, place)
            self._judged.add(text)


EVENT_FORMAT = Format("events", "2.0", oldest_major=1)
TRACK_FORMAT = Format("tracks", "2.0", oldest_major=1)
TRUTH_FORMAT = Format("truth", "1.0", oldest_major=1)
COMMAND_FORMAT = Format("commands", "1.2", oldest_major=1)
HEARTBEAT_FORMAT = Format("heartbeat", "1.0", oldest_major=1)
CHANGE_FORMAT = Format("changes", "1.1", oldest_major=1)
MANIFEST_FORMAT = Format("manifest", "2.1", oldest_major=2)
STUDY_FORMAT = Format("study", "3.0", oldest_major=3)

#: The key of the version of a file of changes.
CHANGES_KEY = "changes_version"
#: The formats of the files beside a manifest, which states their versions.
RUN_FORMATS = (EVENT_FORMAT, TRACK_FORMAT, TRUTH_FORMAT, COMMAND_FORMAT)
FORMATS = (*RUN_FORMATS, MANIFEST_FORMAT, STUDY_FORMAT)


def is_recorded(path: Path) -> bool:
    """Return whether a file has the changes of a live run: its first line begins with their
    version.
    """
    try:
        with path.open("rb") as file:
            return file.read(64).startswith(f'{{"{CHANGES_KEY}"'.encode())
    except OSError:
        return False
