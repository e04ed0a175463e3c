"""Errors in the words of a user, and lists of them cut short."""

from collections.abc import Sequence

from opir_core.errors import Problem, SceneError


def refusal(path: str, words: str, source: str = "command line") -> SceneError:
    """Return the error of one problem, with its place: a flag, or the path of a setting."""
    return SceneError([Problem(path, words)], source=source)


def cut_short(lines: Sequence[str], limit: int, template: str = "and {} more") -> list[str]:
    """Return the first lines, and how many others there are."""
    more = len(lines) - limit
    return [*lines[:limit], *([template.format(more)] if more > 0 else [])]


def require_positive(flag: str, count: int, noun: str) -> None:
    """Raise `SceneError` for a number of the command line below 1."""
    if count < 1:
        raise refusal(flag, f"{count} is not a number of {noun}; give 1 or more")
