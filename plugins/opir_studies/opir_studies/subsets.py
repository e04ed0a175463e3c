"""Designs with some of the sensors of a scene: `sensors.keep`, `sensors.without` and
`sensors.count`.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from attrs import evolve

from opir_core import Scene
from opir_core.errors import nearest
from opir_studies.refusals import refusal

KEEP, WITHOUT, COUNT = SUBSET_PATHS = ("sensors.keep", "sensors.without", "sensors.count")
#: The value of `sensors.keep` for all sensors, and of `sensors.without` for none.
_ALL = "all"
_NONE = "none"


def with_subset(scene: Scene, settings: Mapping[str, Any]) -> Scene:
    """Return a scene with those of its sensors that settings by `SUBSET_PATHS` choose.

    Raises `SceneError`, at the path of the setting, for a value that chooses no sensor.
    """
    sensors = scene.sensors
    for path in SUBSET_PATHS:
        if path in settings:
            sensors = _chosen(path, settings[path], sensors)
    return evolve(scene, sensors=sensors)


def _chosen(path: str, value: Any, sensors: Sequence[Any]) -> tuple[Any, ...]:
    if path == COUNT:
        if type(value) is not int or not 1 <= value <= len(sensors):
            words = f"{value!r} is not a whole number from 1 to {len(sensors)}, the scene's sensors"
            raise refusal(path, words, "scene")
        return tuple(sensors[number * len(sensors) // value] for number in range(value))
    if value == (_ALL if path == KEEP else _NONE):
        return tuple(sensors)
    names = _named(path, value, sensors)
    selected = tuple(
        sensor
        for sensor in sensors
        if bool(names & {sensor.id, sensor.constellation}) == (path == KEEP)
    )
    if not selected:
        raise refusal(path, "leaves no sensor", "scene")
    return selected


def _named(path: str, value: Any, sensors: Sequence[Any]) -> set[str | None]:
    """Return the names of a value, one or a list of them, each the id of a sensor or the name of a
    constellation.
    """
    known_names = list(
        dict.fromkeys(
            name for sensor in sensors for name in (sensor.constellation, sensor.id) if name
        )
    )
    names = value if isinstance(value, list) else [value]
    for name in names:
        if name not in known_names:
            words = (
                f"no sensor or constellation is called {name!r}{nearest(str(name), known_names)}"
            )
            raise refusal(path, f"{words}; there are {', '.join(known_names)}", "scene")
    return set(names)


def parted(overrides: Sequence[str]) -> tuple[list[str], dict[str, Any]]:
    """Return the overrides of a scene's own paths, and the values by path of those that choose
    sensors.
    """
    remaining = list[str]()
    subset = dict[str, Any]()
    for override in overrides:
        path, _, text = override.partition("=")
        if path in SUBSET_PATHS:
            subset[path] = json.loads(text)
        else:
            remaining.append(override)
    return remaining, subset
