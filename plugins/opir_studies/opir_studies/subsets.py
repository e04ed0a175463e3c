"""Designs with some of the sensors of a scene: `sensors.keep`, `sensors.without` and
`sensors.count`.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from attrs import evolve

from opir_core import Scene
from opir_core.errors import Problem, SceneError, nearest

KEEP, WITHOUT, COUNT = SUBSET_PATHS = ("sensors.keep", "sensors.without", "sensors.count")
#: The value of `sensors.keep` for all sensors, and of `sensors.without` for none.
_ALL = "all"
_NONE = "none"


def with_subset(scene: Scene, chosen: Mapping[str, Any]) -> Scene:
    """Return a scene with those of its sensors that settings by `SUBSET_PATHS` choose.

    Raises `SceneError`, at the path of the setting, for a value that chooses no sensor.
    """
    sensors = scene.sensors
    for path in SUBSET_PATHS:
        if path in chosen:
            sensors = _chosen(path, chosen[path], sensors)
    return evolve(scene, sensors=sensors)


def _chosen(path: str, value: Any, sensors: Sequence[Any]) -> tuple[Any, ...]:
    if path == COUNT:
        if type(value) is not int or not 1 <= value <= len(sensors):
            raise _refused(
                path,
                f"{value!r} is not a whole number from 1 to {len(sensors)}, the scene's sensors",
            )
        return tuple(sensors[number * len(sensors) // value] for number in range(value))
    if value == (_ALL if path == KEEP else _NONE):
        return tuple(sensors)
    names = _named(path, value, sensors)
    left = tuple(
        each for each in sensors if bool(names & {each.id, each.constellation}) == (path == KEEP)
    )
    if not left:
        raise _refused(path, "leaves no sensor")
    return left


def _named(path: str, value: Any, sensors: Sequence[Any]) -> set[str | None]:
    """Return the names of a value, one or a list of them, each the id of a sensor or the name of a
    constellation.
    """
    known = list(
        dict.fromkeys(name for each in sensors for name in (each.constellation, each.id) if name)
    )
    names = value if isinstance(value, list) else [value]
    for name in names:
        if name not in known:
            words = f"no sensor or constellation is called {name!r}{nearest(str(name), known)}"
            raise _refused(path, f"{words}; there are {', '.join(known)}")
    return set(names)


def _refused(path: str, words: str) -> SceneError:
    return SceneError([Problem(path, words)], source="scene")


def parted(overrides: Sequence[str]) -> tuple[list[str], dict[str, Any]]:
    """Return the overrides of a scene's own paths, and the values by path of those that choose
    sensors.
    """
    own = list[str]()
    chosen = dict[str, Any]()
    for each in overrides:
        path, _, text = each.partition("=")
        if path in SUBSET_PATHS:
            chosen[path] = json.loads(text)
        else:
            own.append(each)
    return own, chosen
