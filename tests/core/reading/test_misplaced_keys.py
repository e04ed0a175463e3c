"""A key that means nothing where it stands: the message says where it belongs, by what is
installed.
"""

from collections.abc import Iterable

import opir_forecast.plugin
import opir_trackers.plugin
import pytest
from attrs import evolve, field, frozen
from fake_components import fake_host, good_mapping
from opir_trackers.configs import ImmConfig

from opir_core.errors import SceneError
from opir_core.plugin import AtmosphereModel, Host, NoConfig, SensorModel, hookimpl, nested, number
from opir_core.reading import scene_from_mapping
from opir_core.scene.field_rows import field_rows


@frozen(kw_only=True)
class Deck:
    top_km: float = number(help="height", default=10.0)


@frozen(kw_only=True)
class Haze:
    cloud: Deck | None = nested(help="a deck", default=None)
    thickness: float = number(help="how thick", default=1.0)
    derived: int = field(init=False, default=3)


@frozen(kw_only=True)
class Unknowable:
    """Its field's type is known to nobody, so nothing can be said of its keys."""

    cloud: "Fog" = number(help="fog", default=0.0)  # type: ignore[name-defined]  # noqa: F821


class Skies:
    @hookimpl
    def opir_atmosphere_models(self) -> Iterable[AtmosphereModel]:
        for name, config in (("fog", Unknowable), ("haze", Haze), ("vacuum", NoConfig)):
            yield AtmosphereModel(name=name, summary="air", config=config, build=print)


class Eyes:
    @hookimpl
    def opir_sensor_models(self) -> Iterable[SensorModel]:
        for number_ in range(7):
            yield SensorModel(
                name=f"EYE-{number_}", summary="looks through haze", config=Haze, build=print
            )


def complaints(host: Host, **blocks: object) -> list[str]:
    with pytest.raises(SceneError) as caught:
        scene_from_mapping({**good_mapping(), **blocks}, host=host)
    return [str(problem) for problem in caught.value.problems]


SCANNER = good_mapping()["sensors"][1]

IN_HAZE = "the atmosphere model haze, and this is clear; write model: haze to set it"

ALIGHT = (
    "the signature model flame (in a target's signature) or the source model fires (in sources)"
)

CASES = [
    (
        {"atmosphere": {"model": "clear", "cloud": {}}},
        f"atmosphere.cloud: unknown key; it belongs to {IN_HAZE}",
    ),
    (
        {"atmosphere": {"model": "clear", "top_km": 3}},
        f"atmosphere.top_km: unknown key; it belongs to cloud of {IN_HAZE}",
    ),
    (
        {"atmosphere": {"model": "haze", "top_km": 3}},
        "atmosphere.top_km: unknown key; it belongs in cloud",
    ),
    (
        {"top_km": 3},
        "top_km: unknown key; it belongs to cloud of the atmosphere model haze (in atmosphere)",
    ),
    (
        {"detection": {"model": "constant", "window_s": 3}},
        "detection.window_s: unknown key; it belongs to the tracker arc (in tracker)",
    ),
    (
        {"detection": {"model": "constant", "seed": 3}},
        "detection.seed: unknown key; it belongs to the top level of the scene",
    ),
    (
        {"outputs": [{"null": {"encoder": "flat"}}]},
        "outputs[0].null.encoder: unknown key; it belongs to the sink jsonl, and this is null",
    ),
    ({"peak_w_sr": 3}, f"peak_w_sr: unknown key; it belongs to {ALIGHT}"),
    (
        {"tracker": {"model": "arc", "derived": 3}},
        "tracker.derived: unknown key; known here: model, window_s",
    ),
]


@pytest.mark.parametrize(("blocks", "words"), CASES)
def test_the_message_says_where_the_key_belongs(blocks: dict[str, object], words: str) -> None:
    assert complaints(fake_host(Skies()), **blocks) == [words]


def test_of_many_models_some_are_named_and_the_others_counted() -> None:
    (of_a_model,) = complaints(fake_host(Eyes()), sensors=[{**SCANNER, "thickness": 2}])
    names = "EYE-0, EYE-1, EYE-2, EYE-3, EYE-4"
    assert f"it belongs to the sensor models {names} and 2 more, and this is STARER" in of_a_model
    assert of_a_model.endswith("write model: EYE-0, EYE-1, EYE-2, EYE-3 or EYE-4 to set it")


def test_a_constellation_chooses_its_model_itself() -> None:
    (of_a_fleet,) = complaints(
        fake_host(Eyes()), sensors=[{"constellation": "FLEET", "thickness": 2}]
    )
    assert of_a_fleet.endswith("and 2 more, and this is SCANNER")


def test_a_likely_slip_is_reported_first() -> None:
    sensors = [{**SCANNER, "row": 2}]
    assert complaints(fake_host(Eyes()), sensors=sensors) == [
        "sensors[0].row: unknown key; did you mean rows?"
    ]
    tracker = {"model": "arc", "windows_s": 2}
    assert complaints(fake_host(), tracker=tracker) == [
        "tracker.windows_s: unknown key; did you mean window_s?"
    ]


def test_a_key_in_other_letters_is_reported() -> None:
    tracker = {"model": "arc", "WINDOW_S": 2}
    assert complaints(fake_host(), tracker=tracker) == [
        "tracker.WINDOW_S: unknown key; did you mean window_s?"
    ]


def test_what_a_nested_block_leaves_out_is_as_in_its_own_default() -> None:
    """To set one key of a block a scene need not write all."""
    blocks = {
        "scene": "thrust",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 60,
        "sensors": [{"model": "generic-scanner", "id": "S-1", "orbital_slot_deg": -100.0}],
    }
    tracker = {"model": "imm", "thrust": {"tilt_deg": 4.0}}
    read, usual = (
        scene_from_mapping(
            {**blocks, "tracker": variant}, host=Host.of(opir_forecast.plugin, opir_trackers.plugin)
        ).tracker.config
        for variant in (tracker, "imm")
    )
    assert isinstance(usual, ImmConfig)
    assert read == evolve(usual, thrust=evolve(usual.thrust, tilt_deg=4.0))
    rows = {row.key: row for row in field_rows(type(usual))}
    assert rows["thrust.tilt_deg"].default_text == "3"
    assert rows["thrust.tilt_s"].default_text == "30"


def test_an_exact_key_of_another_model_is_reported() -> None:
    mapping = {"targets": [{**good_mapping()["targets"][0], "file": "x.csv"}]}
    (words,) = complaints(Host.discover(allowed=["readers"]), **mapping, **CORE)
    assert words == (
        "targets[0].file: unknown key; did you mean profile? Otherwise it belongs to the target"
        " model table, and this"
        " is ballistic; write model: table to set it"
    )


#: What of the scene of this test the core has components of.
CORE = {
    "sensors": [{"model": "generic-scanner", "id": "S", "orbital_slot_deg": 0.0}],
    "confidence": "weighted",
    "tracker": "none",
    "outputs": ["memory"],
}
