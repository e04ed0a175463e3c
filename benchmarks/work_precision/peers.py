"""Peers of the tracking benchmarks: those that are not installed are left out, and named."""

import sys
from collections.abc import Iterable, Mapping
from importlib.util import find_spec

#: How names of lines begin, and the module they need.
MODULES = {"Stone Soup": "stonesoup", "FilterPy": "filterpy"}


def is_installed(name: str) -> bool:
    """Return whether a line of a table can be measured: opir's always, a peer's where it is
    installed.
    """
    return all(
        find_spec(module) is not None for peer, module in MODULES.items() if name.startswith(peer)
    )


def installed(names: Iterable[str]) -> list[str]:
    """Return the names without those of missing peers, which are named on standard error."""
    given = list(names)
    for peer in absent(name for name in given if is_installed(name)):
        if any(name.startswith(peer) for name in given):
            print(
                f"{peer}: left out, not installed (the extra `benchmarks` brings it)",
                file=sys.stderr,
            )
    return [name for name in given if is_installed(name)]


def absent(names: Iterable[str]) -> list[str]:
    """Return the peers of which no line is among these."""
    given = list(names)
    return [peer for peer in MODULES if not any(name.startswith(peer) for name in given)]


def left_out(rows: Iterable[Mapping[str, str]]) -> str:
    """Return a sentence for a page about the peers that its rows are without, empty if they have
    all.
    """
    missing = absent(row["tracker"] for row in rows)
    return f"\nLeft out, because not installed: {' and '.join(missing)}.\n" if missing else ""


def times_faster(reference: float | None, value: float, digits: int) -> str:
    """Return the ratio of a peer's time to another, a dash without the peer."""
    return "–" if reference is None else f"{reference / value:.{digits}f}"
