"""The work of a plan, reckoned before it runs: looks, events and bytes, of the whole scene and of
one cycle.

Nothing is simulated: the looks of a pair follow from its scans. Events are at most one per look,
and false alarms.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.errors import Problem, SceneError
from opir_core.interfaces.detection_models import DetectionProbability
from opir_core.interfaces.sensors import Sensor
from opir_core.planning.sightlines import Pairs
from opir_core.scene.scene import WorkLimits

#: Bytes of an event in the largest encoding, `forge` with type probabilities and three bands,
#: rounded up.
EVENT_BYTES = 2000

#: Looks that take as much memory as an event: a look that does not detect has a few numbers.
LOOKS_PER_EVENT = 4.0


@frozen
class Work:
    """Looks, events and bytes of a scene, or of one cycle."""

    looks: float
    events: float

    @property
    def bytes(self) -> float:
        """Bytes of the events."""
        return self.events * EVENT_BYTES


@frozen(eq=False, repr=False)
class Workload:
    """The pairs, sensors and limits from which the work of a plan follows."""

    pairs: Pairs
    sensors: Sequence[Sensor]
    detection: DetectionProbability
    end_ns: int
    limits: WorkLimits

    def of_run(self) -> Work:
        """Return the work of the whole scene."""
        looks = float(self.pairs.looks.sum())
        return Work(looks, looks + self._false_alarms_per_s().sum() * self.end_ns / 1e9)

    def of_cycle(self, cycle_ns: int) -> Work:
        """Return the most work of `cycle_ns` of scene time anywhere in the scene."""
        looks = most_looks(self.pairs, cycle_ns)
        return Work(looks, looks + self._false_alarms_per_s().sum() * cycle_ns / 1e9)

    def looks_per_s(self) -> float:
        """Return an upper bound of the looks and false alarms in a second of scene time, in looks
        of the same memory.
        """
        return most_looks(self.pairs, 1_000_000_000) + self.false_looks_per_s()

    def false_looks_per_s(self) -> float:
        """Return the mean number of false alarms in a second, in looks of the same memory."""
        return LOOKS_PER_EVENT * float(self._false_alarms_per_s().sum())

    def require_run(self) -> None:
        """Raise `SceneError` if the work of the whole scene, or the pace of its false alarms, is
        above the limits.
        """
        self._require_pace()
        self._require(self.of_run(), "run", "the scene has")

    def accepts(self, looks: float) -> bool:
        """Return whether a run with `looks` looks is within the limits."""
        work = Work(looks, looks + self._false_alarms_per_s().sum() * self.end_ns / 1e9)
        limits = self.limits
        return (
            work.looks <= limits.looks_per_run
            and work.events <= limits.events_per_run
            and work.bytes <= limits.bytes_per_run
            and self._false_alarms_per_s().sum() <= limits.false_alarms_per_s
        )

    def require_cycle(self, cycle_ns: int) -> None:
        """Raise `SceneError` if the work of a cycle, `cycle_ns` of scene time, is above the
        limits.
        """
        self._require(
            self.of_cycle(cycle_ns),
            "cycle",
            f"a cycle of {cycle_ns / 1e9:g} s of scene time has",
        )

    def _require_pace(self) -> None:
        rates = self._false_alarms_per_s()
        limit = self.limits.false_alarms_per_s
        if rates.sum() <= limit:
            return
        sensor = self.sensors[int(rates.argmax())]
        text = (
            f"the sensors have {rates.sum():.3g} false alarms in a second, and at most {limit:.3g}"
            f" are accepted; raise the threshold of {sensor.id}, which has {rates.max():.3g},"
            f" lengthen its scan_period_ms ({sensor.scan.period_ns * 1e-6:g}), or raise the limit"
        )
        raise SceneError([Problem("limits.false_alarms_per_s", text)])

    def _require(self, work: Work, span: str, subject: str) -> None:
        for name in ("looks", "events", "bytes"):
            limit = f"{name}_per_{span}"
            amount = getattr(work, name)
            maximum = getattr(self.limits, limit)
            if amount > maximum:
                at_most = "" if name == "looks" else "up to "
                text = (
                    f"{subject} {at_most}{amount:.3g} {name}, and at most {maximum:.3g} are accepted;"
                    f" {self._remedy(span)}"
                )
                raise SceneError([Problem(f"limits.{limit}", text)])

    def _remedy(self, span: str) -> str:
        """Return the remedy: a longer scan period of the sensor with the most looks and false
        alarms.
        """
        work = self._false_alarms_per_s() * self.end_ns / 1e9
        np.add.at(work, self.pairs.sensor, self.pairs.looks.astype(np.float64))
        sensor = self.sensors[int(work.argmax())]
        shorter = "shorten duration_s" if span == "run" else "lower the speed or the cycle"
        return (
            f"lengthen scan_period_ms of {sensor.id} ({sensor.scan.period_ns * 1e-6:g}), {shorter},"
            f" or raise the limit"
        )

    def _false_alarms_per_s(self) -> FloatArray:
        """Return the mean number (sensors,) of false alarms in a second."""
        rate = self.detection.rate_per_scan
        if rate is None:
            return np.zeros(len(self.sensors))
        period_s = np.array([sensor.scan.period_ns for sensor in self.sensors]) / 1e9
        return np.asarray(rate, dtype=np.float64) / period_s


def most_looks(pairs: Pairs, duration_ns: int) -> float:
    """Return an upper bound of the looks of pairs in any `duration_ns` of scene time."""
    pairs = pairs.take(np.flatnonzero(pairs.looks > 0))
    if not len(pairs):
        return 0.0
    looks = np.minimum(duration_ns // pairs.period_ns + 1, pairs.looks).astype(np.float64)
    starts = pairs.phase_ns + pairs.first_scan * pairs.period_ns
    stops = pairs.phase_ns + pairs.last_scan * pairs.period_ns + duration_ns
    # A pair counts from its first look until its last look has left the interval; at equal times
    # starts come first.
    order = np.lexsort((np.repeat([0, 1], len(pairs)), np.concatenate([starts, stops])))
    return float(np.cumsum(np.concatenate([looks, -looks])[order]).max())
