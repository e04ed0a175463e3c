"""The constants of laws, from files of data with their units, reasons and sources."""

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

#: The folder of data of this package; its README lists the files.
DATA = Path(__file__).parent / "data"


@cache
def law(name: str) -> Mapping[str, Any]:
    """Return the constants of a law by the name of its file, without .json."""
    return MappingProxyType(json.loads((DATA / f"{name}.json").read_text(encoding="utf-8")))
