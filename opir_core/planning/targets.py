"""All targets of a scene, of all target models, in the order of the scene."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IndexArray
from opir_core.interfaces.optional import FreeFlight, WithClasses
from opir_core.interfaces.protocols import Sensor, Trajectories
from opir_core.scene.scene import EMITTER_TYPES


@frozen(eq=False)
class Targets:
    """The scene's targets: ids, type codes, times of ignition, burnout and end of flight, and trajectories by model.

    Target k is row `place[k]` of `trajectories[group[k]]`. `class_names` are target classes, and the types of other
    hot sources.
    """

    ids: tuple[str, ...]
    type_code: NDArray[np.uint8]
    ignition_s: FloatArray
    burnout_s: FloatArray
    end_s: FloatArray
    trajectories: tuple[Trajectories, ...]
    group: IndexArray
    place: IndexArray
    class_names: tuple[str, ...] = ()

    def observed_until_s(self, sensor: Sensor) -> FloatArray:
        """Return the scene times (n,) up to which a sensor observes the targets."""
        return self.end_s if sensor.follows_bodies else self.burnout_s

    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) of targets (n,) at scene times (n,), m; nan outside ignition to `end_s`."""
        if len(self.trajectories) == 1:
            return self.trajectories[0].position_ecef_m(target, time_s)
        positions = np.full((len(target), 3), np.nan)
        group = self.group[target]
        for number, trajectories in enumerate(self.trajectories):
            rows = np.flatnonzero(group == number)
            positions[rows] = trajectories.position_ecef_m(self.place[target[rows]], time_s[rows])
        return positions

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return one mapping of plain values per target, in the scene's order."""
        truths = [trajectories.truth() for trajectories in self.trajectories]
        return [truths[group][place] for group, place in zip(self.group.tolist(), self.place.tolist(), strict=True)]


def join_targets(ids: Sequence[str], trajectories: Sequence[Trajectories], rows: Sequence[Sequence[int]]) -> Targets:
    """Return all targets; `rows[g]` are the scene's numbers of the targets of `trajectories[g]`."""
    count = len(ids)
    group, place = np.zeros(count, dtype=np.int32), np.zeros(count, dtype=np.int32)
    type_code, end_s = np.zeros(count, dtype=np.uint8), np.zeros(count)
    ignition_s, burnout_s = np.zeros(count), np.zeros(count)
    class_names = [""] * count
    for number, (part, where) in enumerate(zip(trajectories, rows, strict=True)):
        index = np.asarray(where, dtype=np.int64)
        group[index], place[index] = number, np.arange(len(index))
        type_code[index], ignition_s[index], burnout_s[index] = part.type_code, part.ignition_s, part.burnout_s
        end_s[index] = part.end_s if isinstance(part, FreeFlight) else part.burnout_s
        for row, name in zip(where, _class_names(part), strict=True):
            class_names[row] = name
    return Targets(
        tuple(ids), type_code, ignition_s, burnout_s, end_s, tuple(trajectories), group, place, tuple(class_names)
    )


def _class_names(trajectories: Trajectories) -> Sequence[str]:
    """Return the class of each target of a model, by default its missile type."""
    if isinstance(trajectories, WithClasses):
        return trajectories.class_names
    return [EMITTER_TYPES[code] for code in trajectories.type_code.tolist()]
