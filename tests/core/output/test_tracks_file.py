"""The tracks file: keys with units, unknown values null, regions as GeoJSON; what is read is what
was written.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from attrs import evolve, fields
from json_lines import json_lines
from opir_testing import stub_estimates, stub_regions
from opir_testing.doubles import stub_hypotheses

from opir_core.errors import SceneError
from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_core.output import TracksFile, read_tracks
from opir_core.plugin import Tracks
from opir_core.scene import core_hypotheses

RNG = np.random.default_rng(7)
HYPOTHESES = tuple(each.name for each in core_hypotheses())
REGIONS = (
    *stub_regions(
        9.0, 167.7, 120.0, condition="burn over", probability=0.75, effective_samples=250.0
    ),
    *stub_regions(9.0, 167.7, 900.0, condition="relights", probability=0.125),
)


def covariances(count: int, size: int) -> Any:
    root = RNG.normal(size=(count, size, size))
    return root @ root.transpose(0, 2, 1)


def tracks_of(count: int, **changes: Any) -> Tracks:
    """Return tracks with every column known."""
    columns: dict[str, Any] = {
        "track": np.arange(count),
        "tick_s": np.full(count, 61.0),
        "available_s": np.full(count, 61.5),
        "state": RNG.normal(size=(count, 6)) * 1e6,
        "state_covariance": covariances(count, 6),
        "state_sigmas": [2.0, 3.0, 4.0],
        "launch": np.column_stack(
            [RNG.uniform(-1.5, 1.5, count), RNG.uniform(-3.1, 3.1, count), np.full(count, 3.0)]
        ),
        "launch_covariance": covariances(count, 3),
        "impact": np.column_stack(
            [RNG.uniform(-1.5, 1.5, count), RNG.uniform(-3.1, 3.1, count), np.full(count, 1e3)]
        ),
        "impact_covariance": covariances(count, 3),
        "impact_sigmas": [1.1, 2.2, 2.6],
        "type_probability": [0.7, 0.2, 0.1, 0.0],
        "hypothesis_probability": stub_hypotheses(ICBM=0.5, SLV=0.25),
        "burnout": RNG.normal(size=(count, 7)),
        "burnout_covariance": covariances(count, 7),
        "impact_regions": [REGIONS] * count,
        "probability_burning": 0.25,
        "probability_relights": 0.125,
        "end": 1,
        "seen_s": 2.5,
        "is_brief": True,
    }
    return stub_estimates(count, **(columns | changes))


def written(tmp_path: Path, tracks: Tracks) -> list[dict[str, Any]]:
    with TracksFile(tmp_path / "t.jsonl", HYPOTHESES) as file:
        file.write(tracks)
    return json_lines(tmp_path / "t.jsonl")


def test_a_line_has_keys_with_units(tmp_path: Path) -> None:
    tracks = tracks_of(1, launch=np.radians([[34.5, -120.25, np.degrees(12.0)]]))
    (line,) = written(tmp_path, tracks)
    assert list(line) == [
        "schema_version", "time_s", "track_id", "available_s", "target_type", "type_probability", "hypotheses",
        "probability_launch", "probability_missile", "probability_orbit", "probability_comes_down", "position_ecef_m",
        "velocity_ecef_m_s", "covariance", "ellipsoid_sigmas", "launch", "burnout", "impact", "impact_regions",
        "probability_burning", "probability_relights", "end", "seen_s", "is_brief",
    ]  # fmt: skip
    assert (line["time_s"], line["track_id"], line["available_s"]) == (61.0, 0, 61.5)
    assert line["target_type"] == "ICBM"
    assert line["type_probability"] == {"ICBM": 0.7, "IRBM": 0.2, "SRBM": 0.1, "UNKNOWN": 0.0}
    assert line["position_ecef_m"] + line["velocity_ecef_m_s"] == tracks.state[0].tolist()
    assert line["covariance"] == tracks.state_covariance[0].tolist()
    assert (line["probability_burning"], line["probability_relights"]) == (0.25, 0.125)
    assert (line["seen_s"], line["is_brief"], line["end"]) == (2.5, True, "impact")


def test_points_of_a_line(tmp_path: Path) -> None:
    tracks = tracks_of(1, launch=np.radians([[34.5, -120.25, np.degrees(12.0)]]))
    (line,) = written(tmp_path, tracks)
    launch = line["launch"]
    spread = tracks.launch_covariance[0]
    place = (launch["lat_deg"], launch["lon_deg"], launch["time_s"])
    assert place == pytest.approx((34.5, -120.25, 12.0), rel=1e-15)
    assert launch["covariance_m2"] == spread[:2, :2].tolist()
    assert launch["time_variance_s2"] == spread[2, 2]
    assert launch["time_covariance_m_s"] == spread[:2, 2].tolist()
    assert line["burnout"]["position_ecef_m"] == tracks.burnout[0, :3].tolist()
    assert (line["impact"]["method"], line["impact"]["sigma_m"]) == ("posterior", None)
    assert line["impact"]["containment"] == list(TRACK_CONTAINMENTS)
    assert line["impact"]["ellipse_sigmas"] == [1.1, 2.2, 2.6]


def test_regions_and_hypotheses_of_a_line(tmp_path: Path) -> None:
    (line,) = written(tmp_path, tracks_of(1))
    regions = line["impact_regions"]
    assert [region["containment"] for region in regions] == list(TRACK_CONTAINMENTS) * 2
    figures = [
        [region[name] for name in ("condition", "probability", "effective_samples")]
        for region in regions
    ]
    assert figures == [["burn over", 0.75, 250.0]] * 3 + [["relights", 0.125, None]] * 3
    assert {region["geometry"]["type"] for region in regions} == {"Polygon"}
    assert list(line["hypotheses"]) == list(HYPOTHESES)
    chances = [line["hypotheses"][name] for name in ("ICBM", "SLV", "none of these")]
    assert chances == [0.5, 0.25, 0.25]
    sums = [line[f"probability_{name}"] for name in ("launch", "missile", "orbit", "comes_down")]
    assert sums == [0.75, 0.5, 0.25, 0.875]


def test_unknown_values_are_null_and_read_as_nan(tmp_path: Path) -> None:
    tracks = stub_estimates(2)
    line, _ = written(tmp_path, tracks)
    estimate_columns = {
        "schema_version": "tracks-2.0",
        "time_s": 0.0,
        "track_id": 0,
        "available_s": 0.0,
        "impact_regions": [],
        "is_brief": False,
    }
    assert line == dict.fromkeys(line) | estimate_columns
    assert_equal(read_tracks(tmp_path / "t.jsonl"), tracks)


def test_what_is_read_is_what_was_written(tmp_path: Path) -> None:
    tracks = Tracks.concatenate(
        [tracks_of(5), tracks_of(5, tick_s=np.full(5, 62.0), impact_regions=[()] * 5)]
    )
    written(tmp_path, tracks)
    read = read_tracks(tmp_path / "t.jsonl")
    assert_equal(read, tracks)
    for region, written_region in zip(read.impact_regions[0], REGIONS, strict=True):
        for name in ("containment", "condition", "probability"):
            assert getattr(region, name) == getattr(written_region, name)
        assert np.array_equal(
            region.effective_samples, written_region.effective_samples, equal_nan=True
        )
        assert region.area_km2 == pytest.approx(written_region.area_km2, abs=1e-3)
        # The outline has some of the corners, with digits for 0.1 % of the radius.
        corners = region.polygons[0][0]
        expected = written_region.polygons[0][0][::-1]
        distance = np.abs(corners[:, None] - expected[None]).max(axis=2).min(axis=1)
        radius_m = np.sqrt(1e6 * written_region.area_km2 / np.pi)
        assert distance.max() < 0.001 * radius_m / 6_378_137.0


def test_a_line_has_what_changed_in_its_track(tmp_path: Path) -> None:
    old, new = REGIONS, stub_regions(10.0, 168.0, 50.0)
    regions = [(), old, old, new, (), (), old]
    tracks = tracks_of(7, track=[2, 2, 2, 2, 2, 5, 2], tick_s=np.arange(7.0), end=0)
    tracks = tracks.replaced(
        impact_regions=tracks_of(7, impact_regions=regions).impact_regions,
        launch=tracks.launch[[0, 0, 0, 1, 1, 1, 1]],
        launch_covariance=tracks.launch_covariance[[0] * 7],
        burnout=tracks.burnout[[0] * 7],
        burnout_covariance=tracks.burnout_covariance[[0] * 7],
    )
    lines = written(tmp_path, tracks)
    assert [line.get("since_s") for line in lines] == [None, 0.0, 1.0, 2.0, 3.0, None, 4.0]
    wholes = [line.get("impact_regions") for line in lines]
    assert [whole and len(whole) for whole in wholes] == [[], 6, None, 3, [], [], 6]
    assert ["launch" in line for line in lines] == [True, False, False, True, False, True, False]
    assert ["burnout" in line for line in lines] == [True, *[False] * 4, True, False]
    read = read_tracks(tmp_path / "t.jsonl")
    assert_equal(read, tracks)
    assert [len(row) for row in read.impact_regions] == [len(row) for row in regions]
    assert read.impact_regions[1] is read.impact_regions[2]
    # In one write or in several, the lines are the same; they are read in any order.
    whole = (tmp_path / "t.jsonl").read_bytes()
    with TracksFile(tmp_path / "t.jsonl", HYPOTHESES) as file:
        for row in range(7):
            file.write(tracks.take(slice(row, row + 1)))
    assert (tmp_path / "t.jsonl").read_bytes() == whole
    (tmp_path / "t.jsonl").write_bytes(b"".join(whole.splitlines(keepends=True)[::-1]))
    assert_equal(read_tracks(tmp_path / "t.jsonl"), tracks)


def test_a_value_that_is_no_longer_known_is_null(tmp_path: Path) -> None:
    known = tracks_of(2, end=0)
    unknown = stub_estimates(2, hypothesis_probability=np.full((2, len(HYPOTHESES)), np.nan))
    tracks = Tracks.concatenate(
        [known.take([0]), unknown.take([0]).replaced(tick_s=np.array([62.0]))]
    )
    _, line = written(tmp_path, tracks)
    assert (line["launch"], line["burnout"], line["impact_regions"]) == (None, None, [])
    assert np.isnan(read_tracks(tmp_path / "t.jsonl").launch[1]).all()


def test_files_with_numbered_regions_are_read(tmp_path: Path) -> None:
    (whole,) = written(tmp_path, tracks_of(1, track=[0], end=0))
    lines = [whole | {"time_s": time_s, "impact_regions_id": 0} for time_s in (1.0, 2.0)]
    del lines[1]["impact_regions"]
    path = tmp_path / "t.jsonl"
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    first, second = read_tracks(path).impact_regions
    assert first is second
    assert len(first) == len(REGIONS)
    path.write_text(json.dumps(lines[1]))
    with pytest.raises(SceneError, match=r"impact_regions_id: no line before has regions 0"):
        read_tracks(path)


@pytest.mark.parametrize("since_s", [0.5, None, "0", [0.0], True])
def test_lines_of_no_line_before_are_refused(tmp_path: Path, since_s: Any) -> None:
    lines = written(tmp_path, tracks_of(2, track=[0, 0], tick_s=np.arange(2.0), end=0))
    lines[1]["since_s"] = since_s
    path = tmp_path / "t.jsonl"
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    with pytest.raises(SceneError, match=r"line 2: since_s: no line has track 0 at .* whole file"):
        read_tracks(path)


def assert_equal(read: Tracks, tracks: Tracks) -> None:
    for item in fields(Tracks):
        actual = getattr(read, item.name)
        expected = getattr(tracks, item.name)
        if item.name in ("launch", "impact"):
            assert np.allclose(actual, expected, rtol=4e-16, atol=0.0, equal_nan=True), item.name
        elif item.name != "impact_regions":
            assert np.array_equal(actual, expected, equal_nan=True), item.name


def test_probabilities_are_read_by_the_names_of_hypotheses(tmp_path: Path) -> None:
    """In another order, with one that the file lacks; rows without any are nan; others are refused
    with their line.
    """
    unknown = np.full(len(HYPOTHESES), np.nan)
    written(
        tmp_path,
        tracks_of(2, hypothesis_probability=[unknown, stub_hypotheses(ICBM=0.5, SLV=0.25)]),
    )
    names = ["MIRV", *reversed(HYPOTHESES)]
    read = read_tracks(tmp_path / "t.jsonl", names).hypothesis_probability
    assert np.isnan(read[0]).all()
    assert {name: share for name, share in zip(names, read[1].tolist(), strict=True) if share} == {
        "none of these": 0.25, "SLV": 0.25, "ICBM": 0.5,
    }  # fmt: skip
    with pytest.raises(
        SceneError, match="line 2: hypotheses: the scene has no hypothesis 'ICBM' with the plugins"
    ):
        read_tracks(tmp_path / "t.jsonl", [name for name in HYPOTHESES if name != "ICBM"])


def test_regions_without_hypotheses_have_no_chance_of_impact(tmp_path: Path) -> None:
    none = evolve(tracks_of(1), hypothesis_probability=np.empty((1, 0)))
    tracks = tracks_of(1, impact_regions=[stub_regions(9.0, 1.0, probability=0.5)])
    without = tracks_of(1, impact_regions=[()])
    reported = [
        written(tmp_path, tracks)[0]["probability_comes_down"] for tracks in (none, tracks, without)
    ]
    assert reported == [None, 0.5, None]


def test_a_region_may_lack_its_condition(tmp_path: Path) -> None:
    ring = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]
    region = {
        "containment": 0.5,
        "area_km2": 1.0,
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    line = {"time_s": 1.0, "track_id": 4, "impact_regions": [region]}
    (tmp_path / "t.jsonl").write_text(json.dumps(line))
    (read,) = read_tracks(tmp_path / "t.jsonl").impact_regions[0]
    assert (read.condition, read.probability, np.isnan(read.effective_samples)) == (
        "comes down",
        1.0,
        True,
    )
    region["condition"] = "soon"
    (tmp_path / "t.jsonl").write_text(json.dumps(line))
    with pytest.raises(
        SceneError, match=r"line 1: impact_regions: .*'soon' is no condition of a region"
    ):
        read_tracks(tmp_path / "t.jsonl")


def test_an_impact_by_the_papers_law_has_no_containment(tmp_path: Path) -> None:
    spread = np.diag([9e8, 9e8, 4.0])
    tracks = tracks_of(
        2,
        impact_covariance=spread,
        impact_method=[1, 0],
        impact_regions=[(), ()],
        impact_sigmas=np.nan,
    )
    paper, posterior = (line["impact"] for line in written(tmp_path, tracks))
    assert (paper["method"], paper["sigma_m"]) == ("paper", 3e4)
    assert (paper["covariance_m2"], paper["containment"], paper["ellipse_sigmas"]) == (
        None,
        None,
        None,
    )
    assert (posterior["method"], posterior["sigma_m"]) == ("posterior", None)
    assert posterior["covariance_m2"] == spread[:2, :2].tolist()
    assert_equal(read_tracks(tmp_path / "t.jsonl"), tracks)


def test_only_time_and_number_are_needed(tmp_path: Path) -> None:
    (tmp_path / "t.jsonl").write_text(
        '{"time_s": 2, "track_id": 4}\n{"time_s": 1.5, "track_id": 4}\n'
    )
    read = read_tracks(tmp_path / "t.jsonl")
    assert (read.tick_s.tolist(), read.track.tolist(), read.available_s.tolist()) == (
        [1.5, 2.0],
        [4, 4],
        [1.5, 2.0],
    )
    assert np.isnan(read.state).all()
    assert read.impact_regions.tolist() == [(), ()]


def test_a_file_without_lines_has_no_tracks(tmp_path: Path) -> None:
    (tmp_path / "t.jsonl").write_text("")
    read = read_tracks(tmp_path / "t.jsonl")
    empty = Tracks.empty()
    for item in fields(Tracks):
        actual = getattr(read, item.name)
        expected = getattr(empty, item.name)
        assert (actual.shape, actual.dtype) == (expected.shape, expected.dtype), item.name


@pytest.mark.parametrize("longitude_deg", [-180.0, 180.0, 190.0, 539.0])
def test_longitudes_are_within_half_a_turn(tmp_path: Path, longitude_deg: float) -> None:
    tracks = tracks_of(1, impact=np.radians([[10.0, longitude_deg, 0.0]]))
    (line,) = written(tmp_path, tracks)
    assert -180.0 <= line["impact"]["lon_deg"] <= 180.0
    assert np.cos(np.radians(line["impact"]["lon_deg"] - longitude_deg)) == pytest.approx(
        1.0, abs=1e-15
    )
