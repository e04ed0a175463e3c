"""Files of one JSON object a line."""

import json
from pathlib import Path
from typing import Any


def json_lines(path: Path) -> list[Any]:
    """Return what the lines of a file hold."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
