"""`opir claims`: the ledger of opir's claims, and what each was held against."""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill, indent

STATUSES = ("VALIDATED", "MODELLED", "NOTIONAL")

LEDGER = Path(__file__).parents[1] / "data" / "claims.json"

#: What holds a validated claim, by the first word of its `oracle`.
ORACLES = {
    "data": "published figures",
    "constants": "published figures",
    "import": "another library",
    "script": "an own script",
    "support": "an own script",
}


def claims_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `opir claims`."""
    parser.add_argument(
        "words", nargs="*", metavar="WORD", help="only claims that contain all of these words"
    )
    parser.add_argument(
        "--status", type=str.upper, choices=STATUSES, help="only claims of this status"
    )
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
        rows.sort(key=lambda row: STATUSES.index(row["status"]))
        text = "\n\n".join([*map(_text, rows), fill(summary(ledger()), 100)])
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
    """Return how many claims have which status, and what holds those that are validated."""
    count = Counter(row["status"] for row in rows)
    count.update(_oracle(row) for row in rows if "oracle" in row)
    held = ", ".join(f"{count[name]} by {name}" for name in dict.fromkeys(ORACLES.values()))
    seen = sum("built_on" in row for row in rows)
    return (
        f"{len(rows)} claims: {count['VALIDATED']} VALIDATED ({held}), {count['MODELLED']} MODELLED,"
        f" {count['NOTIONAL']} NOTIONAL; {seen} figures were seen while opir was built (*)."
    )


def _oracle(row: Mapping[str, str]) -> str:
    return ORACLES[row["oracle"].partition(" ")[0]]


def _is_selected(row: Mapping[str, str], arguments: argparse.Namespace) -> bool:
    text = " ".join(row.values()).lower()
    return arguments.status in (None, row["status"]) and all(
        word.lower() in text for word in arguments.words
    )


def _text(row: Mapping[str, str]) -> str:
    """Return the lines of a claim, of at most 100 columns."""
    mark = " *" if "built_on" in row else ""
    published = f"; published: {row['published']}" if "published" in row else ""
    reason = row.get("why") or row.get("source") or f"{_oracle(row)}: {row['test'].split('.')[0]}"
    claim = f"{row['status']}{mark}  {row['claim']}: {row['figure']}{published}"
    return f"{fill(claim, 100, subsequent_indent='    ')}\n{indent(fill(reason, 96), '    ')}"
