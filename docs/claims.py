"""The page `reference/claims.md` from `claims.json`: what opir claims, and what each claim was held
against.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

CLAIMS = Path(__file__).with_name("claims.json")

_PAGE = """# Ledger of claims

*Which figures were held against something outside of opir?* Of {total} claims {validated} are VALIDATED ({share} %).
Generated from `docs/claims.json` by `python docs/generate.py`.

- **VALIDATED**: a test in `tests/against` compares opir with an oracle that shares no code with it: another library,
  published data, or public figures.
- **MODELLED**: follows from stated physics or published specifications; nothing outside was compared in a test.
- **NOTIONAL**: made up; plausible, adjustable, and no real system's.

{tables}

Verdicts hold for defaults. What each part leaves out is on the page
[What is left out](../explanation/what-is-left-out.md).
"""

_HEAD = "| claim | figure | status | held against, or why not |\n|---|---|---|---|"

#: The kinds of oracle, by the first word of a claim's `oracle`, as the page has them.
_ORACLES = {
    "import": "{}",
    "data": "`tests/data/{}`",
    "support": "`{}`",
    "constants": "public figures",
}


def claims() -> Sequence[Mapping[str, str]]:
    """Return the claims: area, claim, figure and status; test and oracle of validated ones, else
    why they are not.
    """
    rows: Sequence[Mapping[str, str]] = json.loads(CLAIMS.read_text(encoding="utf-8"))
    return rows


def claims_page() -> str:
    """Return the page, Markdown: a table for each area."""
    rows = claims()
    validated = sum(row["status"] == "VALIDATED" for row in rows)
    areas = dict.fromkeys(row["area"] for row in rows)
    tables = [
        "\n".join([f"## {area}", "", _HEAD, *(_line(row) for row in rows if row["area"] == area)])
        for area in areas
    ]
    share = 100 * validated // len(rows)
    return _PAGE.format(
        total=len(rows), validated=validated, share=share, tables="\n\n".join(tables)
    )


def _line(row: Mapping[str, str]) -> str:
    return f"| {row['claim']} | {row['figure']} | {row['status']} | {_held(row)} |"


def _held(row: Mapping[str, str]) -> str:
    if row["status"] != "VALIDATED":
        return row["why"]
    kind, _, name = row["oracle"].partition(" ")
    file, _, test = row["test"].partition("::")
    return f"{_ORACLES[kind].format(name)}: `{file.removesuffix('.py')}`, `{test}`"
