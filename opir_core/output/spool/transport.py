"""Carriers: what takes encoded events away and says later which have arrived."""

from concurrent.futures import Future
from typing import Protocol, runtime_checkable

from opir_core.output.spool.batches import Batch


@runtime_checkable
class Transport(Protocol):
    """Carries encoded events away and says later which have arrived: what a sink's `build` may return for a sink.

    The core makes a sink of it: it encodes, queues in memory or in a spool, feeds the carrier from a thread of its own,
    a few megabytes ahead of what is acknowledged, and strikes off what arrived. A carrier tries again by itself
    whatever may yet succeed, for as long as it is open.
    """

    @property
    def trouble(self) -> str | None:
        """Why nothing gets through at the moment, for people; None while all is well."""

    def carry(self, parcel: Batch) -> "Future[None]":
        """Take events on their way, without waiting; of one key, they arrive in the order in which they were given.

        The future is done once every one is acknowledged. A `SinkError` in it is final: the sink has failed.
        """

    def close(self, wait_s: float) -> None:
        """Let go of everything within `wait_s` seconds; futures that are not done by then are cancelled."""
