"""Published tables, as the package's data files hold them: units, leap seconds, nutation, names."""

import json
from functools import cache
from pathlib import Path
from typing import Any


@cache
def published(name: str) -> Any:
    """Return the content of the data file of a name."""
    path = Path(__file__).parent / "data" / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8"))
