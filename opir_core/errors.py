"""Every complaint opir makes to a user: one class a cause, one exit code a class.

A message names the place (a scene path, a component and whose it is, a sink) and the way out.
"""

from collections.abc import Iterable, Sequence
from errno import ENOSPC
from functools import partial
from pathlib import Path
from typing import Any

from attrs import frozen


class OpirError(Exception):
    """The parent of all of opir's own errors; `exit_code` is what the command line returns for it."""

    exit_code = 1


@frozen
class Problem:
    """One thing wrong with a scene: where (`targets[0].launch.lat_deg`, or "" for the file) and what."""

    path: str
    message: str

    def __str__(self) -> str:
        """Return the problem as one line."""
        return f"{self.path}: {self.message}" if self.path else self.message


class SceneError(OpirError):
    """A scene that cannot be read or cannot be meant; it carries all its problems, not only the first."""

    exit_code = 2

    def __init__(self, problems: Iterable[Problem], *, source: str = "scene") -> None:
        self.problems: Sequence[Problem] = tuple(problems)
        self.source = source
        count = len(self.problems)
        head = f"{source}: {count} problem{'s' if count != 1 else ''}"
        super().__init__("\n".join([head, *(f"  {problem}" for problem in self.problems)]))

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how the error is made anew in another process."""
        return partial(SceneError, source=self.source), (self.problems,)


class PluginError(OpirError):
    """A component that is missing, claimed twice, or broken; the message says whose it is."""

    exit_code = 3


class ModelError(OpirError):
    """A model that returned what its contract forbids (a wrong shape, a probability outside [0, 1])."""

    exit_code = 4


class SinkError(OpirError):
    """An output that could not take events; the message says how many were delivered before."""

    exit_code = 5


def unwritable(what: str, path: Path, error: OSError) -> SinkError:
    """Return the complaint about a file beside the events that the system does not let be written."""
    return SinkError(f"{what} {path} cannot be written: {reason_of(error)}; {way_to_write(error, path)}")


def reason_of(error: OSError) -> str:
    """Return the system's own words for what failed, as they stand within a sentence."""
    return (error.strerror or str(error)).lower()


def way_to_write(error: OSError, path: Path) -> str:
    """Return what to do where a file cannot be opened or written."""
    if isinstance(error, FileNotFoundError):
        return f"make the folder {str(path.parent)!r} or give another path"
    if isinstance(error, IsADirectoryError):
        return "give the path of a file in it"
    return "make room, or give a path on another disk" if error.errno == ENOSPC else "give a path that may be written"


def nearest(name: str, known: Iterable[str]) -> str:
    """Return `; the nearest is 'X'`, or "" where no known name is similar. Letter case is ignored."""
    matches = nearest_names(name, known)
    return f"; the nearest is {matches[0]!r}" if matches else ""


def nearest_names(name: str, known: Iterable[str], *, most: int = 3, cutoff: float = 0.5) -> list[str]:
    """Return the known names that are most similar to a name, the best first. Letter case is ignored."""
    from difflib import get_close_matches

    spelt = {candidate.casefold(): candidate for candidate in sorted(known, reverse=True)}
    return [spelt[match] for match in get_close_matches(name.casefold(), spelt, n=most, cutoff=cutoff)]
