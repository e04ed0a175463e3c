"""The errors that opir reports to users: one class per cause, one exit code per class.

A message names the place (a scene path, a component and its owner, a sink) and the remedy.
"""

from collections.abc import Iterable, Sequence
from errno import ENOSPC
from functools import partial
from pathlib import Path
from typing import Any

from attrs import frozen

__all__ = [
    "BAD_DATA",
    "ModelError",
    "OpirError",
    "PluginError",
    "Problem",
    "SceneError",
    "SinkError",
    "install_command",
    "kind_of",
    "nearest",
    "nearest_names",
    "number_of",
    "reason_of",
    "unwritable",
    "way_to_write",
    "with_article",
]


def install_command(distribution: str, extra: str = "") -> str:
    """Return how to install a distribution of this project, with an extra if it needs one, and those
    that it needs.

    None of them is on a package index: the command works in a clone, and the words say so.
    """
    *needed, folder = map(_folder, [*_needed(distribution), distribution])
    place = f"'{folder}[{extra}]'" if extra else folder
    return f"from a clone of opir: python -m pip install {' '.join([*needed, place])}"


def _folder(distribution: str) -> str:
    return "." if distribution == "opir-core" else f"./plugins/{distribution.replace('-', '_')}"


def _needed(distribution: str) -> list[str]:
    """Return the distributions of this project that a plugin needs besides the core."""
    text = Path(__file__).with_name("data").joinpath("packages.txt").read_text("utf-8")
    rows = (line.split() for line in text.splitlines())
    words = next((words for name, *words in rows if name == distribution), [])
    return [word.removeprefix("+") for word in words if word.startswith("+")]


#: What Python, numpy and pyarrow raise at data of another shape than the reader of a file expects;
#: NotImplementedError is pyarrow's, for types of columns that it does not convert.
BAD_DATA = (
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    ArithmeticError,
    NotImplementedError,
    RecursionError,
)


class OpirError(Exception):
    """The base class of opir's own errors; `exit_code` is the exit code of the command line.

    Characters that a terminal would obey, of names in files, are escaped in the message.
    """

    exit_code = 1

    def __init__(self, message: str = "") -> None:
        super().__init__(
            "".join(
                char if char.isprintable() or char == "\n" else repr(char)[1:-1] for char in message
            )
        )


@frozen
class Problem:
    """One error in a scene: its path (`targets[0].launch.lat_deg`, "" for the file) and message."""

    path: str
    message: str

    def __str__(self) -> str:
        """Return the problem as one line."""
        return f"{self.path}: {self.message}" if self.path else self.message


class SceneError(OpirError):
    """An invalid scene, with all its problems."""

    exit_code = 2

    def __init__(self, problems: Iterable[Problem], *, source: str = "scene") -> None:
        self.problems: Sequence[Problem] = tuple(problems)
        self.source = source
        count = len(self.problems)
        head = f"{source}: {count} problem{'s' if count != 1 else ''}"
        super().__init__("\n".join([head, *(f"  {problem}" for problem in self.problems)]))

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how to unpickle the error in another process."""
        return partial(SceneError, source=self.source), (self.problems,)


class PluginError(OpirError):
    """A component that is missing, ambiguous or broken; the message names its owner."""

    exit_code = 3


class ModelError(OpirError):
    """A model that returned invalid values (a wrong shape, a probability outside [0, 1])."""

    exit_code = 4


class SinkError(OpirError):
    """An output that failed; the message gives the number of events delivered before."""

    exit_code = 5


def unwritable(kind: str, path: Path, error: OSError) -> SinkError:
    """Return the error of a file that cannot be written."""
    return SinkError(
        f"{kind} {path} cannot be written: {reason_of(error)}; {way_to_write(error, path)}"
    )


def reason_of(error: OSError) -> str:
    """Return the system's error text, in lower case."""
    return (error.strerror or str(error)).lower()


def way_to_write(error: OSError, path: Path) -> str:
    """Return the remedy for a file that cannot be opened or written."""
    if isinstance(error, FileNotFoundError) and path.is_symlink():
        return (
            f"it is a link to {str(path.readlink())!r}, whose folder is not there; remove it or"
            f" give another path"
        )
    if isinstance(error, FileNotFoundError):
        return f"create the folder {str(path.parent)!r} or give another path"
    if isinstance(error, IsADirectoryError):
        return "give the path of a file in it"
    return (
        "make room, or give a path on another disk"
        if error.errno == ENOSPC
        else "give a writable path"
    )


def with_article(noun: str) -> str:
    """Return a noun with its indefinite article, `an encoder`."""
    return f"{'an' if noun[:1].lower() in 'aeiou' else 'a'} {noun}"


def number_of(noun: str, count: int) -> str:
    """Return a count with its noun, `1 sensor` or `2 sensors`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def kind_of(value: object) -> str:
    """Return the type of a value in words, `a list` or `None`."""
    return "None" if value is None else with_article(type(value).__name__)


def nearest(name: str, candidates: Iterable[str]) -> str:
    """Return `; the nearest is 'X'`, or "" where no known name is similar. Letter case is
    ignored.
    """
    matches = nearest_names(name, candidates)
    return f"; the nearest is {matches[0]!r}" if matches else ""


def nearest_names(
    name: str, known: Iterable[str], *, most: int = 3, cutoff: float = 0.5
) -> list[str]:
    """Return the known names that are most similar to a name, the best first. Letter case is
    ignored.
    """
    from difflib import get_close_matches

    spelt = {candidate.casefold(): candidate for candidate in sorted(known, reverse=True)}
    return [
        spelt[match] for match in get_close_matches(name.casefold(), spelt, n=most, cutoff=cutoff)
    ]
