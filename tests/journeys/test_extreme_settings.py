"""Every numeric setting of a scene at the ends of its range: the scene runs, or is refused with the
place, and nothing is blamed on a model.

Generated from the components that are installed: the least and the most that each setting takes,
and of those that may be 0 the smallest numbers above.
"""

import copy
import math
import typing
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np
import pytest
from attrs import fields

from opir_core import Host, simulate
from opir_core.errors import SceneError
from opir_core.host import components
from opir_core.reading import scene_from_mapping
from opir_core.scene import info_of

pytestmark = pytest.mark.slow

#: A scene of 12 s: settings of all kinds are read in it. A classifier that learns from looks would
#: take most of the time.
SCENE: dict[str, Any] = {
    "scene": "extreme",
    "epoch": "2026-04-01T20:00:00Z",
    "duration_s": 12.0,
    "seed": 4,
    "sensors": [{"model": "SBIRS-GEO", "id": "S", "orbital_slot_deg": -120.0}],
    "detection": "snr",
    "classification": "paper",
    "background": "earth",
    "targets": [
        {
            "id": "T1",
            "type": "SRBM",
            "launch": {"lat_deg": 34.7, "lon_deg": -120.6, "time_s": 0.0},
            "aim": {"lat_deg": 36.0, "lon_deg": -122.0},
        }
    ],
}

#: Where a component stands in a scene, and which components: one sensor has the settings of all,
#: but for those of a narrow field.
PLACES = {
    "SensorModel": ("SBIRS-GEO", "LEO-NARROW"),
    "DetectionModel": ("constant", "snr"),
    "ConfidenceModel": ("weighted",),
}

#: Blocks that need other settings of theirs: their own tests have them.
LEFT_OUT = {"orbit", "at_deg"}


@cache
def host() -> Host:
    return Host.discover()


def values_of(attribute: Any) -> list[float]:
    """Return the extremes of a numeric setting."""
    info = info_of(attribute)
    kinds = typing.get_args(attribute.type) or (attribute.type,)
    if int in kinds and float not in kinds:
        return [value for value in (info.minimum, info.maximum) if value is not None]
    if float not in kinds:
        return []
    values = [info.minimum, info.maximum]
    if info.above is not None:
        values += [math.nextafter(info.above, math.inf)]
    if info.below is not None:
        values += [math.nextafter(info.below, -math.inf)]
    if info.minimum == 0.0:
        values += [5e-324, 1e-300]
    return list(dict.fromkeys(float(value) for value in values if value is not None))


def settings_of(config: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield the paths and the attributes of the settings of a configuration class."""
    for attribute in fields(config):
        kinds = typing.get_args(attribute.type) or (attribute.type,)
        block = next((kind for kind in kinds if hasattr(kind, "__attrs_attrs__")), None)
        if attribute.name in LEFT_OUT:
            continue
        if block is not None:
            yield from settings_of(block, (*path, attribute.name))
        else:
            yield (*path, attribute.name), attribute


def configurations() -> Iterator[tuple[str, str, Any]]:
    for kind, names in PLACES.items():
        for name in names:
            yield kind, name, host().component(getattr(components, kind), name).config


def cases() -> list[Any]:
    made = []
    for kind, name, config in configurations():
        for path, attribute in settings_of(config):
            if name == "LEO-NARROW" and path[0] != "pointing":
                continue
            for value in values_of(attribute):
                label = f"{name}.{'.'.join(path)}={value}"
                made.append(pytest.param(kind, name, path, value, id=label))
    return made


def scene_with(kind: str, name: str, path: tuple[str, ...], value: float) -> dict[str, Any]:
    """Return the scene with one setting of one component."""
    scene = copy.deepcopy(SCENE)
    block: dict[str, Any] = {"model": name}
    inner = block
    for step in path[:-1]:
        inner = inner.setdefault(step, {})
    inner[path[-1]] = value
    if kind == "SensorModel":
        scene["sensors"] = [{"orbital_slot_deg": -120.0, **block, "id": "S"}]
    else:
        scene[{"DetectionModel": "detection", "ConfidenceModel": "confidence"}[kind]] = block
    return scene


@pytest.mark.parametrize(("kind", "name", "path", "value"), cases())
def test_the_end_of_a_range_runs_or_is_refused_with_its_place(
    kind: str, name: str, path: tuple[str, ...], value: float
) -> None:
    mapping = scene_with(kind, name, path, value)
    run = None
    with suppress(SceneError):  # which has the place; a model's error is none
        run = simulate(scene_from_mapping(mapping, host=host()))
    if run is None:
        return
    confidence = run.detections.confidence
    assert np.all((confidence >= 0.0) & (confidence <= 1.0))
    assert np.all(np.isfinite(run.detections.line_of_sight_ecef))


def test_settings_that_must_be_above_0_have_a_least_value() -> None:
    without = [
        f"{name}.{'.'.join(path)}"
        for _, name, config in configurations()
        for path, attribute in settings_of(config)
        if info_of(attribute).above == 0.0
    ]
    assert not without, "give the unit a least value: LEAST_BY_UNIT in opir_core/scene/fields.py"
