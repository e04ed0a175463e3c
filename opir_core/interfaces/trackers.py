"""The contract of trackers."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

from opir_core.arrays import IntArray
from opir_core.interfaces.contract import PluginPart, required
from opir_core.interfaces.records import Detections, Tracks
from opir_core.interfaces.sensor_health import SensorHealth
from opir_core.interfaces.sensors import Sensor


class AssumedRate(NamedTuple):
    """A rate at which a tracker expects something to appear in view, 1/day, and its source.

    `name` is that of the setting; `kinds` are the classes of sources that it is of, or `LAUNCH`;
    none for all that no other rate is of.
    """

    name: str
    per_day: float
    source: str
    kinds: tuple[str, ...] = ()


#: The kind of launches among those of an `AssumedRate`.
LAUNCH = "launch"


class Tracker(PluginPart):
    """Detections to tracks; stepped at ticks of scene time, never at window edges.

    >>> class Following(Tracker):
    ...     cadence_s = 2.0
    ...
    ...     def associate(self, detections):
    ...         return np.full(len(detections), -1)
    ...
    ...     def step(self, tick_s, detections):
    ...         return Tracks.empty()
    >>> from opir_testing.doubles import stub_window
    >>> Following().associate(stub_window(2).detections)
    array([-1, -1])
    """

    @required
    def cadence_s(self) -> float | None:
        """Time between ticks, s, or None for a tracker that never steps; required."""

    @abstractmethod
    def associate(self, detections: Detections) -> IntArray:
        """Return track numbers (n,), -1 for none, by the tracks of the last tick; changes no
        state.
        """

    @abstractmethod
    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Process the detections since the last tick; return the estimates at this one, sorted by
        track.
        """

    def is_idle(self) -> bool:
        """Return whether it follows and awaits nothing: steps without detections return no tracks
        and may be left out.

        A step may then pass over any time.
        """
        return False

    def expected_launches(self, duration_s: float) -> float | None:
        """Return the mean number of launches that it expects in a time, or None for one without
        such a prior.
        """
        return None

    def assumed_rates(self) -> Sequence[AssumedRate]:
        """Return the prior rates of what a track may be; none for a tracker without such a prior."""
        return ()

    def sensor_health(self) -> SensorHealth | None:
        """Return the tracker's estimates of the sensors' errors at the last tick, or None."""
        return None

    def set_sensors(self, sensors: tuple[Sensor, ...]) -> None:
        """Use new settings of the sensors, as many in the same order; a running scene may change
        them.
        """
        return
