"""Sources that went out before their looks could tell a launch from a light that stands still."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from attrs import evolve
from opir_trackers.onset.brevity import are_brief
from opir_trackers.onset.motion_statistics import MotionStatistics
from track_lines import whole_records

import opir_core as opir
from opir_core.cli.main import main

SOUND_M_S = 340.3


def statistics_of(count: int, sigma_m: float, share: float = 0.5) -> MotionStatistics:
    """Return the statistics of `count` looks that place a source to a standard deviation on two
    axes.
    """
    prior = np.array([0.0, 0.0, 0.0, share, 1.0 - share])
    fresh = MotionStatistics.fresh(np.array([[6.4e6, 0.0, 0.0]]), 0.0, np.zeros(1), prior)
    fresh.static_information[0] = np.diag([1.0, 1.0, 0.0]) * count / sigma_m**2
    return fresh


@pytest.mark.parametrize(("count", "sigma_m"), [(8, 700.0), (40, 700.0), (200, 150.0)])
def test_looks_are_too_few_until_a_regression_would_tell_sound_from_rest(
    count: int, sigma_m: float
) -> None:
    spans_s = np.geomspace(0.1, 30.0, 200)
    brief = [
        are_brief(statistics_of(count, sigma_m, 0.01), np.zeros(1), np.array([span_s]))[0]
        for span_s in spans_s
    ]
    # A line of regression through evenly spaced looks: by how much they are likelier, in the mean,
    # if it moves.
    log_odds = [
        0.5 * SOUND_M_S**2 * np.sum(np.square(np.linspace(-0.5, 0.5, count) * span_s)) / sigma_m**2
        for span_s in spans_s
    ]
    first = int(np.argmax(~np.array(brief)))
    assert all(brief[:first])
    assert not any(brief[first:])
    # Looks at both ends of the span spread by (n + 1) / (n - 1) more than looks all over it; spans
    # grow by 3 %.
    assert log_odds[first] == pytest.approx(np.log(20.0) * (count + 1) / (count - 1), rel=0.06)


def test_a_launch_for_sure_is_not_brief_and_neither_is_what_began_anew() -> None:
    span_s = np.array([0.4])
    assert are_brief(statistics_of(8, 700.0), np.zeros(1), span_s)
    assert not are_brief(statistics_of(8, 700.0, 0.9995), np.zeros(1), span_s)
    anew = statistics_of(8, 700.0).restarted(np.array([0]), 1.0)
    assert not are_brief(anew, np.zeros(1), span_s)


#: Latitude and longitude, deg, start and duration, s.
FLASHES = [
    (9.0, 20.0, 8.3, 0.6),
    (-12.0, 33.0, 12.2, 0.7),
    (16.0, 52.0, 20.1, 0.55),
    (-3.0, 47.0, 27.4, 0.65),
]


def dark_between(lights: float) -> MotionStatistics:
    """Return the statistics of 8 looks from 0.6 s on, after a dark that began them anew."""
    statistics = statistics_of(8, 100.0, lights)
    return evolve(statistics, epoch_s=np.array([0.6]))


def test_only_what_shone_since_the_dark_counts() -> None:
    first_s, last_s = np.zeros(1), np.array([6.5])
    assert not are_brief(statistics_of(8, 100.0), first_s, last_s)
    assert not are_brief(dark_between(0.5), first_s, last_s)
    assert are_brief(dark_between(0.5), first_s, np.array([1.0]))


@pytest.mark.parametrize(("share", "is_short"), [(0.5, True), (0.01, False), (0.9995, False)])
def test_what_may_be_a_launch_is_none_if_it_shone_for_moments(share: float, is_short: bool) -> None:
    # Looks that tell speeds at once.
    sharp = statistics_of(8, 1.0, share)
    assert are_brief(sharp, np.zeros(1), np.array([4.9]))[0] == is_short
    assert not are_brief(sharp, np.zeros(1), np.array([5.1]))


def scene(tracker: str) -> dict[str, Any]:
    """Return flashes at 11 km, and a launch that burns to the end."""
    at = [
        {"lat_deg": lat, "lon_deg": lon, "start_s": start, "end_s": start + lasts, "height_m": 11e3}
        | {"temperature_k": 15000.0, "area_m2": 20.0}
        for lat, lon, start, lasts in FLASHES
    ]
    return {
        "scene": "short-lights",
        "epoch": "2026-04-01T20:00:00Z",
        "duration_s": 40,
        "seed": 77,
        "sensors": [
            {"model": "SBIRS-GEO", "id": "A", "orbital_slot_deg": 12.0},
            {"model": "SBIRS-GEO", "id": "B", "orbital_slot_deg": 77.0},
        ],
        "targets": [
            {
                "id": "T1",
                "type": "SRBM",
                "launch": {"lat_deg": 30.0, "lon_deg": 40.0, "time_s": 4.0},
                "aim": {"lat_deg": 33.0, "lon_deg": 41.0},
            }
        ],
        "detection": "snr",
        "background": "earth",
        "tracker": tracker,
        "sources": [{"id": "flashes", "model": "flares", "at": at}],
    }


@pytest.mark.slow
@pytest.mark.parametrize("tracker", ["imm", "kepler-arc"])
def test_a_flash_that_is_gone_has_no_launch_and_no_impact_in_summary_file_and_table(
    tracker: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(json.dumps(scene(tracker)))
    assert main(["run", str(path), "--out", str(tmp_path / "e.jsonl")]) == 0
    table = [line for line in capsys.readouterr().out.splitlines() if "too briefly to tell" in line]
    run = opir.load_run(tmp_path / "e.jsonl")
    launch, *flashes = sorted(run.summary["tracks"], key=lambda row: -row["seen_s"])
    assert launch["launch"] is not None
    assert not launch["is_brief"]
    assert len(flashes) >= 3
    assert any(row["end"] for row in flashes)
    for row in flashes:
        assert row["seen_s"] < 0.7
        assert (row["is_brief"], row["launch"], row["impact"]) == (True, None, None)
        assert row["end"] in ("flash", "unresolved", None)
        assert any(
            f"seen within {row['seen_s']:.1f} s, too briefly to tell" in line for line in table
        )
    last = {line["track_id"]: line for line in whole_records(tmp_path / "e.tracks.jsonl")}
    for row in flashes:
        record = last[row["track_id"]]
        assert (record["launch"], record["impact"], record["impact_regions"]) == (None, None, [])


@pytest.mark.slow
def test_a_flash_that_was_too_brief_to_tell_does_not_end_with_an_impact() -> None:
    """Flashes of about a second at 4 to 7 km, whose predicted places soon are below the ground."""
    rng = np.random.default_rng(8)
    at = [
        {"lat_deg": rng.uniform(-15.0, 20.0), "lon_deg": rng.uniform(20.0, 65.0)}
        | {"start_s": start_s, "end_s": start_s + rng.uniform(0.9, 1.5)}
        | {"height_m": rng.uniform(4e3, 7e3), "temperature_k": 6000.0, "area_m2": 60.0}
        for start_s in np.linspace(3.0, 15.0, 25).tolist()
    ]
    changes = {
        "targets": [],
        "duration_s": 55,
        "sources": [{"id": "f", "model": "flares", "at": at}],
    }
    rows = opir.simulate(opir.scene_from_mapping({**scene("imm"), **changes})).summary["tracks"]
    assert sum(row["is_brief"] for row in rows) >= 10
    assert all(row["end"] != "impact" for row in rows)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [61, 62])
def test_the_strokes_of_a_storm_are_no_launch_in_the_table(seed: int) -> None:
    storm = {"id": "s", "model": "storms", "flashes_per_minute": 60.0}
    rng = np.random.default_rng(seed)
    at = [
        {"lat_deg": rng.uniform(-15.0, 20.0), "lon_deg": rng.uniform(25.0, 65.0)} for _ in range(12)
    ]
    changes = {
        "targets": [],
        "duration_s": 60,
        "seed": seed,
        "sources": [{**storm, "at": at}],
        "tracker": {"model": "imm", "cadence_s": 1.0},
    }
    rows = opir.simulate(opir.scene_from_mapping({**scene("imm"), **changes})).summary["tracks"]
    assert len(rows) >= 20
    assert all(row["launch"] is None for row in rows)
    assert any(row["end"] == "flash" for row in rows)
