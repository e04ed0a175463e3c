"""Rates of areas change probabilities by Bayes' rule: prior odds times a ratio of densities."""

import numpy as np
import pytest
from opir_trackers.configs import AreaConfig, HypothesesConfig
from opir_trackers.onset.areas import AreaPosteriors
from opir_trackers.onset.motion_priors import VIEW_M2
from opir_trackers.onset.motion_statistics import GROUND, LAUNCH, NONE

import opir_core as opir
from opir_core.errors import SceneError
from opir_core.geometry import geodetic_to_ecef
from opir_core.plugin import Tracks

SCENE = "examples/first_light.yaml"
BOX = {"south_deg": -10.0, "north_deg": 10.0, "west_deg": 170.0, "east_deg": -170.0}
#: Of the sphere with the ellipsoid's surface.
RADIUS_2_M2 = 510_065_621_724_088.0 / (4.0 * np.pi)
BOX_M2 = RADIUS_2_M2 * 2.0 * np.sin(np.radians(10.0)) * np.radians(20.0)
INSIDE = np.radians([[5.0, 175.0], [-5.0, -175.0]])
OUTSIDE = np.radians([[5.0, 165.0], [11.0, 175.0]])


def begun(
    places_rad: np.ndarray, first_s: float = 0.0, start_s: float = 0.0, **rates: float
) -> np.ndarray:
    """Return the prior probabilities (n, 5) of what is first seen at places (n, 2)."""
    config = HypothesesConfig(areas=(AreaConfig(**BOX, start_s=start_s, rates=rates),))
    posteriors = AreaPosteriors.of(config, np.full(1, 1e-9), np.ones(1))
    place_m = geodetic_to_ecef(places_rad[:, 0], places_rad[:, 1], np.zeros(len(places_rad)))
    return posteriors.begun(place_m, 0.0, np.full(len(places_rad), first_s)).probability


def test_prior_odds_are_the_ratio_of_the_densities_within_the_area() -> None:
    probability = begun(INSIDE, launches_per_day=0.5)
    # 1000 ground sources a day in all of the view, as many to the area.
    ratio = 0.5 / (1000.0 * BOX_M2 / VIEW_M2)
    assert probability[:, LAUNCH] / probability[:, GROUND] == pytest.approx(ratio, rel=1e-8)


def test_a_rate_adds_to_its_own_kind_and_leaves_the_odds_of_others() -> None:
    usual, rare, frequent = (
        begun(INSIDE[:1], flashes_per_day=rate)[0] for rate in (0.0, 100.0, 300.0)
    )
    odds = [prior[LAUNCH] / prior[GROUND] for prior in (usual, rare, frequent)]
    assert odds == pytest.approx([1e-3] * 3, rel=1e-9)
    none = [prior[NONE] / prior[GROUND] for prior in (usual, rare, frequent)]
    assert none[2] - none[0] == pytest.approx(3.0 * (none[1] - none[0]), rel=1e-9)


def test_rates_hold_only_within_the_area_and_its_time() -> None:
    default = begun(OUTSIDE, flashes_per_day=7.5)
    elsewhere = begun(OUTSIDE, flashes_per_day=5e4)
    unchanged = begun(INSIDE, first_s=9.0, start_s=10.0, flashes_per_day=5e4)
    assert np.array_equal(elsewhere, default)
    assert np.array_equal(unchanged, default)
    lowered = begun(INSIDE, first_s=10.0, start_s=10.0, flashes_per_day=5e4)
    assert np.all(lowered[:, LAUNCH] < default[:, LAUNCH])


def tracked(*changes: str) -> Tracks:
    sensors = "sensors=[{constellation: SBIRS-GEO}]"
    changes = ("tracker=imm", sensors, "duration_s=40", "outputs=[]", *changes)
    return opir.simulate(opir.load_scene(SCENE, overrides=list(changes))).tracks


def test_odds_of_a_track_change_by_the_ratio_of_the_rates() -> None:
    """The lines are the same, so posterior odds change as the prior odds do: while nothing is decided,
    by a factor of ten for a tenth of the ground sources.
    """
    scene = opir.load_scene(SCENE)
    launch = scene.targets[0].model.config.launch
    box = (
        f"{{south_deg: {launch.lat_deg - 2}, north_deg: {launch.lat_deg + 2},"
        f" west_deg: {launch.lon_deg - 2}, east_deg: {launch.lon_deg + 2}"
    )
    area_m2 = (
        RADIUS_2_M2
        * (np.sin(np.radians(launch.lat_deg + 2)) - np.sin(np.radians(launch.lat_deg - 2)))
        * np.radians(4.0)
    )
    rate_per_day = 100.0 * area_m2 / VIEW_M2
    plain = tracked()
    within = tracked(
        f"tracker.hypotheses.areas=[{box}, rates: {{ground_sources_per_day: {rate_per_day}}}}}]"
    )
    assert np.array_equal(within.tick_s[:3], plain.tick_s[:3])
    odds = [
        tracks.probability_launch[:3] / tracks.hypothesis_probability[:3, 1]
        for tracks in (plain, within)
    ]
    assert odds[1] == pytest.approx(10.0 * odds[0], rel=1e-6)


@pytest.mark.parametrize(
    ("areas", "reason"),
    [
        ("[{BOX, rates: {flash_per_day: 1}}]", "no rate; the nearest is 'flashes_per_day'"),
        ("[{BOX, rates: {launches_per_day: 0}}]", "launches_per_day: 0.0 is outside"),
        ("[{BOX, rates: {launches_per_day: 1, flashes_per_day: -1}}]", "flashes_per_day: -1.0 is"),
        ("[{BOX, rates: {}}]", "give one at least"),
        ("[{BOX, start_s: 9, end_s: 9, rates: {flashes_per_day: 1}}]", "not after start_s"),
        (
            "[{BOX, rates: {flashes_per_day: 1}}, {BOX, rates: {flashes_per_day: 2}}]",
            r"areas\[1\] overlaps areas\[0\]",
        ),
        (
            "[{south_deg: 1, north_deg: 1, west_deg: 0, east_deg: 9, rates: {}}]",
            "south_deg 1 is not below north_deg 1",
        ),
    ],
)
def test_an_area_that_says_nothing_is_refused(areas: str, reason: str) -> None:
    box = "south_deg: -10, north_deg: 10, west_deg: 170, east_deg: -170"
    change = f"tracker.hypotheses.areas={areas.replace('BOX', box)}"
    with pytest.raises(SceneError, match=reason):
        opir.load_scene(SCENE, overrides=["tracker=imm", change])


def area(west_deg: float, east_deg: float, start_s: float = 0.0, end_s: float = 1e9) -> AreaConfig:
    return AreaConfig(
        south_deg=-1.0,
        north_deg=1.0,
        west_deg=west_deg,
        east_deg=east_deg,
        start_s=start_s,
        end_s=end_s,
        rates={"flashes_per_day": 1.0},
    )


@pytest.mark.parametrize(
    ("first", "second", "overlap"),
    [
        (area(0.0, 10.0), area(10.0, 20.0), False),
        (area(0.0, 10.0), area(9.0, 20.0), True),
        (area(170.0, -170.0), area(-175.0, 0.0), True),
        (area(170.0, -170.0), area(-170.0, 170.0), False),
        (area(-180.0, 180.0), area(5.0, 6.0), True),
        (area(0.0, 10.0, 0.0, 50.0), area(0.0, 10.0, 50.0), False),
    ],
)
def test_areas_overlap_in_place_and_time(
    first: AreaConfig, second: AreaConfig, overlap: bool
) -> None:
    assert first.overlaps(second) == second.overlaps(first) == overlap
