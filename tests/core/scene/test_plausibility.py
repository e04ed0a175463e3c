"""Allowed and implausible values are warned of, with the plausible range and the way to accept
them.
"""

from typing import Any

import pytest
from attrs import fields, frozen
from live_scene import mapping

from opir_core import compile_plan
from opir_core.cli.main import main
from opir_core.host.components import CATALOGUE
from opir_core.plugin import Component, Host, TrackerModel, number
from opir_core.reading import scene_from_mapping, scene_mapping
from opir_core.scene import implausible_defaults
from opir_core.scene.field_rows import field_rows
from opir_core.scene.plausibility import implausible_settings, implausible_values
from opir_core.simulation import plan_warnings


def scanner(**changes: Any) -> dict[str, Any]:
    return {"model": "generic-scanner", "id": "A", "orbital_slot_deg": -135.0, **changes}


CASES = {
    "scan_period_ms": (0.9, 1.0),
    "line_of_sight_sigma_urad": (50_000.0, 10_000.0),
    "nei_w_m2": (10.0, 1e-12),
    "bands": ({"UV": [0.1, 0.3]}, {"MWIR": [3.0, 5.0]}),
    "field_of_regard_half_angle_deg": (0.001, 10.0),
}


@pytest.mark.parametrize("key", CASES)
def test_an_implausible_value_is_named_with_its_range(key: str) -> None:
    wrong, right = CASES[key]
    assert not implausible_values(scene_from_mapping(mapping(sensors=[scanner(**{key: right})])))
    (problem,) = implausible_values(scene_from_mapping(mapping(sensors=[scanner(**{key: wrong})])))
    assert problem.path.startswith(f"sensors[0].{key}")
    assert "is outside the plausible" in problem.message


def test_zero_is_plausible_where_it_is_allowed() -> None:
    quiet = scanner(line_of_sight_sigma_urad=0.0)
    assert not implausible_values(scene_from_mapping(mapping(sensors=[quiet])))


def test_implausible_values_are_reported_unless_allowed(
    tmp_path: Any, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    import json

    implausible = mapping(sensors=[scanner(scan_period_ms=0.5)])
    (warning,) = plan_warnings(compile_plan(scene_from_mapping(implausible)))
    assert warning == (
        "sensors[0].scan_period_ms: 0.5 ms is outside the plausible 1 to 3.6e+06 ms; if it is"
        " meant, set"
        " allow_implausible: true"
    )
    allowed = scene_from_mapping({**implausible, "allow_implausible": True})
    assert not plan_warnings(compile_plan(allowed))
    assert scene_from_mapping(scene_mapping(allowed)) == allowed
    path = tmp_path / "scene.yaml"
    path.write_text(json.dumps(implausible), encoding="utf-8")
    assert main(["validate", str(path)]) == 0
    assert "is outside the plausible" in caplog.text + capsys.readouterr().err


def test_defaults_and_presets_of_every_component_are_plausible() -> None:
    host = Host.discover()
    for hook, kind in CATALOGUE.items():
        for name in host.names(hook) if issubclass(kind, Component) else ():
            component = host.component(hook, name)
            for row in field_rows(component.config):
                assert not row.is_required or row.default is None
            names = [attribute.name for attribute in fields(component.config)]
            needed = {"orbital_slot_deg": 0.0} if "orbital_slot_deg" in names else {}
            try:
                config = component.config(**needed)
            except (TypeError, ValueError):  # it has required settings
                continue
            assert not list(implausible_settings(config, name)), name


def test_the_check_finds_implausible_defaults_and_presets() -> None:
    @frozen(kw_only=True)
    class Config:
        width_um: float = number(help="width", unit="um", above=0.0, default=900.0)
        sigma_urad: float = number(help="sigma", unit="urad", minimum=0.0, default=1.0)

    component = TrackerModel(
        name="x",
        summary="x",
        config=Config,
        build=lambda *_: None,
        presets={"odd": {"sigma_urad": 1e9}},
    )
    problems = implausible_defaults(component, {"sigma_urad": 1e-9})
    assert {(problem.path, problem.message.split()[0]) for problem in problems} == {
        ("width_um", "900"),
        ("presets.odd.sigma_urad", "1e+09"),
        ("sigma_urad", "1e-09"),
    }


def test_a_field_may_have_a_range_of_its_own() -> None:
    @frozen(kw_only=True)
    class Config:
        depth: float = number(
            help="depth", unit="m", minimum=0.0, plausible=(1.0, 10.0), default=2.0
        )
        wide: float = number(help="wide", unit="um", minimum=1.0, maximum=20.0, default=2.0)

    assert [problem.path for problem in implausible_settings(Config(depth=11.0), "x")] == [
        "x.depth"
    ]
    rows = {row.key: row.bounds for row in field_rows(Config)}
    assert rows == {"depth": "m [0, inf), plausible 1 to 10", "wide": "um [1, 20]"}
