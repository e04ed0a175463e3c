"""The page of the tracks file documents every field, in the order in which the encoder writes
them.
"""

import re

import pytest
from repository import ROOT

from opir_core.output import schema

PAGE = (ROOT / "docs" / "reference" / "tracks.md").read_text(encoding="utf-8")
TIMESTAMPS = {"schema_version", "timestamp", "available_at", "time"}


@pytest.mark.parametrize(
    ("start", "end", "part"),
    [("## Fields", "## Points", None), ("## Points", "## Impact", "impact")],
)
def test_every_field_is_documented_in_order(start: str, end: str, part: str | None) -> None:
    document = schema("track")
    expected = (document["$defs"][part] if part else document)["properties"]
    cells = re.findall(
        r"^\| ((?:`\w+`(?:, )?)+) \|", PAGE[PAGE.index(start) : PAGE.index(end)], re.MULTILINE
    )
    documented = [name for cell in cells for name in re.findall(r"`(\w+)`", cell)]
    assert documented == [name for name in expected if name not in TIMESTAMPS]
