"""The answers of a run: one sentence per launch with who says what it is; sources in a table of
their own.
"""

from typing import Any

import numpy as np
import pytest
from opir_testing import stub_estimates, stub_regions
from opir_testing.doubles import stub_hypotheses
from two_sides import two_sides_plan

from opir_core.cli import answers, probability_text, source_table, track_table
from opir_core.cli.answer_lines import source_cells
from opir_core.cli.run import as_text
from opir_core.output import deliver
from opir_core.scene import core_hypotheses
from opir_core.simulation.latest_tracks import LatestTracks

NAMES = [each.name for each in core_hypotheses()]
SEEN = {"first_sensor_id": "S-1", "detections": 12, "highest_confidence": 0.904, "track_id": 0}
TARGET = {
    **SEEN,
    "target_id": "T1",
    "target_type": "ICBM",
    "latency_s": 0.25,
    "end_to_end_latency_s": 0.25,
} | {"reported_type": "IRBM"}
SOURCE = {**SEEN, "source_id": "F1", "source_type": "fire", "reported_type": "UNKNOWN"}
OVER = stub_regions(
    9.0, 167.7, 60.0, condition="burn over", probability=0.75, effective_samples=500.0
)
AGAIN = stub_regions(
    9.0, 167.7, 400.0, condition="relights", probability=0.125, effective_samples=12.0
)


def tracks_of(chances: Any = None, regions: Any = (), **columns: Any) -> list[Any]:
    estimate_columns: dict[str, Any] = {
        "launch": [*np.radians([34.73, -120.57]), 10.0],
        "launch_covariance": np.diag([2.5e3, 1e3, 1.0]),
        "impact": [*np.radians([9.0, 167.7]), 1800.0],
        "impact_covariance": np.diag([9e8, 9e8, 25.0]),
        "type_probability": [0.75, 0.25, 0.0, 0.0],
    }
    weighed = {} if chances is None else {"hypothesis_probability": chances}
    latest = LatestTracks(NAMES)
    latest.take(
        stub_estimates(1, impact_regions=[regions], **(estimate_columns | weighed | columns))
    )
    return latest.rows()


def sentences(tracks: list[Any], targets: Any = (TARGET,), sources: Any = ()) -> list[str]:
    return answers({"targets": list(targets), "sources": list(sources), "tracks": tracks})


def test_a_probable_launch_has_one_type_and_regions() -> None:
    (line,) = sentences(tracks_of(stub_hypotheses(ICBM=0.97, SLV=0.02), (*OVER, *AGAIN)))
    assert line == (
        "T1 (ICBM): first seen by S-1 after 0.250 s; tracker: ICBM 0.97; comes down: 0.88;"
        " from 34.73 N 120.57 W (0.1 km) to 9.00 N 167.70 E"
        " (if the burn is over: 95 % in 11 000 km2; relights 0.12: 95 % in 500 000 km2, thin)"
    )


def test_both_fates_are_printed_while_both_are_possible() -> None:
    distant = stub_regions(9.0, 167.7, 900.0, probability=0.375)
    (line,) = sentences(tracks_of(stub_hypotheses(ICBM=0.375, SLV=0.625), distant))
    assert "; tracker: SLV 0.62; reaches orbit: 0.62; comes down: 0.38; from" in line
    assert "120.57 W (0.1 km); should it come down, to 9.00 N 167.70 E (95 % in" in line
    (line,) = sentences(tracks_of(stub_hypotheses(SLV=0.96), impact=np.nan, end=2))
    assert line.endswith("; tracker: SLV 0.96; reaches orbit: 0.96; from 34.73 N 120.57 W (0.1 km)")
    (line,) = sentences(tracks_of(stub_hypotheses(ICBM=0.75, SLV=0.25)))
    assert "; tracker: ICBM 0.75; from 34.73 N" in line


def test_before_a_tracker_has_an_answer_the_detections_give_it() -> None:
    for tracks in ([], tracks_of(type_probability=np.nan)):
        (line,) = sentences(tracks)
        assert line.startswith(
            "T1 (ICBM): first seen by S-1 after 0.250 s; detections: IRBM, confidence up to 0.90"
        )
    (line,) = sentences(tracks_of())
    assert "; tracker: ICBM 0.75; from 34.73 N" in line
    assert line.count("ICBM") == 2
    assert "comes down" not in line


def test_a_launch_taken_for_a_fire_has_no_places() -> None:
    (line,) = sentences(tracks_of(stub_hypotheses(ground_source=0.75, ICBM=0.25), OVER))
    assert line == "T1 (ICBM): first seen by S-1 after 0.250 s; tracker: ground source 0.75"


def test_only_sources_taken_for_launches_have_a_sentence() -> None:
    fire = stub_hypotheses(ground_source=0.75, SRBM=0.25)
    launch = stub_hypotheses(ground_source=0.25, SRBM=0.75)
    assert sentences(tracks_of(fire), (), (SOURCE,)) == []
    (line,) = sentences(tracks_of(launch, impact=np.nan), (), (SOURCE,))
    assert (
        line == "F1 (fire): taken for a launch; tracker: SRBM 0.75; from 34.73 N 120.57 W (0.1 km)"
    )
    assert (
        sentences(tracks_of(launch), (), [SOURCE] * 9)[-1]
        == "... and 3 more sources taken for launches"
    )
    (track,) = tracks_of(fire)
    assert source_cells(SOURCE, {0: track}) == (
        "F1",
        "fire",
        "S-1",
        "12",
        "0",
        "tracker: ground source 0.75",
    )
    assert source_cells(SOURCE, {})[-2:] == ("-", "detections: UNKNOWN, confidence up to 0.90")


def test_launches_come_first_in_the_tables() -> None:
    fire, launch = (
        tracks_of(stub_hypotheses(**{name: 0.75})) for name in ("ground_source", "SRBM")
    )
    tracks = [*({**fire[0], "track_id": number} for number in (0, 1)), {**launch[0], "track_id": 2}]
    sources = [{**SOURCE, "source_id": f"F{number}", "track_id": number} for number in range(3)]
    summary = {"targets": [], "sources": sources, "tracks": tracks}
    assert [row[0] for row in track_table(summary)[1]] == ["2", "0", "1"]
    assert [row[0] for row in source_table(summary)[1]] == ["F2", "F0", "F1"]


def test_an_impact_by_the_paper_s_law_says_so() -> None:
    (line,) = sentences(tracks_of(impact_method=1))
    assert line.endswith("to 9.00 N 167.70 E (sigma 30.0 km, the paper's law, without containment)")


@pytest.mark.parametrize(
    "chance", [0.0, 1e-9, 0.00499, 0.005, 0.1, 0.5, 0.9949, 0.995, 0.9951, 0.99999, 1.0]
)
def test_nothing_is_printed_as_certain(chance: float) -> None:
    text = probability_text(chance)
    assert text not in ("0.00", "1.00")
    if text[0] in "<>":
        bound = float(text[2:])
        assert chance > bound if text[0] == ">" else chance < bound
    else:
        assert float(text) == pytest.approx(chance, abs=0.00501)


@pytest.mark.slow
def test_sources_are_in_a_table_of_their_own() -> None:
    plan = two_sides_plan()
    outcome = deliver(plan)
    summary = outcome.summary
    assert [row["target_id"] for row in summary["targets"]] == ["T1"]
    (source,) = summary["sources"]
    assert (source["source_type"], source["track_id"]) == ("fire", 1)
    assert source["detections"] > 0
    assert not {"ignition_s", "latency_s", "burnout_s"} & source.keys()
    assert (summary["counts"]["targets"], summary["counts"]["sources"]) == (1, 1)
    assert [row["hypotheses"]["ICBM"] for row in summary["tracks"]] == [0.9, 0.0]
    text = as_text(plan.scene, outcome, {})
    heads = ["sensor", "target", "source", "track"]
    assert [
        line.split()[0]
        for line in text.splitlines()
        if line.split()[:1] in [[head] for head in heads]
    ] == heads
    assert "tracker: ground source > 0.99" in text
    assert "T1 (ICBM): first seen by A" in text
    assert "; tracker: ICBM 0.90; from 34.70 N 120.60 W" in text
    assert "taken for a launch" not in text


def test_a_wide_region_is_somewhere_and_a_useless_one_no_place() -> None:
    """No point says where it is; distances and directions are from the launch point."""
    wide = stub_regions(9.0, 167.7, 2200.0, probability=0.9, effective_samples=40.0)
    tracks = tracks_of(stub_hypotheses(ICBM=0.97), wide)
    (line,) = sentences(tracks)
    assert "from 34.73 N 120.57 W (0.1 km) to somewhere between " in line
    assert line.endswith(" deg (95 % in 15 000 000 km2, thin)")
    reach = tracks[0]["impact"]["from_launch"]
    # By haversines the centre is 7 782 km away, at 267 degrees; a circle of 2 200 km is 21 wide.
    assert reach["least_km"] == pytest.approx(7782.0 - 2200.0, abs=100.0)
    assert reach["most_km"] == pytest.approx(7782.0 + 2200.0, abs=100.0)
    assert reach["bearings_deg"] == pytest.approx([246.0, 288.0], abs=3.0)
    (cells,) = track_table({"tracks": tracks})[1]
    assert " ± " in cells[-2]
    useless = stub_regions(9.0, 167.7, 6000.0)
    (line,) = sentences(tracks_of(stub_hypotheses(ICBM=0.97), useless, probability_burning=0.9))
    words = "from 34.73 N 120.57 W (0.1 km) with no useful region, as the burn goes on (95 % in "
    assert words in line
    again = stub_regions(9.0, 167.7, 6000.0, condition="relights", probability=0.6)
    (line,) = sentences(tracks_of(stub_hypotheses(ICBM=0.97), again))
    assert "with no useful region, as it may burn again (relights 0.60: 95 % in" in line
    covariance = np.diag([1e6, 1e6, 1e6, 1e2, 1e2, 1e6])
    sure = {"probability_burning": 0.1, "state_covariance": covariance}
    (line,) = sentences(tracks_of(stub_hypotheses(ICBM=0.97), useless, **sure))
    assert "with no useful region, as the velocity is known to 2.0 km/s (95 % in" in line


@pytest.mark.parametrize(
    ("variance_s2", "text"),
    [(1.0, " at 10.0 ± 2.0 s "), (100.0, " at 10 ± 20 s "), (np.nan, " W (")],
)
def test_launch_times_have_intervals(variance_s2: float, text: str) -> None:
    covariance = np.diag([2.5e3, 1e3, variance_s2])
    tracks = tracks_of(stub_hypotheses(SRBM=0.9), launch_covariance=covariance)
    (cells,) = track_table({"tracks": tracks})[1]
    assert text in cells[-3]
