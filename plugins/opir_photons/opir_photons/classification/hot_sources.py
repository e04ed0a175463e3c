"""Kinds of hot sources other than launches, from `opir_photons/data/hot_sources.json`."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from opir_photons.radiometry.propellants import log_sigma

_TABLE = Path(__file__).parents[1] / "data" / "hot_sources.json"


class SourceKind(NamedTuple):
    """A kind of hot source other than launches: a grey body; `area_m2` is the median of emissivity
    times area.

    It shines for `shining_s` on average. `group` is the group of its hypothesis.
    """

    name: str
    group: str
    coldest_k: float
    hottest_k: float
    area_m2: float
    area_log_sigma: float
    lowest_m: float
    highest_m: float
    shining_s: float


def _kind(row: Mapping[str, Any]) -> SourceKind:
    coldest_k, hottest_k = row["temperature_k"]
    lowest_m, highest_m = row["height_m"]
    return SourceKind(
        name=row["name"],
        group=row["group"],
        coldest_k=coldest_k,
        hottest_k=hottest_k,
        area_m2=row["area_m2"],
        area_log_sigma=log_sigma(row["spread"]),
        lowest_m=lowest_m,
        highest_m=highest_m,
        shining_s=row["shining_s"],
    )


KINDS = tuple(_kind(row) for row in json.loads(_TABLE.read_text(encoding="utf-8"))["kinds"])
