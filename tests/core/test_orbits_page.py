"""The page of orbits: its scene blocks are read as they stand, and it names every key with its default."""

import re
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_type_hints

import pytest
from attrs import NOTHING, Factory, fields, frozen, has

from opir_core.orbits import OrbitConfig
from opir_core.scene.fields import nested
from opir_core.scene.reading.strict_yaml import node_of_yaml
from opir_core.scene.reading.structuring import class_reader

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "orbits.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```yaml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@frozen(kw_only=True)
class Carrier:
    orbit: OrbitConfig = nested(help="where it flies")


def kinds() -> dict[str, Any]:
    """Return the configuration class of each kind of orbit, None for a kind that has none."""
    hints = get_type_hints(OrbitConfig)
    inner = {name: get_args(hint)[0] if isinstance(hint, UnionType) else hint for name, hint in hints.items()}
    return {name: kind if has(kind) else None for name, kind in inner.items()}


def test_every_kind_has_a_row_and_a_block():
    rows = re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)
    assert rows == list(kinds())
    shown = {name for block in BLOCKS for name in re.findall(r"\w+(?=:)", block)}
    assert set(kinds()) <= shown


@pytest.mark.parametrize("block", BLOCKS)
def test_blocks_are_read(block):
    assert class_reader(Carrier)(node_of_yaml(block)).orbit is not None


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name, kind in kinds().items() if kind is not None])
def test_every_key_is_named_and_its_default_with_it(name, kind):
    keys = {attribute.name: attribute.default for attribute in fields(kind)}
    text = "\n".join(block for block in BLOCKS if "tundra" in block or f"{name}:" in block)
    for key, default in keys.items():
        assert re.search(rf"\b{key}\b", text), key
        if default is NOTHING or default is None or isinstance(default, Factory):
            continue
        line = next(line for line in text.splitlines() if re.search(rf"\b{key}:", line) and "#" in line)
        told = f"default {shown(default)}"
        assert re.search(rf"{re.escape(told)}\b", line) or f"{name} {default}" in line or "the default" in line, line


def shown(default: Any) -> str:
    """Return a default with four decimals at most, as the page has it."""
    return f"{default:.4f}".rstrip("0").rstrip(".") if isinstance(default, float) else str(default)
