"""Looks that a sensor should have had on targets that others see, and those that it had.

A sensor that points elsewhere, scatters far more than it states, or is blind has no look near the
targets on which the others agree. Its own looks, if there are any, meet nobody else's: however many
they are, they are its word against that of all others.
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_estimation.registration.misfits import LAW


@frozen(eq=False)
class Agreement:
    """Sums over slices and targets of each sensor (s,), with exponential forgetting.

    `expected` are slices with a look on a target that two others see, by its scans and chances of
    detection, `shared` those that had one; `alone` counts its other looks.
    """

    expected: FloatArray
    shared: FloatArray
    alone: FloatArray

    @classmethod
    def of(cls, sensors: int) -> "Agreement":
        """Return the sums before the first look."""
        return cls(*np.zeros((3, sensors)))

    def faded(self, step_s: float) -> "Agreement":
        """Return the sums a step later."""
        decay = np.exp(-step_s / LAW.memory_s)
        return Agreement(decay * self.expected, decay * self.shared, decay * self.alone)

    def after(
        self, looks: FloatArray, total: FloatArray, is_seen: BoolArray, chance: FloatArray
    ) -> "Agreement":
        """Return the sums after a slice with `looks` (n, s) on tracks and `total` (s,) looks.

        `is_seen` (n, s) are the sensors that have seen each track, `chance` (n, s) their
        probabilities of a look in the slice, 0 out of view.
        """
        has_look = looks > 0.0
        others = is_seen.sum(axis=1)[:, None] - is_seen
        is_known = (others >= 2) & (has_look.sum(axis=1)[:, None] > has_look)
        with_others = np.where(others >= 2, looks, 0.0).sum(axis=0)
        return Agreement(
            self.expected + np.where(is_known, chance, 0.0).sum(axis=0),
            self.shared + np.where(is_known & (chance > 0.0), has_look, 0.0).sum(axis=0),
            self.alone + total - with_others,
        )

    @property
    def contradicts(self) -> BoolArray:
        """Whether each sensor (s,) misses what others see far more often than chance has it."""
        is_enough = self.expected > LAW.expected_looks
        return is_enough & (self.shared < LAW.shared_share * self.expected)
