"""Backlogs: where parcels wait until they are acknowledged."""

from collections import OrderedDict
from collections.abc import Iterable
from typing import Protocol

from opir_core.spool.parcels import Parcel


class FullError(Exception):
    """There is no room for a parcel."""


class Backlog(Protocol):
    """Parcels in order, numbered as they come; called from one thread at a time."""

    @property
    def waiting(self) -> int:
        """How many events are in it."""

    @property
    def outlives_the_process(self) -> bool:
        """Whether what is left in it at closing is still there for the next run."""

    def put(self, parcel: Parcel) -> None:
        """Take in a parcel; raise `FullError` where there is no room for it."""

    def after(self, number: int) -> tuple[int, Parcel] | None:
        """Return the first parcel with a number above that, or None."""

    def strike(self, numbers: Iterable[int]) -> None:
        """Forget the parcels of those numbers."""

    def drop_oldest(self, after: int) -> int:
        """Forget the first parcel with a number above that and return how many events it had; 0 where there is none."""

    def close(self) -> None:
        """Let go of the file, where there is one."""


class MemoryBacklog:
    """Parcels in memory, at most so many bytes of messages; the first parcel always has room."""

    outlives_the_process = False

    def __init__(self, max_bytes: int) -> None:
        self._parcels: OrderedDict[int, Parcel] = OrderedDict()
        self._last = 0
        self._bytes = 0
        self._max_bytes = max_bytes
        self.waiting = 0

    def put(self, parcel: Parcel) -> None:
        """Take in a parcel; raise `FullError` where there is no room for it."""
        if self._parcels and self._bytes + len(parcel.body) > self._max_bytes:
            raise FullError
        self._last += 1
        self._parcels[self._last] = parcel
        self._bytes += len(parcel.body)
        self.waiting += len(parcel)

    def after(self, number: int) -> tuple[int, Parcel] | None:
        """Return the first parcel with a number above that, or None."""
        if number + 1 in self._parcels:
            return number + 1, self._parcels[number + 1]
        return next(((each, parcel) for each, parcel in self._parcels.items() if each > number), None)

    def strike(self, numbers: Iterable[int]) -> None:
        """Forget the parcels of those numbers."""
        for number in numbers:
            parcel = self._parcels.pop(number)
            self._bytes -= len(parcel.body)
            self.waiting -= len(parcel)

    def drop_oldest(self, after: int) -> int:
        """Forget the first parcel with a number above that and return how many events it had; 0 where there is none."""
        found = self.after(after)
        if found is None:
            return 0
        self.strike([found[0]])
        return len(found[1])

    def close(self) -> None:
        """Forget everything."""
        self._parcels.clear()
