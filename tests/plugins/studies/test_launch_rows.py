"""A study has a row per launch; shares are those that a query counts, and verdicts are right on
launches of known chance.
"""

import math

import duckdb
import numpy as np
import pytest
from attrs import evolve, frozen
from opir_studies import Study, load_study, sweep
from opir_studies.launches import base_columns
from opir_studies.planning import planned_study
from opir_studies.share_requirements import share_requirements_of
from opir_studies.shares import verdict_of
from opir_studies.sweep_command import as_text
from opir_studies.until import rounds
from repository import ROOT
from study_scene import PERIOD, SCENE

from opir_core import compile_plan, run_of_plan
from opir_core.errors import SceneError
from opir_core.reading import scene_from_mapping

CHANCE = "sensors[*].detection_probability"
TARGETS = [
    {
        "id": f"T{number}",
        "type": kind,
        "launch": {"lat_deg": latitude, "lon_deg": -120.57, "time_s": 1.0},
        "aim": aim,
    }
    for number, (latitude, kind, aim) in enumerate(
        [
            (34.73, "ICBM", {"lat_deg": 9.0, "lon_deg": 167.7}),
            (20.0, "SRBM", {"lat_deg": 17.0, "lon_deg": -120.57}),
            (10.0, "SRBM", {"lat_deg": 7.0, "lon_deg": -120.57}),
        ]
    )
]
STUDY = Study(
    scene={**SCENE, "duration_s": 4.0, "targets": TARGETS},
    study="s",
    vary={PERIOD: [1000, 3000]},
    conditions={"epoch": {"named": {"day": "2026-04-01T20:00:00Z", "night": SCENE["epoch"]}}},
    runs=6,
    metrics=("latency",),
    requirements=(
        "detected within 1.5 s in 60 % of launches",
        "detected within 2.5 s in 60 % of launches, in every condition",
    ),
    executor="serial",
)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return sweep(STUDY, tmp_path_factory.mktemp("launch") / "study")


def test_rows_are_the_launches_of_every_run(result):
    rows = result.launches.to_pylist()
    assert len(rows) == 2 * 2 * 6 * 3
    row = next(r for r in rows if r["seed"] == 103 and r["design"] == 1 and r["launch"] == "T1")
    assert (row["class"], row["site"], row["epoch"]) == ("SRBM", "20N 120.57W", "night")
    scene = {**STUDY.scene, "seed": 103, "epoch": SCENE["epoch"]}
    scene["sensors"] = [{**SCENE["sensors"][0], "scan_period_ms": 1000}]
    target = run_of_plan(compile_plan(scene_from_mapping(scene))).summary["targets"][1]
    seen = target["latency_s"], target["end_to_end_latency_s"], target["reported_type"]
    expected = (math.inf, math.inf, "none") if seen[0] is None else seen
    assert (row["detected_s"], row["reported_s"], row["reported_type"]) == expected


def test_times_are_those_of_the_summary_and_never_is_infinite():
    """A launch behind the Earth is never looked at."""
    scene = {**STUDY.scene, "targets": [TARGETS[0], {**TARGETS[1], "id": "far"}]}
    scene["targets"][1] = {
        **scene["targets"][1],
        "launch": {"lat_deg": 10.0, "lon_deg": 45.0, "time_s": 1.0},
        "aim": {"lat_deg": 7.0, "lon_deg": 45.0},
    }
    run = run_of_plan(compile_plan(scene_from_mapping(scene)))
    columns = base_columns(run)
    latency_s = run.summary["targets"][0]["latency_s"]
    assert columns["detected_s"] == [latency_s, math.inf]
    assert columns["looked_s"][0] <= latency_s
    assert columns["looked_s"][1] == math.inf
    assert columns["reported_type"][1] == "none"


@pytest.mark.parametrize("place", [0, 1])
def test_shares_are_those_that_a_query_counts(result, place):
    launches = str(result.folder / "launches.parquet")
    limit_s = [1.5, 2.5][place]
    text = STUDY.requirements[place]
    shares = [row for row in result.shares.to_pylist() if row["requirement"] == text]
    # Both designs over all, in two conditions, at three sites, of two classes.
    assert len(shares) == 2 * (1 + 2 + 3 + 2)
    for row in shares:
        condition = "" if row["condition"] == "all" else f"and epoch = '{row['condition']}'"
        part = f"and {row['by']} = '{row['value']}'" if row["by"] else ""
        ((count, share),) = duckdb.sql(
            f"select count(*), avg((detected_s <= {limit_s})::int) from '{launches}'"
            f' where "{PERIOD}" = {row[PERIOD]} {condition} {part}'
        ).fetchall()
        assert (row["launches"], row["share"]) == (count, pytest.approx(share, abs=1e-15))
        assert row["runs"] == 6
        assert row["low"] <= row["share"] <= row["high"]


def test_designs_are_compared_in_the_same_condition(result):
    runs = result.runs.to_pandas().pivot(index="replicate", columns="design", values="latency_s")
    differences = {row["design"]: row["difference"] for row in result.rows("latency_s")}
    assert differences[0] == differences[1] == 0.0
    assert differences[2] == pytest.approx((runs[2] - runs[0]).mean())
    assert differences[3] == pytest.approx((runs[3] - runs[1]).mean())


def test_the_text_has_each_verdict_and_the_worst_condition(result):
    text = as_text(result)
    assert STUDY.requirements[1] in text
    assert text.count("worst condition ") == 4
    assert "of 36 launches" in text
    assert "minus the first design in that condition" in text


def test_a_loaded_study_has_the_same_tables(result):
    loaded = load_study(result.folder)
    assert loaded.launches.equals(result.launches)
    assert loaded.shares.equals(result.shares)


def test_regions_of_a_requirement_need_no_metric(tmp_path):
    """The bound that a sentence names is a column, and inf where no region is that small."""
    scene = {**SCENE, "duration_s": 40.0, "tracker": {"model": "imm", "cadence_s": 5.0}}
    sentence = "region_km2 < 1e5 within 50 s in 90 % of launches"
    study = evolve(STUDY, scene=scene, vary={}, conditions={}, runs=2, requirements=(sentence,))
    result = sweep(study, tmp_path)
    column = result.launches["region_km2_below_100000_s"].to_pylist()
    assert len(column) == 2
    assert all(value == math.inf or 0.0 < value <= 40.0 for value in column)
    assert "region_km2_below_100000_held" in result.launches.column_names


@pytest.mark.parametrize(
    ("sentence", "column", "limit", "is_least", "in_every"),
    [
        ("detected within 30 s in 95 % of launches", "detected_s", 30.0, False, False),
        ("detected in 95 %", "detected_s", math.inf, False, False),
        ("launch_error_m < 2e3 in 90 % of launches", "launch_error_m", 2000.0, False, False),
        ("warning_before_impact_s >= 600 in 90 %", "warning_before_impact_s", 600.0, True, False),
        (
            "region_km2 < 1000 within 90 s in 90 % of launches, in every condition",
            "region_km2_below_1000_s",
            90.0,
            False,
            True,
        ),
        (
            "missile_probability > 0.9 within 60 s in 50 %",
            "missile_probability_above_0_9_s",
            60.0,
            False,
            False,
        ),
    ],
)
def test_sentences(sentence, column, limit, is_least, in_every):
    (required,) = share_requirements_of([sentence], "s")
    assert (required.column, required.limit) == (column, limit)
    assert (required.is_least, required.in_every_condition) == (is_least, in_every)


def test_sentences_of_the_page_are_read():
    text = (ROOT / "docs" / "how-to" / "require-a-share.md").read_text(encoding="utf-8")
    sentences = [
        line.split("`")[1] for line in text.splitlines() if line.startswith("| `") and "%" in line
    ]
    required = share_requirements_of(sentences, "page")
    assert len(required) == len(sentences) >= 6
    columns = [f"`{each.column}`" for each in required if not each.quantity]
    assert all(column in text for column in columns)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"requirements": ("detected soon in 90 %",)}, "is no sentence such as"),
        ({"requirements": ("detected within 3 s in 100 %",)}, "not between 0 and 100"),
        ({"requirements": ("detectd within 3 s in 90 %",)}, "the nearest is 'detected_s'"),
        ({"requirements": ("region_km2 > 10 within 3 s in 90 %",)}, "region_km2 < VALUE"),
        ({"requirements": ("region_km < 10 within 3 s in 90 %",)}, "nearest is 'region_km2'"),
        (
            {"requirements": ("detected in 9 %, in every condition",), "conditions": {}},
            "the study has no conditions",
        ),
        ({"conditions": {PERIOD: [1000]}}, "varies too"),
        ({"until": "decided", "requirements": ()}, "needs a requirement on a share"),
    ],
)
def test_what_cannot_be_asked_is_refused_before_a_run(tmp_path, changes, words):
    with pytest.raises(SceneError, match=words):
        sweep(evolve(STUDY, **changes), tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_a_required_mean_over_some_launches_is_noted_before_a_run(tmp_path):
    notes = []
    study = evolve(STUDY, requirements=("latency_s <= 2",), runs=1)
    sweep(study, tmp_path, on_notes=notes.extend)
    assert any("require a share of launches instead" in note for note in notes)


def test_shares_of_no_launches_are_not_shown(tmp_path):
    study = Study(scene={**SCENE, "targets": []}, runs=2, requirements=("detected in 90 %",))
    text = as_text(sweep(study, tmp_path, workers=1))
    assert "not shown either way: - of 0 launches with 0 seeds" in text


def test_a_study_stops_when_its_shares_are_decided(tmp_path):
    """With P_d 1 and a scan each second all launches are detected within 3 s: that is soon shown
    for 60 %, and the exact interval of n of n runs says when.
    """
    requirement = "detected within 3 s in 60 % of launches, in every condition"
    study = evolve(
        STUDY, requirements=(requirement,), runs=200, until="decided", vary={PERIOD: [1000]}
    )
    study = evolve(study, overrides={CHANCE: {"ICBM": 1.0, "SRBM": 1.0}})
    result = sweep(study, tmp_path)
    assert set(result.shares.to_pandas().query("by == ''")["verdict"]) == {"met"}
    looks = len(list(rounds(200, stops_early=True)))
    needed = math.log(0.025 / looks) / math.log(0.6)
    expected = next(count for count in rounds(200, stops_early=True) if count >= needed)
    assert result.runs.num_rows == 2 * expected


@frozen
class DrawnRuns:
    """Runs of designs whose three launches are detected at these times (designs, runs, 3), s."""

    times_s: np.ndarray

    def numbers(self, design):
        """Return the numbers of a design's runs."""
        return np.arange(self.times_s.shape[1])

    def launch_values(self, design, column):
        """Return the times of a design's launches."""
        assert column == "detected_s"
        return self.times_s[design]


def drawn(rng, chances, runs):
    """Return the times of detection (designs, runs, 3) of launches of dependent chances, s."""
    of_runs = [rng.beta(6.0 * chance, 6.0 * (1.0 - chance), runs) for chance in chances]
    seen = rng.random((len(chances), runs, 3)) < np.array(of_runs)[..., None]
    return np.where(seen, 1.0, np.inf)


@pytest.mark.slow
@pytest.mark.parametrize("until", ["", "decided"])
@pytest.mark.parametrize("chances", [(0.9, 0.9), (0.89, 0.97), (0.93, 0.9)])
def test_at_most_one_of_twenty_studies_is_wrong(chances, until):
    """Required are 90 % in both conditions, of dependent launches, also with a look after each
    round.
    """
    sentence = "detected within 2 s in 90 % of launches, in every condition"
    study = evolve(STUDY, requirements=(sentence,), vary={}, runs=120, until=until)
    planned = planned_study(study)
    (requirement,) = planned.share_requirements
    rng = np.random.default_rng([581, *(int(100 * chance) for chance in chances)])
    numbers = list(rounds(study.runs, stops_early=bool(until)))
    is_met = min(chances) >= 0.9
    studies = 1000
    wrong = 0
    for _ in range(studies):
        times_s = drawn(rng, chances, study.runs)
        for number in numbers:
            verdict = verdict_of(planned, requirement, DrawnRuns(times_s[:, :number]), [0, 1])
            if verdict != "not shown":
                wrong += verdict != ("met" if is_met else "not met")
                break
    assert wrong <= 0.05 * studies + 3.0 * (studies * 0.05 * 0.95) ** 0.5
