"""Results of a benchmark as a CSV file beside its page: facts about the run in the first lines,
then the rows.

A fact is a line `# name: value`; rows are those of a NamedTuple, one column a field. `--from-csv`
of the benchmarks reads these files, so that a page and its plots can be drawn again without a run.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, get_type_hints

Row = TypeVar("Row", bound=NamedTuple)


def write_csv(path: Path, rows: Sequence[Any], facts: Mapping[str, object] | None = None) -> None:
    """Write rows of one NamedTuple, floats with the digits they have, and facts about the run above
    them.
    """
    text = io.StringIO()
    for name, value in (facts or {}).items():
        text.write(f"# {name}: {value}\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows[0]._fields)
    writer.writerows(
        [f"{value:.6g}" if isinstance(value, float) else value for value in row] for row in rows
    )
    path.write_text(text.getvalue(), encoding="utf-8")


def read_csv(path: Path, kind: type[Row]) -> tuple[list[Row], dict[str, str]]:
    """Return the rows of a file and the facts above them; `kind` says which type each column
    has.
    """
    lines = path.read_text(encoding="utf-8").splitlines()
    facts = dict(line.removeprefix("# ").split(": ", 1) for line in lines if line.startswith("# "))
    types = get_type_hints(kind)
    table = csv.DictReader(line for line in lines if not line.startswith("# "))
    return [
        kind(**{name: types[name](value) for name, value in row.items()}) for row in table
    ], facts
