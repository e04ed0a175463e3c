"""The general scanning sensor: what its configuration refuses, what is built of it, and other
defaults for heirs.
"""

import math
import pickle

import numpy as np
import pytest
from attrs import fields_dict
from hypothesis import given, strategies as st

from opir_core.constants import (
    EARTH_EQUATORIAL_RADIUS_M,
    EARTH_MU_M3_S2,
    EARTH_ROTATION_RAD_S,
    GEOSTATIONARY_RADIUS_M,
)
from opir_core.orbits import GeostationaryOrbit
from opir_core.plugin import (
    ScanningSensorConfig,
    SensorContext,
    cited,
    scanning_sensor,
    with_defaults,
)
from opir_core.scene.fields import field_infos

NEEDED = {
    "orbital_slot_deg": 10.0,
    "bands": {"SWIR": (2.5, 3.0), "MWIR": (4.0, 5.0)},
    "scan_period_ms": 100.0,
    "detection_probability": {"ICBM": 0.8, "IRBM": 0.7, "SRBM": 0.5},
}
ROW = {"ICBM": 0.5, "UNKNOWN": 0.5}


@with_defaults(
    bands=cited({"LWIR": (8.0, 12.0)}, "a book"),
    scan_period_ms=40,
    detection_probability={"ICBM": 0.9, "SRBM": 0.4},
    confusion={"ICBM": ROW, "SRBM": {"SRBM": 1.0}},
)
class HeirConfig(ScanningSensorConfig):
    """A sensor of a plugin."""


def built(config):
    return scanning_sensor(config, SensorContext(id="X-1", epoch_us=0), type="X")


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ({"orbital_slot_deg": 181.0}, r"outside \[-180, 180\] deg"),
        ({"scan_period_ms": 0.0}, "outside"),
        ({"scan_period_ms": 1e-7}, "outside"),
        ({"scan_period_ms": 1.5e-6}, "whole number of nanoseconds"),
        ({"scan_period_ms": 1000.0 / 3.0}, r"whole number of nanoseconds; write 333\.333333"),
        ({"scan_period_ms": math.nan}, "not a finite number"),
        ({"scan_pattern": "spiral"}, "not one of spin, step-stare, staring"),
        ({"scan_phase": "late"}, "not one of aligned, random, swept"),
        ({"raster_rows": 0}, "outside"),
        ({"raster_columns": 2.5}, "not whole numbers"),
        ({"bands": {}}, "1 to 8 band names"),
        ({"bands": {f"B{n}": (1.0, 2.0) for n in range(9)}}, "1 to 8 band names"),
        ({"bands": {"SWIR": (3.0, 2.5)}}, "SWIR: .*lower_um < upper_um"),
        ({"bands": {"SWIR": (2.5,)}}, "SWIR: .*lower_um < upper_um"),
        ({"bands": {"SWIR": ("2.5", "3")}}, "SWIR: .*lower_um < upper_um"),
        ({"bands": {"SWIR": (0.0, 3.0)}}, "0 < lower_um"),
        ({"detection_probability": {"ICBM": 1.2}}, r"outside \[0, 1\]"),
        ({"detection_probability": {"ICBM": "0.2"}}, "not a probability"),
        ({"field_of_regard_half_angle_deg": 0.0}, "outside"),
        ({"minimum_elevation_deg": -91.0}, "outside"),
        ({"line_of_sight_sigma_urad": -1.0}, "outside"),
        ({"false_alarm_susceptibility": "none"}, "not one of high, moderate, low"),
        (
            {"spectral_discrimination": "ratio"},
            "not one of likelihood, none, dual-band-ratio, triple-coincidence",
        ),
        (
            {"spectral_discrimination": "triple-coincidence"},
            "compares 3 bands and the sensor has 2",
        ),
        ({"confusion": {"ICBM": {"ICBM": 0.9}}}, "sums to 0.9, not to 1"),
        ({"confusion": {"ICBM": {"ICBM": 1.0 + 2e-9}}}, "not a probability"),
        ({"confusion": {"ICBM": {"ICBM": 0.5, "IRBM": 0.5 + 2e-9}}}, "not to 1"),
        ({"confusion": {"ICBM": 1.0}}, "not a mapping of reported types"),
    ],
)
def test_settings_that_cannot_be_meant_are_refused_in_words(setting, words):
    with pytest.raises(ValueError, match=words):
        ScanningSensorConfig(**{**NEEDED, **setting})


def test_rows_that_sum_to_1_within_1e_9_are_taken():
    ScanningSensorConfig(**NEEDED, confusion={"ICBM": {"ICBM": 0.5, "IRBM": 0.5 + 5e-10}})


@given(st.integers(min_value=1, max_value=86_400_000_000_000))
def test_a_period_is_exact_to_the_nanosecond(period_ns):
    config = ScanningSensorConfig(**{**NEEDED, "scan_period_ms": period_ns / 1e6})
    assert config.scan_period_ns == period_ns


def test_what_is_built_is_what_was_set_in_si_units():
    sensor = built(
        ScanningSensorConfig(**NEEDED, line_of_sight_sigma_urad=20.0, minimum_elevation_deg=5.0)
    )
    assert (sensor.id, sensor.type, sensor.orbital_slot_deg) == ("X-1", "X", 10.0)
    assert [(band.name, band.lower_um, band.upper_um) for band in sensor.bands] == [
        ("SWIR", 2.5, 3.0),
        ("MWIR", 4.0, 5.0),
    ]
    assert sensor.scan.period_ns == 100_000_000
    assert sensor.line_of_sight_sigma_rad == pytest.approx(2e-5)
    assert sensor.minimum_elevation_rad == pytest.approx(math.radians(5.0))
    assert sensor.confusion == {}
    assert sensor.settings["scan_period_ms"] == 100.0


def test_the_default_field_of_regard_covers_the_earth_and_a_limb():
    sensor = built(ScanningSensorConfig(**NEEDED))
    limb_rad = math.asin((EARTH_EQUATORIAL_RADIUS_M + 900e3) / GEOSTATIONARY_RADIUS_M)
    assert limb_rad < sensor.field_of_regard_half_angle_rad < 1.2 * limb_rad


def test_heirs_have_their_own_defaults_in_inherited_units():
    config = HeirConfig(orbital_slot_deg=1.0)
    assert config.scan_period_ns == 40_000_000
    infos = field_infos(HeirConfig)
    inherited = field_infos(ScanningSensorConfig)
    assert infos["bands"].source == "a book"
    assert infos["scan_period_ms"].source == "notional"
    assert (infos["scan_period_ms"].unit, infos["scan_period_ms"].interval) == (
        "ms",
        inherited["scan_period_ms"].interval,
    )
    assert list(infos) == list(inherited)
    with pytest.raises(ValueError, match="outside"):
        HeirConfig(orbital_slot_deg=1.0, scan_period_ms=-1.0)


def test_the_class_inherited_from_keeps_its_defaults():
    with pytest.raises(TypeError, match="bands"):
        ScanningSensorConfig(orbital_slot_deg=0.0)
    assert fields_dict(ScanningSensorConfig)["line_of_sight_sigma_urad"].default == 20.0


def test_a_default_for_no_field_is_refused():
    with pytest.raises(TypeError, match="LostConfig has no field scan_perod_ms"):

        @with_defaults(scan_perod_ms=1.0)
        class LostConfig(ScanningSensorConfig):
            pass


def test_configurations_of_heirs_can_be_pickled():
    config = HeirConfig(orbital_slot_deg=1.0)
    assert pickle.loads(pickle.dumps(config)) == config


def test_a_partial_mapping_overrides_only_the_types_it_names():
    sensor = built(
        HeirConfig(
            orbital_slot_deg=1.0, detection_probability={"SRBM": 0.1}, confusion={"SRBM": ROW}
        )
    )
    assert sensor.detection_probability == {"ICBM": 0.9, "SRBM": 0.1}
    assert sensor.confusion == {"ICBM": ROW, "SRBM": ROW}
    assert sensor.settings["detection_probability"] == sensor.detection_probability


def test_the_geostationary_radius_balances_gravity_and_rotation():
    pull = EARTH_MU_M3_S2 / GEOSTATIONARY_RADIUS_M**2
    whirl = EARTH_ROTATION_RAD_S**2 * GEOSTATIONARY_RADIUS_M
    assert pull == pytest.approx(whirl, rel=1e-14)


@given(
    st.floats(min_value=-180.0, max_value=180.0),
    st.lists(st.floats(min_value=0.0, max_value=1e6), max_size=4),
)
def test_a_geostationary_satellite_stays_over_its_longitude(slot_deg, times):
    orbit = GeostationaryOrbit(slot_deg)
    positions = orbit.position_ecef_m(np.array(times))
    assert orbit.is_stationary
    assert positions.shape == (len(times), 3)
    for x, y, z in positions.tolist():
        assert math.hypot(x, y) == pytest.approx(42_164_172.4, abs=1.0)
        assert math.degrees(math.atan2(y, x)) == pytest.approx(slot_deg, abs=1e-9)
        assert z == 0.0
