"""The lines of a tracks file as a program without opir completes them."""

import json
from pathlib import Path
from typing import Any


def whole_records(path: Path) -> list[dict[str, Any]]:
    """Return the records of a file, each with what its line leaves out."""
    latest = dict[int, dict[str, Any]]()
    records = []
    for line in path.read_text(encoding="utf-8").splitlines():
        changes = json.loads(line)
        before = latest.get(changes["track_id"], {}) if "since_s" in changes else {}
        latest[changes["track_id"]] = {**before, **changes}
        records.append(latest[changes["track_id"]])
    return records
