"""Comparisons of contracts: rows on their own against rows together, one run's events against another's."""

import pickle
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from opir_core.testing.contracts.contract import Broken, insist

Compute = Callable[[Any], Any]


def insist_rows_stand_alone(what: str, compute: Compute, rows: int) -> None:
    """Insist that `compute(chosen)` gives for each row what it gives when all rows come at once, to the last bit."""
    everyone = np.arange(rows)
    whole = np.asarray(compute(everyone))
    insist_rows(what, whole, rows)
    choices = {
        "in reverse": everyone[::-1],
        "every third alone": everyone[::3],
        "the last alone": everyone[-1:],
        "none": everyone[:0],
    }
    for how, chosen in choices.items():
        part = np.asarray(compute(chosen))
        insist_rows(what, part, len(chosen))
        differs = ~_equal(part, whole[chosen])
        if differs.any():
            row = int(np.flatnonzero(differs)[0])
            raise Broken(
                f"{what} of row {int(chosen[row])} is {whole[chosen][row]} among all rows and {part[row]} with the rows"
                f" taken {how}",
                "Compute each row from its own columns alone: no sums, means, sorting or running state over rows, and"
                " draw random numbers for all rows that are handed in.",
            )


def insist_rows(what: str, values: Any, rows: int) -> None:
    """Insist that there is one value for each row."""
    insist(
        np.ndim(values) >= 1 and len(values) == rows,
        f"{what} has shape {np.shape(values)} for {rows} rows",
        f"Return an array of one row for each row handed in, here ({rows}, ...); none for none.",
    )


def insist_same_lines(ours: Sequence[bytes], others: Sequence[bytes], where: str, change: str) -> None:
    """Insist that two runs have the same events."""
    if list(ours) == list(others):
        return
    pairs = zip(ours, others, strict=False)
    first = next((place for place, (one, other) in enumerate(pairs) if one != other), min(len(ours), len(others)))
    told = " and ".join(_line(lines, first) for lines in (ours, others))
    raise Broken(f"{where} there are {len(others)} events instead of {len(ours)}, or others: {told}", change)


def insist_complete(part: Any, abilities: Sequence[type]) -> None:
    """Insist that a built part has all members of an optional protocol, or none of them."""
    for ability in abilities:
        members = [name for name in vars(ability) if not name.startswith("_")]
        missing = [name for name in members if not hasattr(part, name)]
        if missing and len(missing) < len(members):
            raise Broken(
                f"it has some members of {ability.__name__} and lacks {', '.join(missing)}",
                f"Implement all of opir_core.plugin.{ability.__name__}, or none of it.",
            )


def insist_pickles(part: Any) -> Any:
    """Insist that a built part can be pickled, and return its copy."""
    try:
        return pickle.loads(pickle.dumps(part))
    except Exception as error:
        raise Broken(
            f"{type(part).__name__} cannot be pickled: {error}",
            "Keep no open files, locks, lambdas or local functions in what build returns; define classes and functions"
            " at the top of a module.",
        ) from error


def _equal(one: Any, other: Any) -> Any:
    same = (one == other) | ((one != one) & (other != other))
    return same.all(axis=tuple(range(1, same.ndim)))


def _line(lines: Sequence[bytes], place: int) -> str:
    return lines[place].decode(errors="replace")[:300] if place < len(lines) else "nothing"
