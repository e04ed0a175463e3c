"""What the switching filter asks of a mode."""

from collections.abc import Callable
from typing import Protocol

from opir_core.arrays import FloatArray


class Dynamics(Protocol):
    """What the switching filter asks of a mode: how its states (n, d) move, and how looks see them."""

    @property
    def size(self) -> int:
        """Return the size of the state."""
        ...

    @property
    def about(self) -> "Callable[[FloatArray, FloatArray], Dynamics] | None":
        """Return what tells of means (n, d) and roots (n, d, d) of information how states move that are known so well.

        None says that they move alike however well they are known.
        """
        ...

    def propagated(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states after steps (n,), s."""
        ...

    def transition(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return the transition matrices (n, d, d) of steps (n,) about states."""
        ...

    def noise_root(self, step_s: FloatArray, state: FloatArray) -> FloatArray | None:
        """Return a root (n, d, k) of the covariance of the noise gathered in steps (n,), or None."""
        ...

    def taylor(self, state: FloatArray) -> FloatArray:
        """Return the derivatives (n, 5, 3) of the position."""
        ...

    def seen(self, slope: FloatArray, weight: FloatArray, state: FloatArray) -> FloatArray:
        """Return what looks gain a unit of state (m, 2, d) from what they gain a metre (m, 2, 3)."""
        ...

    def sides(self, state: FloatArray, side: FloatArray) -> FloatArray:
        """Return the spreads (n, 12, 12) of the first four derivatives of the position."""
        ...
