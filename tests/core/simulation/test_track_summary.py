"""The summary of tracks: one line per track, with the 95 % region of the impact, an axis, or the paper's sigma."""

from typing import Any

import numpy as np
import pytest
from attrs import evolve
from opir_testing.doubles import stub_estimates, stub_regions

from opir_core.cli.answer_lines import track_cells
from opir_core.interfaces.records import Tracks
from opir_core.simulation.summary import LatestTracks

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
    return row["impact"], track_cells(row)[-1]


def test_an_impact_has_an_axis_until_there_are_regions() -> None:
    impact, text = summary_of(TRACK)
    assert impact["semi_major_95_km"] == pytest.approx(30.0 * np.sqrt(-2.0 * np.log(0.05)))
    assert (impact["region_95_km2"], impact["method"], impact["sigma_km"]) == (None, "posterior", None)
    assert text == "9.00 N 167.70 E at 1800.0 s (73.4 km)"


@pytest.mark.parametrize(
    ("area_km2", "words"), [(12345.6, "95 % in 12 000 km2"), (10.2, "95 % in 10 km2"), (0.314, "95 % in 0.31 km2")]
)
def test_the_area_of_the_95_percent_region_is_printed(area_km2: float, words: str) -> None:
    half, most, outer = stub_regions(9.0, 167.7)
    regions = np.empty(1, dtype=object)
    regions[0] = (half, most, evolve(outer, area_km2=area_km2))
    impact, text = summary_of(evolve(TRACK, impact_regions=regions))
    assert impact["region_95_km2"] == area_km2
    assert text == f"9.00 N 167.70 E at 1800.0 s ({words})"


def test_the_paper_s_law_has_a_sigma_and_no_containment() -> None:
    impact, text = summary_of(evolve(TRACK, impact_method=np.ones(1, dtype=np.uint8)))
    assert (impact["method"], impact["semi_major_95_km"], impact["region_95_km2"]) == ("paper", None, None)
    assert impact["sigma_km"] == pytest.approx(30.0)
    assert text == "9.00 N 167.70 E at 1800.0 s (sigma 30.0 km)"
    impact, text = summary_of(evolve(TRACK, impact=np.full((1, 3), np.nan)))
    assert (impact, text) == (None, "-")
