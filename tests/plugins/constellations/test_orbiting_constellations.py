"""The fleets in high ellipses and low orbits: what they are, that they come and go, and that
nothing else is needed.
"""

import importlib
import itertools
import math
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from repository import ROOT
from sgp4.api import Satrec

from opir_core import simulate
from opir_core.geometry import ecef_to_geodetic
from opir_core.orbits import OrbitConfig
from opir_core.plugin import REPORTED_TYPES, TARGET_TYPES, SensorContext
from opir_core.reading import scene_from_mapping
from opir_core.scene.fields import field_infos

PACKAGES = ("opir_heo", "opir_leo")
DAY_S = 86164.1

for package in PACKAGES:
    # Where the plugins are not installed, their sources are tested.
    if find_spec(package) is None:
        sys.path.append(str(ROOT / "plugins" / package))

PLUGINS = {package: importlib.import_module(f"{package}.plugin") for package in PACKAGES}
MODELS = {model.name: model for plugin in PLUGINS.values() for model in plugin.opir_sensor_models()}
FLEETS = {
    fleet.name: fleet for plugin in PLUGINS.values() for fleet in plugin.opir_constellations()
}


def sensors_of(name):
    """Return the sensors of a fleet, built from its own settings."""
    fleet = FLEETS[name]
    scene = scene_from_mapping(scene_with([{"constellation": name}], []))
    model = MODELS[fleet.model]
    return [
        model.build(chosen.model.config, SensorContext(id=chosen.id, epoch_us=scene.epoch_us))
        for chosen in scene.sensors
    ]


def scene_with(sensors, targets, **settings):
    return {
        "scene": "orbits",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 300.0,
        "seed": 3,
        "sensors": sensors,
        "targets": targets,
        **settings,
    }


def launch(time_s, latitude_deg=55.0, longitude_deg=90.0, **settings):
    place = {"lat_deg": latitude_deg, "lon_deg": longitude_deg, "time_s": time_s}
    aim = {"lat_deg": latitude_deg - 40.0, "lon_deg": longitude_deg + 60.0}
    return {"id": f"T{time_s:.0f}", "type": "ICBM", "launch": place, "aim": aim, **settings}


@pytest.mark.parametrize("name", MODELS)
def test_every_default_is_cited_or_called_notional(name):
    infos = field_infos(MODELS[name].config)
    assert all(info.source for info in infos.values())
    for field in (
        "bands",
        "scan_period_ms",
        "detection_probability",
        "line_of_sight_sigma_urad",
        "confusion",
    ):
        assert infos[field].source == "notional"


@pytest.mark.parametrize("name", MODELS)
def test_confusion_rows_sum_to_1(name):
    confusion = next(
        iter(sensors_of(next(fleet for fleet, each in FLEETS.items() if each.model == name)))
    ).confusion
    assert list(confusion) == list(TARGET_TYPES)
    for row in confusion.values():
        assert set(row) == set(REPORTED_TYPES)
        assert math.fsum(row.values()) == pytest.approx(1.0, abs=1e-12)


def test_an_orbit_is_required():
    with pytest.raises(ValueError, match="either orbital_slot_deg or orbit"):
        MODELS["HEO"].config()


@pytest.mark.parametrize(
    ("name", "period_s", "count"), [("HEO-MOLNIYA", DAY_S / 2, 3), ("HEO-TUNDRA", DAY_S, 2)]
)
def test_elliptical_fleets_pass_one_apogee_by_turns(name, period_s, count):
    time_s = np.arange(0.0, period_s, 10.0)
    passed = []
    for sensor in sensors_of(name):
        position = sensor.orbit.position_ecef_m(time_s)
        apogee = int(np.argmax(np.linalg.norm(position, axis=1)))
        place = ecef_to_geodetic(position[apogee])
        assert math.degrees(float(place.latitude_rad)) == pytest.approx(63.4, abs=0.3)
        assert math.degrees(float(place.longitude_rad)) == pytest.approx(-90.0, abs=0.5)
        passed.append(time_s[apogee])
    assert sorted(passed) == pytest.approx(np.arange(count) * period_s / count, abs=30.0)


@pytest.mark.parametrize(("name", "total", "planes"), [("LEO-WIDE", 24, 6), ("LEO-MEDIUM", 12, 3)])
def test_low_fleets_are_walker_patterns(name, total, planes):
    positions = np.stack(
        [sensor.orbit.position_ecef_m(np.zeros(1))[0] for sensor in sensors_of(name)]
    )
    assert len(positions) == total
    assert np.linalg.norm(positions, axis=1) == pytest.approx(6378137.0 + 1.2e6, rel=1e-9)
    angles = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    assert angles[~np.eye(total, dtype=bool)].min() > 1.5e6
    assert total % planes == 0


def test_an_elliptical_satellite_comes_and_goes():
    launches = [launch(time_s) for time_s in (600.0, 21_000.0, 43_000.0)]
    heo = {
        "model": "HEO",
        "id": "H",
        "orbit": {"molniya": {"apogee_lon_deg": 90.0, "apogee_time_s": 600.0}},
    }
    run = simulate(scene_from_mapping(scene_with([heo], launches, duration_s=44_000.0)))
    seen = {run.target_ids[row] for row in np.unique(run.truth.target)}
    # At 21 000 s, near perigee, the satellite is deep in the south; by 43 000 s it is over the
    # other apogee.
    assert "T600" in seen
    assert "T21000" not in seen


@pytest.mark.slow
def test_low_satellites_take_over_from_one_another():
    # A satellite 700 km up has a place in view for about a quarter of an hour; launches go on for
    # one.
    low = {"total": 60, "planes": 6, "phasing": 1, "altitude_km": 700.0, "inclination_deg": 60.0}
    fleet = [
        {
            "model": "LEO-WIDE",
            "id": f"L{number:02d}",
            "orbit": {"walker": {**low, "satellite": number, "lon_asc_node_deg": 0.0}},
        }
        for number in range(1, 61)
    ]
    launches = [launch(100.0 + 300.0 * number) for number in range(12)]
    run = simulate(scene_from_mapping(scene_with(fleet, launches, duration_s=4000.0)))
    watching = [
        set(run.detections.sensor[run.truth.target == target].tolist())
        for target in range(len(launches))
    ]
    assert all(watching)
    assert not watching[0] & watching[-1]
    assert all(one & other for one, other in itertools.pairwise(watching))


def gmst_rad(julian_day):
    """Return Greenwich mean sidereal time, IAU 1982 (Vallado, eq. 3-45), of UT1 taken as UTC."""
    t = (julian_day - 2451545.0) / 36525.0
    seconds = (
        67310.54841 + (876600.0 * 3600.0 + 8640184.812866) * t + 0.093104 * t**2 - 6.2e-6 * t**3
    )
    return math.radians(seconds / 240.0 % 360.0)


#: A Molniya and a low satellite among the verification cases of SGP4 (Vallado and others, AIAA
#: 2006-6753).
TLE = {
    "HEO": (
        "1 08195U 75081A   06176.33215444  .00000099  00000-0  11873-3 0   813",
        "2 08195  64.1586 279.0717 6877146 264.7651  20.2257  2.00491383225656",
    ),
    "LEO-WIDE": (
        "1 06251U 62025E   06176.82412014  .00008885  00000-0  12808-3 0  3985",
        "2 06251  58.0579  54.0425 0030035 139.1568 221.1854 15.56387291  6774",
    ),
}


@pytest.mark.parametrize("name", TLE)
def test_a_satellite_flies_its_mean_elements(name):
    satellite = Satrec.twoline2rv(*TLE[name])
    epoch_us = 1151193600_000_000  # 2006-06-25T00:00:00Z
    model = MODELS[name]
    sensor = model.build(
        model.config(orbit=OrbitConfig(tle=TLE[name])), SensorContext(id="S", epoch_us=epoch_us)
    )
    for time_s in (0.0, 40_000.0, 90_000.0):
        day = 2453911.5
        fraction = time_s / 86400.0
        error, (x, y, z), _ = satellite.sgp4(day, fraction)
        angle = gmst_rad(day + fraction)
        turned = (
            math.cos(angle) * x + math.sin(angle) * y,
            math.cos(angle) * y - math.sin(angle) * x,
            z,
        )
        assert error == 0
        # A double holds a Julian day to 40 us, in which the Earth turns by 3e-9 rad.
        assert sensor.orbit.position_ecef_m(np.array([time_s]))[0] * 1e-3 == pytest.approx(
            turned, abs=2e-4
        )


def test_mean_elements_go_through_a_whole_scene():
    low = {"model": "LEO-WIDE", "id": "L", "orbit": {"tle": list(TLE["LEO-WIDE"])}}
    overhead = simulate(scene_from_mapping(scene_with([low], [], epoch="2006-06-25T12:00:00Z")))
    place = ecef_to_geodetic(overhead.sensors[0].orbit.position_ecef_m(np.array([60.0])))
    below = launch(
        10.0,
        math.degrees(float(place.latitude_rad[0])),
        math.degrees(float(place.longitude_rad[0])),
    )
    below["aim"] = {"lat_deg": 0.0, "lon_deg": below["launch"]["lon_deg"] - 60.0}
    run = simulate(scene_from_mapping(scene_with([low], [below], epoch="2006-06-25T12:00:00Z")))
    assert len(run.detections) > 100


def test_warm_bodies_are_seen_in_long_waves_only():
    sensors = [
        {"constellation": "LEO-MEDIUM"},
        {"constellation": "LEO-WIDE", "follows_bodies": True},
    ]
    settings = {"duration_s": 900.0, "detection": "snr", "background": "earth"}
    run = simulate(scene_from_mapping(scene_with(sensors, [launch(10.0)], **settings)))
    burnout_s = run.summary["targets"][0]["burnout_s"]
    # A nozzle glows in shorter waves for minutes after a burn.
    late = (run.truth.target == 0) & (run.truth.emission_time_s > burnout_s + 300.0)
    medium = np.array([sensor.type == "LEO-MEDIUM" for sensor in run.sensors])[
        run.detections.sensor
    ]
    assert np.count_nonzero(late & medium) > 100
    assert np.count_nonzero(late & ~medium) == 0
    lwir = 1 << [band.name for band in run.sensors[0].bands].index("LWIR")
    assert (run.detections.bands[late & medium] & lwir).all()
