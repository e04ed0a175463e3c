"""From an `orbit:` block to the orbit: nodes, anomalies, files, and what is imported on the way."""

import json
import math
import subprocess
import sys

import numpy as np
import pytest

from opir_core import PluginError, SceneError
from opir_core.geometry import gmst_rad
from opir_core.orbits import (
    CircularConfig,
    KeplerConfig,
    OmmFileConfig,
    OrbitConfig,
    SlotConfig,
    elements_of,
    orbit_of,
)

EPOCH_US = 1_775_044_800_000_000
OMM = {
    "OBJECT_NAME": "ISS (ZARYA)",
    "OBJECT_ID": "1998-067A",
    "NORAD_CAT_ID": 25544,
    "EPOCH": "2008-09-20T12:25:40.104192",
    "MEAN_MOTION": 15.72125391,
    "ECCENTRICITY": 0.0006703,
    "INCLINATION": 51.6416,
    "RA_OF_ASC_NODE": 247.4627,
    "ARG_OF_PERICENTER": 130.536,
    "MEAN_ANOMALY": 325.0288,
    "BSTAR": -1.1606e-05,
}
OMM_EPOCH_US = int(np.datetime64(OMM["EPOCH"], "us").astype(np.int64))


def circular(**node):
    return OrbitConfig(circular=CircularConfig(altitude_km=1200.0, inclination_deg=53.0, **node))


def test_a_node_by_longitude_stands_there_at_the_scene_epoch():
    for epoch_us in (0, EPOCH_US, 4_102_444_800_000_000):
        x, y, z = orbit_of(circular(lon_asc_node_deg=40.0), epoch_us).position_ecef_m(np.zeros(1))[
            0
        ]
        assert math.degrees(math.atan2(y, x)) == pytest.approx(40.0, abs=1e-9)
        assert z == pytest.approx(0.0, abs=1e-3)


def test_a_node_by_right_ascension_is_less_the_sidereal_time():
    elements = elements_of(circular(raan_deg=40.0), EPOCH_US)
    sidereal = float(gmst_rad(np.datetime64("2026-04-01T12:00:00")))
    assert elements is not None
    assert elements.node_longitude_rad == pytest.approx(math.radians(40.0) - sidereal, abs=1e-12)


def test_the_argument_of_latitude_moves_the_satellite_along():
    config = OrbitConfig(
        circular=CircularConfig(
            altitude_km=700.0, inclination_deg=98.0, lon_asc_node_deg=0.0, arg_latitude_deg=90.0
        )
    )
    position = orbit_of(config, 0).position_ecef_m(np.zeros(1))[0]
    assert math.degrees(math.asin(position[2] / np.linalg.norm(position))) == pytest.approx(
        82.0, abs=1e-9
    )


@pytest.mark.parametrize(
    ("true_deg", "mean_deg"), [(0.0, 0.0), (180.0, 180.0), (-180.0, -180.0), (360.0, 0.0)]
)
def test_true_and_mean_anomaly_agree_at_the_apsides(true_deg, mean_deg):
    shared = {
        "semi_major_axis_km": 26_562.0,
        "eccentricity": 0.7,
        "inclination_deg": 63.4,
        "lon_asc_node_deg": 10.0,
        "arg_perigee_deg": 270.0,
    }
    by_true = orbit_of(OrbitConfig(kepler=KeplerConfig(**shared, true_anomaly_deg=true_deg)), 0)
    by_mean = orbit_of(OrbitConfig(kepler=KeplerConfig(**shared, mean_anomaly_deg=mean_deg)), 0)
    time_s = np.linspace(0.0, 4000.0, 9)
    assert by_true.position_ecef_m(time_s) == pytest.approx(
        by_mean.position_ecef_m(time_s), rel=0.0, abs=1e-3
    )


def test_an_inclined_slot_goes_north_at_the_scene_epoch():
    config = OrbitConfig(slot=SlotConfig(lon_deg=-75.0, inclination_deg=5.0))
    x, y, z = orbit_of(config, EPOCH_US).position_ecef_m(np.array([-60.0, 0.0, 60.0])).T
    assert math.degrees(math.atan2(y[1], x[1])) == pytest.approx(-75.0, abs=1e-9)
    assert z[0] < 0.0 < z[2]


def files(tmp_path, content):
    path = tmp_path / "omm.json"
    path.write_text(content, encoding="utf-8")
    return str(path)


def file_orbit(path, satellite=None):
    return OrbitConfig(omm_file=OmmFileConfig(path=path, satellite=satellite))


def test_an_omm_file_gives_what_the_omm_itself_does(tmp_path):
    expected = orbit_of(OrbitConfig(omm=OMM), OMM_EPOCH_US).position_ecef_m(np.zeros(1))
    for content in (OMM, [OMM]):
        config = file_orbit(files(tmp_path, json.dumps(content)))
        assert np.array_equal(orbit_of(config, OMM_EPOCH_US).position_ecef_m(np.zeros(1)), expected)


@pytest.mark.parametrize(
    ("content", "satellite", "words"),
    [
        ("{", None, "is not JSON"),
        ("3", None, "holds no OMM; exactly one is needed"),
        ("[{}, {}]", None, "holds 2 OMM; exactly one is needed; say which with satellite"),
        (json.dumps([OMM]), "HST", "holds no OMM of HST; exactly one is needed"),
        (json.dumps([OMM, OMM]), "25544", "holds 2 OMM of 25544; exactly one is needed"),
        (json.dumps({**OMM, "REF_FRAME": "GCRF"}), None, "REF_FRAME: 'GCRF' is not TEME"),
    ],
)
def test_a_file_that_holds_no_omm_is_refused(tmp_path, content, satellite, words):
    path = files(tmp_path, content)
    with pytest.raises(SceneError) as caught:
        orbit_of(file_orbit(path, satellite), OMM_EPOCH_US)
    (problem,) = caught.value.problems
    assert problem.path == "orbit.omm_file.path"
    assert problem.message.startswith(f"{path}: ")
    assert words in str(caught.value)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(SceneError, match="cannot be read: no such file"):
        orbit_of(file_orbit(str(tmp_path / "none.json")), OMM_EPOCH_US)
    binary = tmp_path / "binary.json"
    binary.write_bytes(b"{}\n\xc3\x28")
    with pytest.raises(SceneError, match="line 2: is not UTF-8 text"):
        orbit_of(file_orbit(str(binary)), OMM_EPOCH_US)


def test_without_sgp4_the_way_out_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "sgp4.api", None)
    with pytest.raises(PluginError, match=r"needs the package sgp4; .* pip install '.\[sgp4\]'"):
        orbit_of(OrbitConfig(omm=OMM), OMM_EPOCH_US)


def test_orbits_without_sgp4_do_not_import_it():
    code = (
        "import sys; import numpy as np; from opir_core.orbits import *;"
        "orbit_of(OrbitConfig(molniya=MolniyaConfig(apogee_lon_deg=0.0)),"
        " 0).position_ecef_m(np.zeros(3));"
        "roots = {name.split('.')[0] for name in sys.modules};"
        "assert not roots & {'sgp4', 'scipy'}, roots;"
        "flight = {name for name in sys.modules if name.startswith('opir_core.flight.')};"
        "assert not {f'opir_core.flight.{name}' for name in ('propagation', 'drag', 'gravity',"
        " 'dop853')} & flight"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
