"""Quantities with units at the Python door."""

import pytest
import yaml
from opir_studies import Study
from repository import EXAMPLES

import opir_core

TO_SECONDS = {"s": 1.0, "ms": 1e-3, "min": 60.0}


class OfAstropy:
    """Stands in for astropy's quantity of time: `unit` and `to_value`."""

    def __init__(self, value, unit):
        self.value = value
        self.unit = unit

    def to_value(self, unit):
        if unit not in TO_SECONDS:
            raise ValueError("not convertible")
        return self.value * TO_SECONDS[self.unit] / TO_SECONDS[unit]

    def __str__(self):
        return f"{self.value} {self.unit}"


class OfPint(OfAstropy):
    """Stands in for pint's: `units` and `m_as`."""

    to_value = property()

    def __init__(self, value, unit):
        super().__init__(value, unit)
        self.units = unit
        del self.unit

    def m_as(self, unit):
        return self.value * TO_SECONDS[self.units] / TO_SECONDS[unit]

    def __str__(self):
        return f"{self.value} {self.units}"


def with_settings(sensor=(), **keys):
    scene = yaml.safe_load((EXAMPLES / "first_light.yaml").read_text(encoding="utf-8"))
    scene["sensors"][0].update(sensor)
    return opir_core.scene_from_mapping({**scene, **keys})


@pytest.mark.parametrize("kind", [OfAstropy, OfPint])
def test_a_quantity_is_a_number_in_the_unit_of_its_setting(kind):
    scene = with_settings({"scan_period_ms": kind(0.125, "s")}, duration_s=kind(2, "min"))
    assert scene == with_settings({"scan_period_ms": 125.0}, duration_s=120.0)


@pytest.mark.parametrize("kind", [OfAstropy, OfPint])
@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"orbital_slot_deg": 3}, "3 s is not a number of the unit deg"),
        ({"id": 3}, "3 s has a unit, and this setting has none; text is needed"),
        ({"scan_period_ms": 0}, "0.0 is outside"),
    ],
)
def test_a_quantity_of_another_dimension_is_refused_with_its_place(kind, settings, words):
    place = next(iter(settings))
    with pytest.raises(opir_core.SceneError, match=rf"sensors\[0\]\.{place}: {words}"):
        with_settings({name: kind(value, "s") for name, value in settings.items()})


def test_quantities_of_a_study_are_numbers_in_the_unit_that_ends_the_name():
    path = "sensors[*].scan_period_ms"
    block = {"from": OfPint(0.05, "s"), "to": OfPint(0.2, "s"), "count": 3}
    study = Study(
        scene={"duration_s": OfAstropy(2, "min")},
        vary={path: [OfAstropy(0.125, "s"), 250]},
        conditions={path: block},
        overrides={"duration_s": OfPint(2, "min")},
    )
    assert study.scene == {"duration_s": 120.0}
    assert study.vary == {path: [125.0, 250]}
    assert study.conditions == {path: {"from": 50.0, "to": 200.0, "count": 3}}
    assert study.overrides == {"duration_s": 120.0}
    with pytest.raises(opir_core.SceneError, match="x_deg: 2 s is not a number of the unit deg"):
        Study(scene="scene.yaml", vary={"x_deg": [OfAstropy(2, "s")]})


@pytest.mark.peers
def test_units_of_settings_are_those_of_astropy():
    units = pytest.importorskip("astropy.units")
    sensor = {
        "orbital_slot_deg": -2.0 * units.rad,
        "scan_period_ms": 0.125 * units.s,
        "nei_w_m2": 3e-16 * units.W / units.cm**2,
    }
    config = with_settings(sensor).sensors[0].model.config
    assert config.orbital_slot_deg == pytest.approx(-114.59155902616465)
    assert config.scan_period_ms == 125.0
    assert config.nei_w_m2 == pytest.approx(3e-12)
    with pytest.raises(
        opir_core.SceneError, match=r"\[1\. 2\.\] ms is not a number of the unit ms"
    ):
        with_settings({"scan_period_ms": [1, 2] * units.ms})
