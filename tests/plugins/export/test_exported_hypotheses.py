"""Exports of tracks show what they may be, how they ended, and what their impact regions
presume.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from attrs import evolve
from exported_runs import SCENE, exported
from opir_testing import stub_estimates, stub_regions

import opir_core

OVER = stub_regions(
    9.0, 167.7, 60.0, condition="burn over", probability=0.75, effective_samples=500.0
)
AGAIN = stub_regions(9.0, 167.7, 400.0, condition="relights", probability=0.125)


@pytest.fixture(scope="module")
def run() -> opir_core.Run:
    """A short run, with one track of our own that weighs hypotheses and one that does not."""
    plain = opir_core.simulate(
        opir_core.load_scene(SCENE, overrides=["duration_s=66", "tracker=none", "outputs=[]"])
    )
    names = plain.plan.hypothesis_names
    chances = np.full((2, len(names)), np.nan)
    chances[0] = 0.0
    chances[0, [names.index("ICBM"), names.index("none of these")]] = 0.75, 0.25
    impact = np.radians([9.0, 167.7, 0.0])
    tracks = stub_estimates(
        2,
        plain.plan.hypotheses,
        track=[0, 1],
        impact=impact,
        hypothesis_probability=chances,
        impact_regions=[(*OVER, *AGAIN), ()],
        end=[1, 0],
    )
    return evolve(plain, tracks=tracks)


def test_the_table_of_tracks_has_a_column_for_each_hypothesis(run: opir_core.Run) -> None:
    table = run.tables()["tracks"]
    shares = {
        name: table[f"hypothesis_{name.replace(' ', '_')}"].to_pylist()
        for name in run.plan.hypothesis_names
    }
    assert (shares["ICBM"], shares["none of these"], shares["noise"]) == (
        [0.75, None],
        [0.25, None],
        [0.0, None],
    )
    assert [table[f"probability_{name}"].to_pylist() for name in ("launch", "missile", "orbit")] == [
        [0.75, None], [0.75, None], [0.0, None],
    ]  # fmt: skip
    assert table["end"].to_pylist() == ["impact", None]
    regions = run.tables()["regions"]
    assert regions["condition"].to_pylist() == ["burn over"] * 3 + ["relights"] * 3
    assert regions["probability"].to_pylist() == [0.75] * 3 + [0.125] * 3
    assert regions["effective_samples"].to_pylist() == [500.0] * 3 + [None] * 3


def test_without_hypotheses_there_are_no_columns_of_them(run: opir_core.Run) -> None:
    table = evolve(run, tracks=stub_estimates(1)).tables()["tracks"]
    assert not [name for name in table.column_names if name.startswith("hypothesis_")]
    assert table["probability_launch"].to_pylist() == table["end"].to_pylist() == [None]


def test_maps_say_what_regions_presume(run: opir_core.Run, tmp_path: Path) -> None:
    features = json.loads(
        exported(run, "geojson", tmp_path / "run.geojson")[0].read_text(encoding="utf-8")
    )["features"]
    regions = [
        feature["properties"]
        for feature in features
        if feature["properties"]["kind"] == "impact region"
    ]
    assert [(feature["condition"], feature["probability"], feature["effective_samples"]) for feature in regions] == [
        *[("burn over", 0.75, 500.0)] * 3, *[("relights", 0.125, None)] * 3,
    ]  # fmt: skip
    text = exported(run, "kml", tmp_path / "run.kml")[0].read_text(encoding="utf-8")
    assert "<name>Track 0: impact if the burn is over (0.75), 95 %</name>" in text
    assert "<name>Track 0: impact if it relights (0.12), 95 %</name>" in text
    packets: Any = json.loads(
        exported(run, "czml", tmp_path / "run.czml")[0].read_text(encoding="utf-8")
    )
    ids = [packet["id"] for packet in packets]
    assert len(set(ids)) == len(ids)
    assert {"prediction/0/0/burn over/0.95/0", "prediction/0/0/relights/0.95/0"} <= set(ids)
