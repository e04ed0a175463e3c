"""Random streams of a sensor's false alarms, by blocks of scans."""

import math
from functools import lru_cache

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.protocols import Sensor
from opir_core.random_streams.philox import Stream, stream_key, uniforms_of

#: Mean number of false alarms in a block, and the largest number of its scans.
_PER_BLOCK, _MOST_SCANS = 256.0, 1 << 20

#: Random numbers for time and direction: scan in the block, distance from nadir, angle about nadir.
PLACE_WORDS = 3


@frozen(eq=False)
class Drawn(Columns):
    """False alarms of scans in or near a window; their times in the scan depend on their directions."""

    sensor: IndexArray
    scan: IntArray
    serial: IntArray
    uniforms: FloatArray


class FalseAlarmStream:
    """The false alarms of one sensor, block by block."""

    def __init__(self, sensor: Sensor, number: int, name: str, seed: int, rate: float, words: int) -> None:
        self._sensor, self._number = sensor, number
        self._words = words + PLACE_WORDS
        self._scans = int(min(max(1.0, _PER_BLOCK / rate), _MOST_SCANS))
        self._table = poisson_table(rate * self._scans)
        self._counts = Stream(stream_key(seed, name, "noise-count"))
        self._numbers = Stream(stream_key(seed, name, "noise"))
        self._phase = float(uniforms_of(Stream(stream_key(seed, self._sensor.id, "scan-phase")).words(0, 1))[0])

    def near(self, start_ns: int, end_ns: int) -> Drawn:
        """Return the false alarms of scans with looks in [start, end) of scene time."""
        period_ns = self._sensor.scan.period_ns
        block_ns = self._scans * period_ns
        # Looks of a scan are up to one period after its start.
        first = max((start_ns - period_ns) // block_ns, 0)
        counts = self._block_counts(first, max(-(-end_ns // block_ns), first + 1) - first)
        uniforms = self._uniforms(first, counts)
        block, place = np.repeat(first + np.arange(len(counts)), counts), _places(counts)
        scan = block * self._scans + np.floor(uniforms[:, 0] * self._scans).astype(np.int64)
        near = np.flatnonzero((scan * period_ns >= start_ns - period_ns) & (scan * period_ns < end_ns))
        serial = block * len(self._table) + place
        sensor = np.full(len(scan), self._number, dtype=np.int32)
        return Drawn(sensor, scan, serial, uniforms).take(near)

    def phase_ns(self, sensor_m: FloatArray, target_m: FloatArray) -> IntArray:
        """Return the scan phases, ns, at which the sensor at positions (n, 3) looks at positions (n, 3)."""
        return self._sensor.scan.phase_ns(sensor_m, target_m, self._phase)

    def _block_counts(self, first: int, blocks: int) -> IntArray:
        """Return the numbers of false alarms in blocks of scans."""
        counts: IntArray = np.searchsorted(self._table, uniforms_of(self._counts.words(first, blocks)), side="right")
        return counts

    def _uniforms(self, first: int, counts: IntArray) -> FloatArray:
        """Return the random numbers (n, words) of the false alarms in blocks of scans."""
        room = len(self._table) * self._words
        parts = [
            self._numbers.words((first + row) * room, count * self._words)
            for row, count in enumerate(counts.tolist())
            if count
        ]
        return uniforms_of(np.concatenate([*parts, np.empty(0, dtype=np.uint64)])).reshape(-1, self._words)


def _places(counts: IntArray) -> IntArray:
    """Return the number of each false alarm in its block."""
    places: IntArray = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return places


@lru_cache(maxsize=64)
def poisson_table(mean: float) -> FloatArray:
    """Return the cumulative Poisson probabilities of 0, 1, 2, … events, up to a negligible tail."""
    most = int(mean + 12.0 * math.sqrt(mean) + 40.0)
    number = np.arange(most + 1)
    log_factorial = np.array([math.lgamma(n + 1.0) for n in range(most + 1)])
    cumulative = np.cumsum(np.exp(number * math.log(mean) - mean - log_factorial))
    # Every number in [0, 1) is below the last: rounding must not leave a gap.
    cumulative[-1] = 1.0
    table: FloatArray = np.minimum(cumulative, 1.0)
    table.flags.writeable = False
    return table
