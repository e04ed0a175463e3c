"""What a hot object may be: the hypotheses that classifiers, trackers and outputs of a scene
share.
"""

from collections.abc import Iterable
from functools import cache
from types import MappingProxyType
from typing import Any

from attrs import frozen

from opir_core.scene.scene import REPORTED_TYPES, UNKNOWN_TYPE
from opir_core.scene.target_classes import (
    EquilibriumGlide,
    OrbitInsertion,
    TargetClass,
    core_target_classes,
)

#: Groups of hypotheses. `ground` is a source that stands on the ground (fire, flare, glint,
#: industry), `bolide` a brief bright one; the next three are launches: what comes down, what stays
#: in orbit, what glides; `none` is none of these.
GROUPS = ("noise", "ground", "bolide", "missile", "orbit", "glide", "none")

#: Groups of what was launched.
LAUNCH_GROUPS = ("missile", "orbit", "glide")

#: Groups of target classes by what follows burnout; others are missiles.
_GROUP_AFTER = MappingProxyType({OrbitInsertion: "orbit", EquilibriumGlide: "glide"})

_FIRST = (("noise", "noise"), ("ground source", "ground"), ("bolide", "bolide"))
_LAST = ("none of these", "none")


@frozen
class Hypothesis:
    """What a hot object may be, with its group in `GROUPS`; those of launches have their target
    class.
    """

    name: str
    group: str
    target_class: TargetClass | None = None

    @property
    def is_launch(self) -> bool:
        """Whether it is a target class."""
        return self.target_class is not None

    @property
    def reported_type(self) -> str:
        """Return the right answer among `REPORTED_TYPES`."""
        return (
            REPORTED_TYPES[UNKNOWN_TYPE]
            if self.target_class is None
            else self.target_class.reported_type
        )


def hypotheses_of(classes: Iterable[TargetClass]) -> tuple[Hypothesis, ...]:
    """Return the hypotheses of target classes, by group and least range, between those that every
    scene has.

    >>> from opir_core.scene import core_hypotheses
    >>> [hypothesis.name for hypothesis in core_hypotheses()][:5]
    ['noise', 'ground source', 'bolide', 'SRBM', 'IRBM']
    """
    groups: Any = _GROUP_AFTER
    launches = [
        Hypothesis(
            target_class.name, groups.get(type(target_class.after_burnout), "missile"), target_class
        )
        for target_class in classes
    ]
    launches.sort(key=_order)
    return (*(Hypothesis(*row) for row in _FIRST), *launches, Hypothesis(*_LAST))


def _order(launch: Hypothesis) -> tuple[int, float, str]:
    assert launch.target_class is not None
    least_m = min(profile.minimum_range_m for profile in launch.target_class.profiles)
    return GROUPS.index(launch.group), least_m, launch.name


@cache
def core_hypotheses() -> tuple[Hypothesis, ...]:
    """Return the hypotheses of the core's own target classes."""
    return hypotheses_of(core_target_classes().values())
