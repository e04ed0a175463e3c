"""`opir claims`: the ledger of opir's claims, and what each was held against."""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from opir_core.cli import table

STATUSES = ("VALIDATED", "MODELLED", "NOTIONAL")

LEDGER = Path(__file__).parents[1] / "data" / "claims.json"

_HEAD = ("claim", "opir", "published", "status", "source, or why not")


def claims_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `opir claims`."""
    parser.add_argument(
        "words", nargs="*", metavar="WORD", help="only claims that contain all of these words"
    )
    parser.add_argument("--status", choices=STATUSES, help="only claims of this status")
    parser.add_argument("--json", action="store_true", help="print plain data")


def claims(arguments: argparse.Namespace) -> int:
    """Print the claims that the arguments select, and how many of all are validated; the exit code
    is 1 if none is selected.
    """
    rows = [row for row in ledger() if _is_selected(row, arguments)]
    if not rows:
        text = "no claim has all of these words and this status"
    elif arguments.json:
        text = json.dumps(rows, indent=2, ensure_ascii=False)
    else:
        text = f"{table(_HEAD, [_cells(row) for row in rows])}\n\n{summary(ledger())}"
    sys.stdout.write(text + "\n")
    return int(not rows)


def ledger() -> Sequence[Mapping[str, str]]:
    """Return the claims: area, claim, opir's figure and status; test and oracle of validated ones,
    else why they are not; where they are known, the published figure, its source and `built_on`,
    what of it was seen while opir was built.
    """
    rows: Sequence[Mapping[str, str]] = json.loads(LEDGER.read_text(encoding="utf-8"))
    return rows


def summary(rows: Sequence[Mapping[str, str]]) -> str:
    """Return how many claims have which status, in a sentence."""
    count = Counter(row["status"] for row in rows)
    listed = ", ".join(f"{count[status]} {status}" for status in STATUSES)
    seen = sum("built_on" in row for row in rows)
    return f"{len(rows)} claims: {listed}; {seen} of them were seen while opir was built (*)."


def _is_selected(row: Mapping[str, str], arguments: argparse.Namespace) -> bool:
    text = " ".join(row.values()).lower()
    return arguments.status in (None, row["status"]) and all(
        word.lower() in text for word in arguments.words
    )


def _cells(row: Mapping[str, str]) -> tuple[str, ...]:
    mark = " *" if "built_on" in row else ""
    reason = row.get("why") or row.get("source") or row["oracle"].partition(" ")[2] or row["oracle"]
    return row["claim"], row["figure"], row.get("published", ""), row["status"] + mark, reason
