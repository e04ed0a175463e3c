"""`opir spool check` reports the whole batches of a spool, `opir spool salvage` makes a new one of
them.
"""

import argparse
import json
import sys
from typing import Any

from attrs import asdict

from opir_core.output import SpoolState, salvage, spool_state

_DAMAGED = 5


def spool_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what to do, and the path."""
    parser.add_argument(
        "action", choices=("check", "salvage"), help="tell what is whole, or make a new spool of it"
    )
    parser.add_argument(
        "path", metavar="PATH", help="the spool, as in `spool: {path: PATH}`; no process may use it"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")


def spool(arguments: argparse.Namespace) -> int:
    """Check or salvage a spool; 5 if it is damaged and stays so."""
    if arguments.action == "check":
        state = spool_state(arguments.path)
        _print(arguments, {"whole": state.is_whole, **asdict(state)}, _text(arguments.path, state))
        return 0 if state.is_whole else _DAMAGED
    done = salvage(arguments.path)
    if done is None:
        state = spool_state(arguments.path)
        _print(
            arguments,
            {"whole": True, **asdict(state)},
            f"{_text(arguments.path, state)}; nothing was changed",
        )
    else:
        report = {"whole": False, **asdict(done.state), "aside": str(done.aside)}
        _print(arguments, report, f"the spool {arguments.path}: {done}")
    return 0


def _text(path: str, state: SpoolState) -> str:
    head = f"the spool {path}: {state.events} events in {state.batches} batches are whole"
    if state.is_whole:
        return head
    if not state.is_readable:
        return f"{head}; the file is damaged where nothing can be read without it"
    if not state.damaged:
        return f"{head}; the file is damaged elsewhere, so it cannot be written to: salvage it"
    numbers = ", ".join(map(str, state.damaged[:10])) + (", ..." if len(state.damaged) > 10 else "")
    return (
        f"{head}; {len(state.damaged)} batches are damaged ({numbers}), with at least"
        f" {state.lost_events} events"
    )


def _print(arguments: argparse.Namespace, plain: dict[str, Any], text: str) -> None:
    sys.stdout.write((json.dumps(plain, indent=2) if arguments.json else text) + "\n")
