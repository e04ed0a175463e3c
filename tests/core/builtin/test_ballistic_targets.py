"""The target model `ballistic`: where targets are, what truth says of them, and how the impossible
is refused.
"""

import json
import math

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic

from opir_core import SceneError
from opir_core.builtin import BallisticConfig
from opir_core.builtin.configs import AimConfig, LaunchConfig
from opir_core.builtin.targets import ballistic_targets
from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.plugin import TARGET_TYPES, TargetContext

CALIFORNIA = (34.73, -120.57)
KWAJALEIN = (9.0, 167.7)
KAUAI = (22.02, -159.78)
MARSHALL = (11.0, 171.0)


def a_target(kind, launch, aim, time_s=0.0, **settings):
    return BallisticConfig(
        type=kind,
        launch=LaunchConfig(lat_deg=launch[0], lon_deg=launch[1], time_s=time_s),
        aim=AimConfig(lat_deg=aim[0], lon_deg=aim[1]),
        **settings,
    )


def built(*configs):
    numbers = range(len(configs))
    context = TargetContext(
        ids=tuple(f"T{n}" for n in numbers), paths=tuple(f"targets[{n}]" for n in numbers)
    )
    return ballistic_targets(configs, context)


RANGE_TEST = (
    a_target("ICBM", CALIFORNIA, KWAJALEIN, 10.0),
    a_target("IRBM", KAUAI, KWAJALEIN, 40.0),
    a_target("SRBM", MARSHALL, KWAJALEIN, 65.0),
)


@pytest.fixture(scope="module")
def targets():
    return built(*RANGE_TEST)


def ends_of(targets):
    """Return positions (n, 3) at ignition and at burnout."""
    everyone = np.arange(len(targets.type_code), dtype=np.int32)
    return (
        targets.position_ecef_m(everyone, times)
        for times in (targets.ignition_s, targets.burnout_s)
    )


def ecef_m(place):
    """Return the ECEF position of a geodetic place of the truth, by the textbook formula."""
    latitude = math.radians(place["lat_deg"])
    longitude = math.radians(place["lon_deg"])
    height = place["height_m"]
    e2 = (1 / 298.257223563) * (2 - 1 / 298.257223563)
    normal = 6378137.0 / math.sqrt(1 - e2 * math.sin(latitude) ** 2)
    across = (normal + height) * math.cos(latitude)
    up = (normal * (1 - e2) + height) * math.sin(latitude)
    return np.array([across * math.cos(longitude), across * math.sin(longitude), up])


def test_types_and_burning_times(targets):
    assert [TARGET_TYPES[code] for code in targets.type_code] == ["ICBM", "IRBM", "SRBM"]
    assert targets.ignition_s.tolist() == [10.0, 40.0, 65.0]
    assert [truth["profile"] for truth in targets.truth()] == ["ICBM_liquid", "IRBM", "SRBM"]
    assert (targets.burnout_s - targets.ignition_s).tolist() == [250.0, 140.0, 65.0]


def test_a_target_starts_at_its_launch_point_and_ends_its_boost_at_the_burnout_of_the_truth(
    targets,
):
    for start, end, truth in zip(*ends_of(targets), targets.truth(), strict=True):
        assert np.linalg.norm(start - ecef_m(truth["launch"])) < 0.011
        assert np.linalg.norm(end - truth["burnout"]["position_ecef_m"]) < 0.011
        assert np.linalg.norm(end - ecef_m(truth["burnout"])) < 0.011


def test_positions_outside_the_burn_are_nan(targets):
    index = np.array([0, 0, 0, 1], dtype=np.int32)
    found = targets.position_ecef_m(index, np.array([9.999, 10.0, 260.001, 10.0]))
    assert np.isnan(found).all(axis=1).tolist() == [True, False, True, True]


def test_the_arc_from_burnout_comes_down_on_the_aim_point(targets):
    for truth in targets.truth():
        impact = truth["impact"]
        gap = Geodesic.WGS84.Inverse(
            impact["lat_deg"], impact["lon_deg"], truth["aim"]["lat_deg"], truth["aim"]["lon_deg"]
        )
        assert truth["miss_m"] <= 10.0
        assert gap["s12"] == pytest.approx(truth["miss_m"], abs=0.001)
        assert impact["time_s"] > truth["burnout_s"]


def test_an_independent_integration_of_the_arc_agrees(targets):
    """Integrate the two-body equation from the truth's burnout state to its impact time, in the
    frame of the Earth.
    """
    from scipy.integrate import solve_ivp

    for truth in targets.truth():
        position = np.array(truth["burnout"]["position_ecef_m"])
        whirl = np.array([0.0, 0.0, EARTH_ROTATION_RAD_S])
        velocity = np.array(truth["burnout"]["velocity_ecef_m_s"]) + np.cross(whirl, position)
        flight_s = truth["impact"]["time_s"] - truth["burnout_s"]

        def pull(_time, state):
            return [*state[3:], *(-EARTH_MU_M3_S2 * state[:3] / np.linalg.norm(state[:3]) ** 3)]

        end = solve_ivp(
            pull, (0.0, flight_s), [*position, *velocity], method="DOP853", rtol=1e-12, atol=1e-6
        )
        turn = EARTH_ROTATION_RAD_S * flight_s
        x, y, z = end.y[:3, -1]
        landed = [
            x * math.cos(turn) + y * math.sin(turn),
            -x * math.sin(turn) + y * math.cos(turn),
            z,
        ]
        assert np.linalg.norm(landed - ecef_m(truth["aim"])) < 0.1


def test_truth_is_plain_and_names_its_targets(targets):
    truth = targets.truth()
    assert json.loads(json.dumps(truth)) == truth
    assert [row["id"] for row in truth] == ["T0", "T1", "T2"]
    assert truth[0]["launch"] == {"lat_deg": 34.73, "lon_deg": -120.57, "height_m": 0.0}


def test_a_target_does_not_depend_on_the_others(targets):
    alone = built(RANGE_TEST[1])
    times = np.linspace(40.0, 180.0, 301)
    here = targets.position_ecef_m(np.full(301, 1, np.int32), times)
    assert here.tobytes() == alone.position_ecef_m(np.zeros(301, np.int32), times).tobytes()
    assert {**targets.truth()[1], "id": "T0"} == alone.truth()[0]


def test_profile_and_burn_time_can_be_given():
    found = built(
        a_target("ICBM", CALIFORNIA, KWAJALEIN, profile="ICBM_solid"),
        a_target("ICBM", CALIFORNIA, KWAJALEIN, burn_time_s=200.0),
    )
    assert found.burnout_s.tolist() == [170.0, 200.0]
    assert [truth["profile"] for truth in found.truth()] == ["ICBM_solid", "ICBM_liquid"]
    assert all(truth["miss_m"] <= 10.0 for truth in found.truth())


def test_heights_of_launch_and_aim_count():
    config = BallisticConfig(
        type="SRBM",
        launch=LaunchConfig(lat_deg=11.0, lon_deg=171.0, height_m=1500.0),
        aim=AimConfig(lat_deg=9.0, lon_deg=167.7, height_m=3000.0),
    )
    targets = built(config)
    (truth,) = targets.truth()
    assert truth["impact"]["height_m"] == pytest.approx(3000.0, abs=0.01)
    start, _ = ends_of(targets)
    assert np.linalg.norm(start[0] - ecef_m(truth["launch"])) < 0.011


def test_all_targets_out_of_reach_are_reported_at_once_with_the_distance_and_the_ranges():
    with pytest.raises(SceneError) as refusal:
        built(
            a_target("SRBM", CALIFORNIA, KWAJALEIN),
            RANGE_TEST[0],
            a_target("ICBM", MARSHALL, KWAJALEIN),
            a_target("ICBM", CALIFORNIA, KWAJALEIN, profile="ICBM_soild"),
            a_target("IRBM", KAUAI, KAUAI),
        )
    problems = {problem.path: problem.message for problem in refusal.value.problems}
    assert list(problems) == [
        "targets[0].aim",
        "targets[2].aim",
        "targets[3].profile",
        "targets[4].aim",
    ]
    kilometres = Geodesic.WGS84.Inverse(*CALIFORNIA, *KWAJALEIN)["s12"] / 1e3
    assert f"{kilometres:.0f} km from the launch point; SRBM flies" in problems["targets[0].aim"]
    assert "ICBM_liquid flies" in problems["targets[2].aim"]
    assert "; of type ICBM there is also ICBM_solid, " in problems["targets[2].aim"]
    assert "no boost profile 'ICBM_soild'; there are" in problems["targets[3].profile"]
    assert "is 0 km from the launch point" in problems["targets[4].aim"]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"type": 7}, "not text"),
        ({"burn_time_s": 0.0}, r"outside \[10, 1000\] s"),
        ({"profile": 7}, "not text"),
    ],
)
def test_settings_that_cannot_be_meant_are_refused(settings, words):
    places = {
        "launch": LaunchConfig(lat_deg=0.0, lon_deg=0.0),
        "aim": AimConfig(lat_deg=1.0, lon_deg=1.0),
    }
    with pytest.raises(ValueError, match=words):
        BallisticConfig(**{"type": "SRBM", **places, **settings})


@pytest.mark.parametrize(
    ("place", "value"), [("lat_deg", 90.1), ("lon_deg", 180.1), ("height_m", 9001.0)]
)
@pytest.mark.parametrize("kind", [LaunchConfig, AimConfig])
def test_places_off_the_globe_are_refused(kind, place, value):
    with pytest.raises(ValueError, match="outside"):
        kind(**{"lat_deg": 0.0, "lon_deg": 0.0, place: value})
