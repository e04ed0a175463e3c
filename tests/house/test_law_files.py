"""Parameters of laws stand in data files, with a unit, a reason and a source each."""

import json
import re
from pathlib import Path

import pytest
from repository import ROOT

FILES = sorted((ROOT / "plugins").glob("*/opir_*/**/laws/*.json"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_parameter_has_a_reason_and_is_used(path: Path) -> None:
    law = json.loads(path.read_text(encoding="utf-8"))
    code = "".join(module.read_text(encoding="utf-8") for module in path.parents[1].glob("*.py"))
    for name, entry in law.items():
        assert set(entry) == {"value", "unit", "reason", "source"}, name
        assert all(entry[key] for key in ("unit", "reason", "source")), name
        assert re.search(rf"\.{name}\b", code), name


def test_there_are_laws() -> None:
    assert {"descent", "flight", "regions", "registration"} <= {path.stem for path in FILES}
