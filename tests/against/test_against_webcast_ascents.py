"""The target model `ascent` and the class SLV against forty real space launches, by their webcasts.

`tests/data/webcast_ascents.csv` has what was shown of each; opir's programs were not fitted to it.
"""

import csv

import numpy as np
import pytest
from opir_readers.ascent_legs import height_of
from opir_readers.ascents import legs_of
from opir_readers.configs import AscentConfig
from repository import DATA

import opir_core as opir
from opir_core.geometry import ecef_to_geodetic

with (DATA / "webcast_ascents.csv").open(encoding="utf-8") as file:
    FLIGHTS = list(csv.DictReader(line for line in file if not line.startswith("#")))


def shown(name):
    """Return the values of a column (n,), of flights that show one."""
    return np.array([float(row[name]) for row in FLIGHTS if row[name]])


@pytest.fixture(scope="module")
def ascent():
    legs = legs_of(AscentConfig(lat_deg=28.6, lon_deg=-80.6))
    times, places, speeds = (np.concatenate([leg[column] for leg in legs]) for column in range(3))
    heights = np.array([height_of(place) for place in places]) / 1e3
    return times, heights, np.linalg.norm(speeds, axis=1)


def test_there_are_forty_flights():
    assert len(FLIGHTS) == 40


@pytest.mark.parametrize("time_s", [60, 100, 140])
def test_an_ascent_is_one_of_them_at_all_times_of_its_first_burn(ascent, time_s):
    times, heights, speeds = ascent
    for column, values in ((f"km_{time_s}", heights), (f"m_s_{time_s}", speeds)):
        least, most = np.quantile(shown(column), [0.0, 1.0])
        assert least <= np.interp(time_s, times, values) <= most


def test_the_first_cut_off_of_an_ascent_is_one_of_theirs(ascent):
    times, heights, speeds = ascent
    config = AscentConfig(lat_deg=28.6, lon_deg=-80.6)
    end_s = config.first_burn_s
    before_s = end_s - 10.0
    height_km, speed_m_s, earlier_m_s = (
        float(np.interp(moment, times, values))
        for moment, values in ((end_s, heights), (end_s, speeds), (before_s, speeds))
    )
    for column, value in (
        ("cut_off_s", end_s),
        ("cut_off_km", height_km),
        ("cut_off_m_s", speed_m_s),
        ("cut_off_m_s2", (speed_m_s - earlier_m_s) / 10.0),
        ("gap_s", config.gap_s),
    ):
        least, most = np.quantile(shown(column), [0.0, 1.0])
        assert least <= value <= most, column


def test_the_second_cut_off_of_an_ascent_is_one_of_theirs(ascent):
    times, _, speeds = ascent
    config = AscentConfig(lat_deg=28.6, lon_deg=-80.6)
    end_s = config.first_burn_s + config.gap_s + config.second_burn_s
    speed_m_s = float(np.interp(end_s, times, speeds))
    assert shown("second_cut_off_s").min() <= end_s <= shown("second_cut_off_s").max()
    assert speed_m_s == pytest.approx(float(np.median(shown("second_cut_off_m_s"))), rel=0.05)


def test_the_class_slv_is_not_one_of_them():
    """One smooth burn: too fast early, too slow at staging, and never dark."""
    scene = {
        "scene": "launch",
        "epoch": "2018-03-01T00:00:00Z",
        "duration_s": 60,
        "seed": 1,
        "sensors": [{"model": "generic-scanner", "id": "S", "orbital_slot_deg": -75.0}],
        "targets": [
            {
                "id": "T",
                "type": "SLV",
                "azimuth_deg": 90.0,
                "launch": {"lat_deg": 28.6, "lon_deg": -80.6, "time_s": 10.0},
            }
        ],
        "outputs": [],
    }
    targets = opir.compile_plan(opir.scene_from_mapping(scene)).targets
    assert targets.burns_s.shape[1] == 1
    for time_s, side in ((60, 1), (140, -1)):
        moments = 10.0 + time_s + np.array([-0.05, 0.05])
        place = targets.position_ecef_m(np.zeros(2, dtype=np.int32), moments)
        speed = float(np.linalg.norm(place[1] - place[0]) / 0.1)
        least, most = np.quantile(shown(f"m_s_{time_s}"), [0.0, 1.0])
        assert (speed > most) if side > 0 else (speed < least)
        assert ecef_to_geodetic(place).height_m[0] > 0.0
