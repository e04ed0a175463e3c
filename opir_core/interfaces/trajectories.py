"""The contract of trajectories, which target models build.

The result of a row must not depend on the other rows of a call: the engine may pass any slice of a
run, and the bytes of the events must be the same.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

from opir_core.arrays import ByteArray, FloatArray, IndexArray
from opir_core.errors import Problem
from opir_core.flight.burns import one_burn_s
from opir_core.interfaces.contract import PluginPart, optional, required
from opir_core.scene.scene import EMITTER_TYPES


class Trajectories(PluginPart):
    """The trajectories of all targets of one model; by default of one burn each, up to burnout.

    >>> import numpy as np
    >>> class Pad(Trajectories):
    ...     type_code = np.zeros(1, dtype=np.uint8)
    ...     ignition_s, burnout_s = np.array([5.0]), np.array([65.0])
    ...
    ...     def position_ecef_m(self, target, time_s):
    ...         return np.full((len(time_s), 3), 3.7e6)
    ...
    ...     def truth(self):
    ...         return [{"id": "T1"}]
    >>> Pad().end_s, Pad().class_names
    (array([65.]), ['ICBM'])
    """

    @required
    def type_code(self) -> ByteArray:
        """Codes (n,) into `EMITTER_TYPES`: the missile type that a target's class resembles, the
        type that another source's kind resembles; required.
        """

    @required
    def ignition_s(self) -> FloatArray:
        """Scene times from which the plumes radiate, (n,) s; required."""

    @required
    def burnout_s(self) -> FloatArray:
        """Scene times to which the plumes radiate, (n,) s; required."""

    @abstractmethod
    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (m, 3) of targets (m,) at scene times (m,); nan before ignition and
        after the end.
        """

    @abstractmethod
    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return one mapping of plain values per target, for the truth file."""

    @optional
    def end_s(self) -> FloatArray:
        """Scene times up to which positions are known, (n,) s: impact, or burnout if no sensor
        follows targets.
        """
        return self.burnout_s

    @optional
    def glow_end_s(self) -> FloatArray:
        """Scene times up to which every sensor looks at the targets, (n,) s: burnout, or the end of
        a flight that the air keeps hot.
        """
        return self.burnout_s

    @optional
    def warnings(self) -> Sequence[Problem]:
        """What of the settings, or of the files they name, may be an error, each with its path in
        the scene.
        """
        return ()

    @optional
    def class_names(self) -> Sequence[str]:
        """Names of the target classes, or kinds of other sources, one per target; those of
        `type_code`, unless they are finer.
        """
        return [EMITTER_TYPES[code] for code in self.type_code.tolist()]

    @optional
    def burns_s(self) -> FloatArray:
        """Scene times (n, k, 2) of ignition and burnout of each burn, in order; nan where a target
        has fewer.

        The first begins at `ignition_s`, the last ends at `burnout_s`. Between burns plumes are
        dark, as after burnout.
        """
        return one_burn_s(self.ignition_s, self.burnout_s)

    @optional
    def course_breakpoints_s(self) -> FloatArray | None:
        """Scene times (n, k) at which the direction of flight jumps or bends, s; nan where there
        are fewer.
        """
        return None

    @optional
    def files(self) -> Sequence[Mapping[str, Any]]:
        """The `path` and `sha256` of each file that was read; the run manifest lists them."""
        return ()
