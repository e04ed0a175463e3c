"""All targets of a scene, of all target models, in the order of the scene."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import Factory, field, frozen

from opir_core.arrays import BoolArray, ByteArray, FloatArray, IndexArray
from opir_core.errors import ModelError, kind_of, number_of
from opir_core.flight.burns import dark_gaps_s, in_gap, joined_burns_s, one_burn_s
from opir_core.interfaces.trajectories import Trajectories
from opir_core.notebook import html_view
from opir_core.scene.scene import TARGET_TYPES


@frozen(eq=False)
class Targets:
    """The scene's targets: ids, type codes, times of ignition, burnout and end of flight, and
    trajectories by model; `glow_end_s` (n,) is the time up to which every sensor looks.

    Target k is row `place[k]` of `trajectories[group[k]]`. `class_names` are target classes, and
    the types of other hot sources. `burns_s` (n, k, 2) are the scene times of ignition and burnout
    of each burn, nan where a target has fewer; between burns plumes are dark.
    """

    ids: tuple[str, ...]
    type_code: ByteArray
    ignition_s: FloatArray
    burnout_s: FloatArray
    end_s: FloatArray
    trajectories: tuple[Trajectories, ...]
    group: IndexArray
    place: IndexArray
    class_names: tuple[str, ...] = ()
    burns_s: FloatArray = field(
        default=Factory(lambda rows: one_burn_s(rows.ignition_s, rows.burnout_s), takes_self=True)
    )
    glow_end_s: FloatArray = field(default=Factory(lambda rows: rows.burnout_s, takes_self=True))
    dark_gaps_s: FloatArray = field(
        init=False, default=Factory(lambda rows: dark_gaps_s(rows.burns_s), takes_self=True)
    )

    def __repr__(self) -> str:
        """Return the number of targets with their classes, in one line."""
        return f"<Targets: {number_of('target', len(self.ids))}>"

    def _repr_html_(self) -> str:
        """Return ids, classes and times for a notebook."""
        columns = (self.ids, self.class_names, self.ignition_s.tolist(), self.burnout_s.tolist())
        head = ("target", "class", "ignition s", "burnout s")
        return html_view(self, head, list(zip(*columns, strict=True)))

    @property
    def is_launch(self) -> BoolArray:
        """Which of them (n,) are launches; the others are hot sources."""
        return self.type_code < len(TARGET_TYPES)

    def is_dark(self, target: IndexArray, time_s: FloatArray) -> BoolArray:
        """Return whether targets (n,) are in a dark gap between two burns at scene times (n,)."""
        return in_gap(self.dark_gaps_s, target, time_s)

    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) of targets (n,) at scene times (n,), m; nan outside ignition to
        `end_s`.
        """
        if len(self.trajectories) == 1:
            return _checked(self.trajectories[0].position_ecef_m(target, time_s), len(target))
        positions = np.full((len(target), 3), np.nan)
        group = self.group[target]
        for number, trajectories in enumerate(self.trajectories):
            rows = np.flatnonzero(group == number)
            of_model = trajectories.position_ecef_m(self.place[target[rows]], time_s[rows])
            positions[rows] = _checked(of_model, len(rows))
        return positions

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return one mapping of plain values per target, in the scene's order."""
        truths = [trajectories.truth() for trajectories in self.trajectories]
        return [
            truths[group][place]
            for group, place in zip(self.group.tolist(), self.place.tolist(), strict=True)
        ]


def _checked(position_m: Any, count: int) -> FloatArray:
    """Return positions of a target model; raises `ModelError` unless there is one for each of
    `count` times.
    """
    shape = getattr(position_m, "shape", kind_of(position_m))
    if shape != (count, 3):
        raise ModelError(
            f"a target model returned positions as {shape} for {count} times; ({count}, 3) is"
            f" required"
        )
    return position_m


def join_targets(
    ids: Sequence[str], trajectories: Sequence[Trajectories], rows: Sequence[Sequence[int]]
) -> Targets:
    """Return all targets; `rows[g]` are the scene's numbers of the targets of `trajectories[g]`."""
    count = len(ids)
    group = np.zeros(count, dtype=np.int32)
    place = np.zeros(count, dtype=np.int32)
    type_code = np.zeros(count, dtype=np.uint8)
    end_s = np.zeros(count)
    ignition_s = np.zeros(count)
    burnout_s = np.zeros(count)
    glow_end_s = np.zeros(count)
    class_names = [""] * count
    burns_s = list[FloatArray]()
    for number, (model_trajectories, where) in enumerate(zip(trajectories, rows, strict=True)):
        index = np.asarray(where, dtype=np.int64)
        group[index] = number
        place[index] = np.arange(len(index))
        type_code[index] = model_trajectories.type_code
        ignition_s[index] = model_trajectories.ignition_s
        burnout_s[index] = model_trajectories.burnout_s
        end_s[index] = model_trajectories.end_s
        glow_end_s[index] = model_trajectories.glow_end_s
        burns_s.append(model_trajectories.burns_s)
        for row, name in zip(where, model_trajectories.class_names, strict=True):
            class_names[row] = name
    return Targets(
        ids=tuple(ids),
        type_code=type_code,
        ignition_s=ignition_s,
        burnout_s=burnout_s,
        end_s=end_s,
        trajectories=tuple(trajectories),
        group=group,
        place=place,
        class_names=tuple(class_names),
        burns_s=_in_order(burns_s, rows),
        glow_end_s=glow_end_s,
    )


def _in_order(columns: Sequence[FloatArray], rows: Sequence[Sequence[int]]) -> FloatArray:
    """Return the burns (n, k, 2) of all targets in the scene's order; `rows[g]` are the numbers of
    those of part g.
    """
    if not columns:
        return np.empty((0, 1, 2))
    burns = joined_burns_s(columns)
    burns_s = np.empty_like(burns)
    burns_s[np.concatenate([np.asarray(where, dtype=np.int64) for where in rows])] = burns
    return burns_s
