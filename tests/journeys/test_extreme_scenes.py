"""Extreme scenes: no warning, no nan where a number exists, no number where none exists.

Launches at the pole, on the antimeridian, under a satellite and at its limb; aims on the launch, a
kilometre and 20 000 km away; epochs of 1970 and 2099; looks a nanosecond apart.
`OPIR_EXTREME_SCENES=20000` asks for that many scenes.
"""

import math
import os

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings, strategies as st

from opir_core.errors import SceneError
from opir_core.geometry import Geodetic, geodesic_direct, geodetic_to_ecef, is_occluded
from opir_core.host.host import Host
from opir_core.planning.plan import compile_plan
from opir_core.reading import scene_from_mapping
from opir_core.simulation.run import simulate

pytestmark = pytest.mark.filterwarnings("error")

SCENES = int(os.environ.get("OPIR_EXTREME_SCENES", "60"))
HOST = Host.discover(["dsp", "sbirs", "nextgen"])

#: How far from the point under a geostationary satellite its limb is, degrees: acos(a/r).
LIMB_DEG = math.degrees(math.acos(6378137.0 / 42164172.0))

LATITUDES = st.sampled_from([90.0, -90.0, 89.9999999999, 0.0, 1e-300, -1e-9, 45.0]) | st.floats(
    -90.0, 90.0
)
LONGITUDES = st.sampled_from([180.0, -180.0, 179.99999999999997, 0.0, -1e-12]) | st.floats(
    -180.0, 180.0
)
HEIGHTS = st.sampled_from([0.0, -500.0, 9000.0, 1e-9])
RANGES_M = st.sampled_from([0.0, 1e-6, 1e3, 60e3, 1e6, 5.5e6, 1.2e7, 2.0e7]) | st.floats(0.0, 2.0e7)
EPOCHS = st.sampled_from(
    ["1970-01-01T00:00:00Z", "2026-04-01T12:00:00.000001Z", "2099-12-31T23:59:59.999999Z"]
)
FORCES = st.sampled_from(["kepler", "kepler", ["j2"], ["j2", "j3", "j4"], ["j2", {"drag": {}}]])
OFFSETS_DEG = st.sampled_from(
    [0.0, LIMB_DEG, -LIMB_DEG, LIMB_DEG + 1e-9, 180.0, 90.0, 1e-12]
) | st.floats(-180.0, 180.0)


@st.composite
def targets(draw, number):
    latitude = draw(LATITUDES)
    longitude = draw(LONGITUDES)
    bearing = draw(st.sampled_from([0.0, 90.0, 180.0, 270.0]) | st.floats(0.0, 360.0))
    range_m = draw(RANGES_M)
    place = geodesic_direct(
        *(math.radians(value) for value in (latitude, longitude, bearing)), range_m
    )
    aim = {"lat_deg": latitude, "lon_deg": longitude}
    if range_m > 0.0:
        aim = {"lat_deg": math.degrees(place[0]), "lon_deg": math.degrees(place[1])}
        aim = {
            key: max(-bound, min(bound, aim[key]))
            for key, bound in (("lat_deg", 90.0), ("lon_deg", 180.0))
        }
    return {
        "id": f"T{number}",
        "type": draw(st.sampled_from(["ICBM", "IRBM", "SRBM"])),
        "launch": {
            "lat_deg": latitude,
            "lon_deg": longitude,
            "height_m": draw(HEIGHTS),
            "time_s": draw(st.sampled_from([0.0, 1e-9, 5e-6, 0.2, 199.999999999])),
        },
        "aim": {**aim, "height_m": draw(HEIGHTS)},
    }


@st.composite
def sensors(draw, under, period_ms):
    """Return a satellite at some angle from a longitude, and one in a low orbit over it."""
    slot_deg = (under + draw(OFFSETS_DEG) + 180.0) % 360.0 - 180.0
    circular = {
        "altitude_km": draw(st.sampled_from([300.0, 1400.0, 35786.0])),
        "inclination_deg": draw(st.sampled_from([0.0, 90.0, 63.4])),
        "lon_asc_node_deg": under,
        "arg_latitude_deg": draw(st.sampled_from([0.0, 90.0, 180.0]) | st.floats(0.0, 359.0)),
    }
    phase = draw(st.sampled_from(["aligned", "random", "swept"]))
    return [
        {"model": "DSP", "id": "G", "orbital_slot_deg": slot_deg, "scan_period_ms": period_ms},
        {
            "model": "SBIRS-GEO",
            "id": "L",
            "orbit": {"circular": circular},
            "scan_period_ms": period_ms,
            "scan_phase": phase,
        },
    ]


@st.composite
def scenes(draw):
    """Return a scene of looks at usual distances, or of ten microseconds with a nanosecond between
    looks.
    """
    period_ms, duration_s = draw(st.sampled_from([(200.0, 400.0), (1e-6, 1e-5)]))
    launches = [draw(targets(number)) for number in range(draw(st.integers(1, 3)))]
    if duration_s < 1.0:
        launches = [
            {**launch, "launch": {**launch["launch"], "time_s": launch["launch"]["time_s"] % 9e-6}}
            for launch in launches
        ]
    return {
        "scene": "extreme",
        "epoch": draw(EPOCHS),
        "duration_s": duration_s,
        "light_time": draw(st.booleans()),
        "forces": draw(FORCES),
        "detection": draw(st.sampled_from(["always", "constant"])),
        "sensors": draw(sensors(launches[0]["launch"]["lon_deg"], period_ms)),
        "targets": launches,
    }


# Shrinking a scene takes minutes and says little more than the scene that was found.
@pytest.mark.slow
@settings(
    max_examples=SCENES,
    deadline=None,
    phases=[Phase.explicit, Phase.reuse, Phase.generate],
    suppress_health_check=list(HealthCheck),
)
@given(mapping=scenes())
def test_every_scene_has_its_numbers_or_says_why_not(mapping):
    scene = scene_from_mapping(mapping, host=HOST)
    try:
        plan = compile_plan(scene, HOST)
    except SceneError as error:
        assert_only_out_of_reach(mapping, str(error))
        return
    assert_trajectories(plan, mapping)
    assert_detections(plan, simulate(scene, HOST))


def assert_only_out_of_reach(mapping, reported):
    """Check that the targets refused are those whose aim lies outside all that their type flies."""
    refused = [
        number
        for number in range(len(mapping["targets"]))
        if f"targets[{number}].aim: " in reported
    ]
    assert refused
    assert reported.count("targets[") == len(refused)
    assert "no flight of" not in reported, reported


def assert_trajectories(plan, mapping):
    targets = plan.targets
    rows = np.arange(len(targets.ids), dtype=np.int32)
    start = targets.ignition_s
    end = targets.burnout_s
    for time_s in (start, 0.5 * (start + end), np.nextafter(end, 0.0), end, start + 1e-9):
        assert np.isfinite(targets.position_ecef_m(rows, time_s)).all()
    for time_s in (np.nextafter(start, -1.0), np.nextafter(end, np.inf)):
        assert np.isnan(targets.position_ecef_m(rows, time_s)).all()
    for reported, target in zip(targets.truth(), mapping["targets"], strict=True):
        assert reported["miss_m"] <= 0.01
        assert reported["impact"]["time_s"] > reported["burnout_s"]
        assert np.isfinite(
            [*reported["burnout"]["position_ecef_m"], *reported["burnout"]["velocity_ecef_m_s"]]
        ).all()
        launch = target["launch"]
        place = Geodetic(
            math.radians(launch["lat_deg"]), math.radians(launch["lon_deg"]), launch["height_m"]
        )
        start_m = targets.position_ecef_m(
            np.array([targets.ids.index(reported["id"])], np.int32),
            np.array([reported["ignition_s"]]),
        )
        assert np.linalg.norm(start_m - geodetic_to_ecef(*place)) <= 0.02


def assert_detections(plan, run):
    detections = run.detections
    truth = run.truth
    azimuth, elevation = detections.angles()
    for column in (
        detections.confidence,
        detections.line_of_sight_ecef,
        detections.sensor_ecef_m,
        azimuth,
        elevation,
    ):
        assert np.isfinite(column).all()
    for column in (
        truth.range_m,
        truth.emission_time_s,
        truth.probability,
        truth.target_elevation_rad,
    ):
        assert np.isfinite(column).all()
    assert ((detections.time_ns >= 0) & (detections.time_ns <= plan.end_ns)).all()
    assert ((azimuth >= 0.0) & (azimuth < 2.0 * np.pi) & (np.abs(elevation) <= 0.5 * np.pi)).all()
    np.testing.assert_allclose(
        np.sqrt((detections.line_of_sight_ecef**2).sum(axis=1)), 1.0, rtol=1e-15
    )
    assert ((truth.range_m > 0.0) & (truth.range_m < 1e8)).all()
    assert (truth.emission_time_s <= detections.time_s).all()
    burning = (truth.emission_time_s >= plan.targets.ignition_s[truth.target] - 1e-9) & (
        truth.emission_time_s <= plan.targets.burnout_s[truth.target] + 1e-9
    )
    assert burning.all()
    assert_in_view(plan, run)
    assert plan.pairs.looks.sum() == run.summary["counts"]["looks"]


def assert_in_view(plan, run):
    """Check that nothing is seen through the Earth: by the geometry of each detection, not by the
    plan's.
    """
    span = plan.targets.ignition_s[run.truth.target], plan.targets.burnout_s[run.truth.target]
    emitted = np.clip(run.truth.emission_time_s, *span)
    positions = plan.targets.position_ecef_m(run.truth.target, emitted)
    assert not is_occluded(run.detections.sensor_ecef_m, positions, -1.0).any()
