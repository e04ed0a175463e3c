"""The target model `ballistic`: where targets are, what truth says of them, and how the impossible
is refused.
"""

import json
import math

import numpy as np
import pytest
from core_components import HOST
from geographiclib.geodesic import Geodesic

from opir_core import SceneError
from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.plugin import TARGET_TYPES, TargetContext, TargetModel
from opir_core.reading import InvalidNode, class_reader, node_of_data

BALLISTIC = HOST.component(TargetModel, "ballistic")
CALIFORNIA = (34.73, -120.57)
KWAJALEIN = (9.0, 167.7)
KAUAI = (22.02, -159.78)
MARSHALL = (11.0, 171.0)


def a_target(kind, launch, aim, time_s=0.0, *, heights_m=(0.0, 0.0), **settings):
    places = [
        {"lat_deg": latitude, "lon_deg": longitude, "height_m": height_m}
        for (latitude, longitude), height_m in zip((launch, aim), heights_m, strict=True)
    ]
    ends = {"launch": {**places[0], "time_s": time_s}, "aim": places[1]}
    return read({"type": kind, **ends, **settings})


def read(settings):
    return class_reader(BALLISTIC.config)(node_of_data(settings))


def built(*configs):
    numbers = range(len(configs))
    context = TargetContext(
        ids=tuple(f"T{n}" for n in numbers), paths=tuple(f"targets[{n}]" for n in numbers)
    )
    return BALLISTIC.build(configs, context)


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


def test_a_boost_goes_from_its_launch_point_to_its_burnout(
    targets,
):
    for start, end, truth in zip(*ends_of(targets), targets.truth(), strict=True):
        assert np.linalg.norm(start - ecef_m(truth["launch"])) < 0.011
        assert np.linalg.norm(end - truth["burnout"]["position_ecef_m"]) < 0.011
        assert np.linalg.norm(end - ecef_m(truth["burnout"])) < 0.011


def test_positions_outside_the_burn_are_nan(targets):
    index = np.array([0, 0, 0, 1], dtype=np.int32)
    position = targets.position_ecef_m(index, np.array([9.999, 10.0, 260.001, 10.0]))
    assert np.isnan(position).all(axis=1).tolist() == [True, False, True, True]


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
    index = np.zeros(301, np.int32)
    position = targets.position_ecef_m(index + np.int32(1), times)
    assert position.tobytes() == alone.position_ecef_m(index, times).tobytes()
    assert {**targets.truth()[1], "id": "T0"} == alone.truth()[0]


def test_profile_and_burn_time_can_be_given():
    flown = built(
        a_target("ICBM", CALIFORNIA, KWAJALEIN, profile="ICBM_solid"),
        a_target("ICBM", CALIFORNIA, KWAJALEIN, burn_time_s=200.0),
    )
    assert flown.burnout_s.tolist() == [170.0, 200.0]
    assert [truth["profile"] for truth in flown.truth()] == ["ICBM_solid", "ICBM_liquid"]
    assert all(truth["miss_m"] <= 10.0 for truth in flown.truth())


def test_heights_of_launch_and_aim_count():
    targets = built(a_target("SRBM", MARSHALL, KWAJALEIN, heights_m=(1500.0, 3000.0)))
    (truth,) = targets.truth()
    assert truth["impact"]["height_m"] == pytest.approx(3000.0, abs=0.01)
    start, _ = ends_of(targets)
    assert np.linalg.norm(start[0] - ecef_m(truth["launch"])) < 0.011


def test_all_targets_out_of_reach_are_reported_at_once():
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
        ({"type": 7}, "text is needed"),
        ({"burn_time_s": 0.0}, "outside [10, 1000] s"),
        ({"profile": 7}, "text is needed"),
        *(
            ({place: {"lat_deg": 0.0, "lon_deg": 0.0, key: value}}, "outside")
            for place in ("launch", "aim")
            for key, value in (("lat_deg", 90.1), ("lon_deg", 180.1), ("height_m", 9001.0))
        ),
    ],
)
def test_invalid_settings_are_refused(settings, words):
    place = {"lat_deg": 0.0, "lon_deg": 0.0}
    with pytest.raises(InvalidNode) as caught:
        read({"type": "SRBM", "launch": place, "aim": place, **settings})
    (complaint,) = caught.value.complaints
    assert words in complaint.message
