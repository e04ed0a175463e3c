"""The summary of tracks: one line per track, with the 95 % region of the impact, an axis, or the
paper's sigma.
"""

from typing import Any

import numpy as np
import pytest
from attrs import evolve
from opir_testing import stub_estimates, stub_regions
from opir_testing.doubles import stub_hypotheses

from opir_core.cli import answers
from opir_core.cli.answer_lines import track_cells
from opir_core.plugin import Tracks
from opir_core.scene import core_hypotheses
from opir_core.simulation.latest_tracks import LatestTracks

TRACK = stub_estimates(
    1,
    tick_s=60.0,
    launch=[*np.radians([34.73, -120.57]), 10.0],
    launch_covariance=np.diag([2.5e5, 1e5, 1.0]),
    impact=[*np.radians([9.0, 167.7]), 1800.0],
    impact_covariance=np.diag([9e8, 9e8, 25.0]),
    type_probability=[0.75, 0.25, 0.0, 0.0],
)


def summary_of(tracks: Tracks) -> tuple[dict[str, Any], str]:
    latest = LatestTracks()
    latest.take(tracks)
    (row,) = latest.rows()
    return row["impact"], track_cells(row, weighs=False)[-1]


def test_numbers_of_tracks_may_have_gaps() -> None:
    latest = LatestTracks()
    latest.take(evolve(TRACK, track=np.array([4])))
    assert len(latest) == 1


def test_an_impact_has_an_axis_until_there_are_regions() -> None:
    impact, text = summary_of(TRACK)
    assert impact["semi_major_95_km"] == pytest.approx(30.0 * np.sqrt(-2.0 * np.log(0.05)))
    assert (impact["region_95_km2"], impact["method"], impact["sigma_km"]) == (
        None,
        "posterior",
        None,
    )
    assert text == "9.00 N 167.70 E at 1800.0 ± 9.8 s (73.4 km)"


@pytest.mark.parametrize(
    ("area_km2", "words"),
    [(12345.6, "95 % in 12 000 km2"), (10.2, "95 % in 10 km2"), (0.314, "95 % in 0.31 km2")],
)
def test_the_area_of_the_95_percent_region_is_printed(area_km2: float, words: str) -> None:
    half, maximum, outer = stub_regions(9.0, 167.7)
    regions = np.empty(1, dtype=object)
    regions[0] = (half, maximum, evolve(outer, area_km2=area_km2))
    impact, text = summary_of(evolve(TRACK, impact_regions=regions))
    assert impact["region_95_km2"] == area_km2
    assert text == f"9.00 N 167.70 E at 1800.0 ± 9.8 s ({words})"


def test_the_paper_s_law_has_a_sigma_and_no_containment() -> None:
    impact, text = summary_of(evolve(TRACK, impact_method=np.ones(1, dtype=np.uint8)))
    assert (impact["method"], impact["semi_major_95_km"], impact["region_95_km2"]) == (
        "paper",
        None,
        None,
    )
    assert impact["sigma_km"] == pytest.approx(30.0)
    assert text == "9.00 N 167.70 E at 1800.0 ± 9.8 s (sigma 30.0 km)"
    impact, text = summary_of(evolve(TRACK, impact=np.full((1, 3), np.nan)))
    assert (impact, text) == (None, "-")


def row_of(chances: Any, regions: Any = (), **columns: Any) -> dict[str, Any]:
    weighed = stub_estimates(1, hypothesis_probability=chances)
    names = (
        "hypothesis_probability",
        "probability_launch",
        "probability_missile",
        "probability_orbit",
    )
    inputs = {name: getattr(weighed, name) for name in names} | columns
    tracks = evolve(
        TRACK, impact_regions=stub_estimates(1, impact_regions=[regions]).impact_regions, **inputs
    )
    latest = LatestTracks([core_hypothes.name for core_hypothes in core_hypotheses()])
    latest.take(tracks)
    (row,) = latest.rows()
    return row


def test_a_track_has_its_hypotheses_by_name_and_its_likeliest() -> None:
    row = row_of(stub_hypotheses(ICBM=0.25, SLV=0.625), end=np.array([2], dtype=np.uint8))
    assert (row["likeliest_hypothesis"], row["hypothesis_probability"], row["end"]) == (
        "SLV",
        0.625,
        "orbit",
    )
    shares = {name: share for name, share in row["hypotheses"].items() if share}
    assert shares == {"ICBM": 0.25, "SLV": 0.625, "none of these": 0.125}
    sums = [row[f"probability_{name}"] for name in ("launch", "missile", "orbit", "comes_down")]
    assert sums == [0.875, 0.25, 0.625, None]
    assert track_cells(row, weighs=True)[1:3] == ("SLV 0.62", "0.88")


def test_a_tracker_that_weighs_nothing_has_no_hypotheses() -> None:
    latest = LatestTracks([core_hypothes.name for core_hypothes in core_hypotheses()])
    latest.take(TRACK)
    (row,) = latest.rows()
    names = (
        "hypotheses",
        "likeliest_hypothesis",
        "hypothesis_probability",
        "probability_launch",
        "end",
    )
    assert [row[name] for name in (*names, "probability_orbit", "probability_comes_down")] == [
        None
    ] * 7
    assert track_cells(row, weighs=False)[1] == "ICBM 0.75"


def test_regions_have_conditions_and_a_chance_of_coming_down() -> None:
    over = stub_regions(
        9.0, 167.7, 60.0, condition="burn over", probability=0.75, effective_samples=500.0
    )
    repeat = stub_regions(
        9.0, 167.7, 400.0, condition="relights", probability=0.125, effective_samples=12.0
    )
    row = row_of(stub_hypotheses(ICBM=0.9), (*over, *repeat))
    assert row["probability_comes_down"] == 0.875
    assert row["impact"]["regions"] == [
        {
            "condition": "burn over",
            "probability": 0.75,
            "area_95_km2": over[2].area_km2,
            "effective_samples": 500.0,
        },
        {
            "condition": "relights",
            "probability": 0.125,
            "area_95_km2": repeat[2].area_km2,
            "effective_samples": 12.0,
        },
    ]
    assert row["impact"]["region_95_km2"] == over[2].area_km2
    impact = "9.00 N 167.70 E at 1800.0 ± 9.8 s (if the burn is over: 95 % in 11 000 km2)"
    assert track_cells(row, weighs=True)[-2:] == (impact, "-")


def test_an_improbable_launch_has_no_launch_point_or_impact() -> None:
    fire = row_of(stub_hypotheses(ground_source=0.75, SRBM=0.25), stub_regions(9.0, 167.7))
    assert track_cells(fire, weighs=True)[1:] == (
        "ground source 0.75",
        "0.25",
        "60.0",
        "60.0",
        "-",
        "-",
        "-",
        "-",
    )


def test_a_brief_track_is_reported_as_brief() -> None:
    latest = LatestTracks([core_hypothes.name for core_hypothes in core_hypotheses()])
    flash = {"seen_s": 0.42, "is_brief": True, "end": 3}
    latest.take(
        stub_estimates(1, tick_s=60.0, hypothesis_probability=stub_hypotheses(SRBM=0.75), **flash)
    )
    (row,) = latest.rows()
    assert (row["seen_s"], row["is_brief"]) == (0.42, True)
    words = "seen within 0.4 s, too briefly to tell"
    assert track_cells(row, weighs=True)[1:] == (
        words,
        "-",
        "60.0",
        "60.0",
        "0.4",
        "-",
        "-",
        "lost",
    )
    source = {
        "source_id": "S",
        "source_type": "flare",
        "track_id": 0,
        "first_sensor_id": "W",
        "detections": 4,
    }
    source |= {"reported_type": "UNKNOWN", "highest_confidence": 0.5}
    assert not list(answers({"tracks": [row], "targets": [], "sources": [source]}))
