"""Optional abilities of components: a component that has all members of one of these protocols is used for it.

The engine, the live run and the sinks ask with `isinstance`, once, when they are made. A component that has some of the
members and not all of them fails the conformance tests of its hook.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

from opir_core.arrays import FloatArray


@runtime_checkable
class FreeFlight(Protocol):
    """`Trajectories` of targets that can be followed after burnout."""

    @property
    def end_s(self) -> FloatArray:
        """Scene times up to which positions are known, (n,) s: impact, or burnout if no sensor follows targets."""


@runtime_checkable
class WithClasses(Protocol):
    """`Trajectories` of targets of classes finer than the missile types; without it the class is the missile type."""

    @property
    def class_names(self) -> Sequence[str]:
        """Names of the target classes, one per target."""


@runtime_checkable
class WithBurns(Protocol):
    """`Trajectories` of targets with several burns; without it a plume radiates from ignition to burnout."""

    @property
    def burns_s(self) -> FloatArray:
        """Scene times (n, k, 2) of ignition and burnout of each burn, in order; nan where a target has fewer.

        The first begins at `ignition_s`, the last ends at `burnout_s`. Where one does not follow at once, the plume is
        dark: only sensors that follow bodies observe the target, as after burnout.
        """


@runtime_checkable
class FromFiles(Protocol):
    """`Trajectories` that are read from files; the run manifest lists them."""

    @property
    def files(self) -> Sequence[Mapping[str, Any]]:
        """The `path` and `sha256` of each file."""
