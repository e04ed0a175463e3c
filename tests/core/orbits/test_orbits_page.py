"""The page of orbits: its scene blocks are read as they stand, and it names every key with its
default.
"""

import math
import re
from types import UnionType
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from attrs import NOTHING, Factory, fields, frozen, has
from repository import ROOT

from opir_core.orbits import (
    MolniyaConfig,
    OrbitConfig,
    Sgp4Motion,
    SlotConfig,
    orbit_of,
    satellite_of_tle,
)
from opir_core.plugin import nested
from opir_core.reading import class_reader, node_of_yaml

PAGE = (ROOT / "docs" / "reference" / "orbits.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```yaml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@frozen(kw_only=True)
class Carrier:
    orbit: OrbitConfig = nested(help="where it flies")


def kinds() -> dict[str, Any]:
    """Return the configuration class of each kind of orbit, None for a kind that has none."""
    hints = get_type_hints(OrbitConfig)
    inner = {
        name: get_args(hint)[0] if isinstance(hint, UnionType) else hint
        for name, hint in hints.items()
    }
    return {name: kind if has(kind) else None for name, kind in inner.items()}


def test_every_kind_has_a_row_and_a_block():
    rows = re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)
    assert rows == list(kinds())
    shown = {name for block in BLOCKS for name in re.findall(r"\w+(?=:)", block)}
    assert set(kinds()) <= shown


@pytest.mark.parametrize("block", BLOCKS)
def test_blocks_are_read(block):
    assert class_reader(Carrier)(node_of_yaml(block)).orbit is not None


@pytest.mark.parametrize(
    ("name", "kind"), [(name, kind) for name, kind in kinds().items() if kind is not None]
)
def test_every_key_is_named_and_its_default_with_it(name, kind):
    keys = {attribute.name: attribute.default for attribute in fields(kind)}
    text = "\n".join(block for block in BLOCKS if "tundra" in block or f"{name}:" in block)
    for key, default in keys.items():
        assert re.search(rf"\b{key}\b", text), key
        if default is NOTHING or default is None or isinstance(default, Factory):
            continue
        line = next(
            line for line in text.splitlines() if re.search(rf"\b{key}:", line) and "#" in line
        )
        reported = f"default {shown(default)}"
        assert (
            re.search(rf"{re.escape(reported)}\b", line)
            or f"{name} {default}" in line
            or "the default" in line
        ), line


def shown(default: Any) -> str:
    """Return a default with four decimals at most, as the page has it."""
    return f"{default:.4f}".rstrip("0").rstrip(".") if isinstance(default, float) else str(default)


def test_an_inclined_slot_draws_the_figure_eight_of_the_page():
    inclination = np.radians(5.0)
    day_s = np.linspace(0.0, 86164.1, 5001)
    slot = OrbitConfig(slot=SlotConfig(lon_deg=-75.0, inclination_deg=5.0))
    x, y, z = orbit_of(slot, 0).position_ecef_m(day_s).T
    latitude = np.arctan2(z, np.hypot(x, y))
    offset = np.arctan2(y, x) - np.radians(-75.0)
    assert abs(latitude.max() - inclination) < 1e-6
    assert abs(offset.max() - np.arcsin(np.tan(inclination / 2) ** 2)) < 1e-8


def test_a_molniya_satellite_is_north_for_the_share_of_the_page():
    orbit = orbit_of(OrbitConfig(molniya=MolniyaConfig(apogee_lon_deg=90.0)), 0)
    share = (orbit.position_ecef_m(np.arange(86164) + 0.5)[:, 2] > 0).mean()
    eccentric = math.acos(
        0.74
    )  # the true anomaly is 90 deg; Kepler's equation gives the time from there
    assert abs(share - (1 - (eccentric - 0.74 * math.sin(eccentric)) / math.pi)) < 1e-4
    assert f"spends {share:.0%}".replace("%", " %") in " ".join(PAGE.split())


def test_the_page_s_element_set_is_at_the_distance_of_sgp4():
    (lines,) = [
        tuple(re.findall(r"^    - (.*)$", block, re.MULTILINE))
        for block in BLOCKS
        if "tle:" in block
    ]
    epoch_us = int(np.datetime64("2008-09-20T12:30:00", "us").astype(np.int64))
    teme_m = Sgp4Motion(satellite_of_tle(lines), epoch_us).position_teme_m(np.array([0.0]))
    ecef_m = orbit_of(OrbitConfig(tle=lines), epoch_us).position_ecef_m(np.array([0.0]))
    assert abs(np.linalg.norm(teme_m) - np.linalg.norm(ecef_m)) < 1e-3
