"""Lists of numbers on the command line, with commas between."""

import argparse
from collections.abc import Callable
from typing import Any


def numbers_of(text: str, kind: Callable[[str], Any] = float) -> tuple[Any, ...]:
    """Return the numbers of a list; raises `ArgumentTypeError` for other texts."""
    try:
        return tuple(kind(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no list of numbers with commas between"
        ) from None
