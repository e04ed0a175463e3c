"""When a sink with a backlog waits, tries again and gives up: the policy, and the states that
follow from it.

All times are of the monotonic clock and are passed in; nothing here waits.
"""

import math

from attrs import define, field, frozen

from opir_core.scene.scene import WAIT


@frozen(kw_only=True)
class Policy:
    """What is dropped when the backlog is full, how long `wait` waits, s, and when closing stops
    waiting.

    Closing waits for acknowledgements until none has come for `stall_s`, or for `trouble_s` where
    the transport says why nothing gets through. A parked sink tries again after `retry_s`, then
    after twice as long each time, up to `longest_retry_s`.
    """

    when_full: str = WAIT
    wait_s: float = 30.0
    stall_s: float = 10.0
    trouble_s: float = 10.0
    retry_s: float = 5.0
    longest_retry_s: float = 300.0


@define(eq=False, repr=False)
class Parking:
    """Whether the transport refuses batches for good, and when the first of these is sent again.

    taking → `refuse` → parked, nothing is sent → `resume`, after a pause → parked, on trial →
    `take`, at the first acknowledgement → taking. A refusal on trial parks it again, for twice the
    pause. At closing there is one trial.
    """

    policy: Policy
    #: Why the transport refuses, until it has acknowledged something.
    reason: str | None = field(default=None, init=False)
    #: The first refused batch, until it is sent again.
    refused_from: int | None = field(default=None, init=False)
    _retry_at: float = field(default=math.inf, init=False)
    _pause_s: float = field(default=0.0, init=False)
    _is_last_trial: bool = field(default=False, init=False)

    def refuse(self, number: int, reason: str, now_s: float) -> None:
        """Park at a batch; of several that are refused together, at the first."""
        if self.refused_from is None:
            self._pause_s = min(
                max(self.policy.retry_s, 2.0 * self._pause_s), self.policy.longest_retry_s
            )
            self._retry_at = now_s + self._pause_s
        self.reason = reason
        self.refused_from = number if self.refused_from is None else min(number, self.refused_from)

    def take(self) -> None:
        """End the parking: something is acknowledged."""
        self.reason = None
        self._pause_s = 0.0

    def retry(self) -> bool:
        """End the pause; return whether there is one."""
        self._retry_at = -math.inf
        return self.reason is not None

    def resume(self, now_s: float, *, is_closing: bool) -> bool:
        """Return whether to send again now what was refused; at closing that is once, at once."""
        is_due = not self._is_last_trial if is_closing else now_s >= self._retry_at
        if is_due:
            self._is_last_trial = is_closing
            self.refused_from = None
        return is_due

    @property
    def has_given_up(self) -> bool:
        """Whether the last trial, at closing, was refused too."""
        return self.refused_from is not None and self._is_last_trial


@define(eq=False, repr=False)
class Closing:
    """When a sink that is being closed stops waiting for acknowledgements."""

    policy: Policy
    #: Time of the last acknowledgement; at first, of the opening.
    acknowledged_at: float
    since: float | None = field(default=None, init=False)
    end_at: float = field(default=math.inf, init=False)
    #: Whether the transport is being closed: a `send` under way may raise then, and its batch
    #: stays.
    is_over: bool = field(default=False, init=False)

    def is_stalled(self, now_s: float, *, has_trouble: bool = False) -> bool:
        """Return whether no acknowledgement has come for too long, or the deadline is over; never
        before closing.
        """
        if self.since is None:
            return False
        stall_s = (
            min(self.policy.stall_s, self.policy.trouble_s) if has_trouble else self.policy.stall_s
        )
        return now_s >= min(self.end_at, max(self.since, self.acknowledged_at) + stall_s)
