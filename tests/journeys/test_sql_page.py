"""The queries of the page on SQL run in the folder of a study, and count what its rows say."""

import re

import duckdb
import pytest
from opir_studies import Study, sweep
from repository import ROOT
from study_scene import SCENE

PAGE = ROOT / "docs" / "how-to" / "repeat-a-study.md"
QUERIES = re.findall(
    r"^```sql\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    sensors = [{"model": "DSP", "id": "D", "orbital_slot_deg": slot} for slot in (-135.0, 45.0)]
    study = Study(
        scene={**SCENE, "tracker": "kepler-arc", "duration_s": 30.0},
        vary={"sensors": {"named": {"near": [sensors[0]], "far": [sensors[1]]}}},
        conditions={"epoch": {"named": {"day": "2026-04-01T20:00:00Z", "night": SCENE["epoch"]}}},
        runs=2,
        metrics=("latency", "warning_time"),
        requirements=("region_km2 < 1000 within 90 s in 90 % of launches",),
        executor="serial",
    )
    return sweep(study, tmp_path_factory.mktemp("sql") / "study")


def test_the_page_has_queries():
    assert len(QUERIES) >= 5


@pytest.mark.parametrize("query", QUERIES)
def test_queries_run(result, query, monkeypatch):
    monkeypatch.chdir(result.folder)
    assert duckdb.sql(query).columns


def test_shares_and_missed_launches_are_those_of_the_rows(result, monkeypatch):
    monkeypatch.chdir(result.folder)
    rows = result.launches.to_pylist()
    shares = {row[:2]: row[3:] for row in duckdb.sql(QUERIES[0]).fetchall()}
    for (sensors, epoch), (count, share) in shares.items():
        of_design = [r for r in rows if (r["sensors"], r["epoch"]) == (sensors, epoch)]
        assert count == len(of_design)
        assert share == sum(r["reported_s"] <= 60.0 for r in of_design) / count
    assert {share for (sensors, _), (_, share) in shares.items() if sensors == "far"} == {0.0}
    missed = [query for query in QUERIES if "looked_s <" in query]
    assert duckdb.sql(missed[0]).fetchall() == []
