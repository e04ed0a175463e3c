"""Random numbers of a window's looks: one stream per pair and purpose, read in bulk, returned by
row.

Those of a sensor's false alarms come by blocks of scans.
"""

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray, WordArray
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.sensors import Sensor
from opir_core.random_streams.philox import (
    Reader,
    Stream,
    further_words,
    normal_pairs,
    purpose_number,
    stream_key,
    uniforms_of,
)


class PairStreams:
    """The streams of all pairs of a run, keyed when first read.

    `names` are each pair's sensor and target ids; streams are keyed by the seed, these and a
    purpose. Streams of scans use `scan_names` instead, if given.
    """

    def __init__(
        self,
        seed: int,
        names: Sequence[tuple[str, str]],
        scan_names: Sequence[tuple[str, str]] | None = None,
    ) -> None:
        self._seed = seed
        self._names = names
        self._scan_names = names if scan_names is None else scan_names
        self._reader = Reader()
        self._keys: dict[str, dict[int, int]] = {}
        self._read_words: dict[str, _ReadWords] = {}
        self._constants: dict[tuple[str, int], FloatArray] = {}

    def words(
        self, purpose: str, words: int, pairs: IntArray, first_scan: IntArray, scans: IntArray
    ) -> WordArray:
        """Return (sum of scans · words,) raw words: of each pair in turn, for `scans` scans from
        `first_scan` on.
        """
        into = np.empty((int(scans.sum()), words), dtype=np.uint64)
        self.fill(into, purpose, pairs, first_scan, scans, np.cumsum(scans) - scans)
        return into.reshape(-1)

    def fill(
        self,
        into: WordArray,
        purpose: str,
        pairs: IntArray,
        first_scan: IntArray,
        scans: IntArray,
        at: IntArray,
    ) -> None:
        """Write raw words into rows (…, words): each pair's `scans` from `first_scan` on, starting
        at the row `at`.

        A pair is there at most once: its words are kept in one row.
        """
        flat = into.reshape(-1)
        words = into.shape[1]
        if purpose not in self._read_words:
            self._read_words[purpose] = _ReadWords(len(self._names))
        store = self._read_words[purpose]
        columns = pairs, first_scan * words, scans * words, at * words
        is_short = columns[2] <= store.longest
        short, long = ([column[rows] for column in columns] for rows in (is_short, ~is_short))
        lacking = store.lacking(*short[:3])
        if len(lacking[0]):
            self._read(store.words.reshape(-1), purpose, *lacking)
        store.copy(flat, *short)
        self._read(flat, purpose, *long)

    def _read(
        self,
        into: WordArray,
        purpose: str,
        pairs: IntArray,
        start: IntArray,
        count: IntArray,
        at: IntArray,
    ) -> None:
        """Read `count` words of each pair, from word `start` of its stream on, to the place
        `at`.
        """
        keys = self._keys.setdefault(purpose, {})
        for pair, begin, words, place in zip(
            *(column.tolist() for column in (pairs, start, count, at)), strict=True
        ):
            key = keys.get(pair)
            if key is None:
                key = stream_key(self._seed, *self._scan_names[pair], purpose)
                keys[pair] = key
            into[place : place + words] = self._reader.words(key, begin, words)

    def constants(self, purpose: str, words: int) -> FloatArray:
        """Return (pairs, words) numbers in [0, 1), one row for all scans of a pair."""
        key = (purpose, words)
        if key not in self._constants:
            keys = [stream_key(self._seed, *names, f"{purpose}:pair") for names in self._names]
            raw = [self._reader.words(stream, 0, words) for stream in keys]
            self._constants[key] = uniforms_of(
                np.concatenate([*raw, np.empty(0, np.uint64)])
            ).reshape(-1, words)
        return self._constants[key]

    def of_pairs(self) -> "RowDraws":
        """Return random draws of the pairs, one row each, without scans."""
        pairs = np.arange(len(self._names))
        none = np.zeros(0, dtype=np.int64)
        return RowDraws(WindowNumbers(self, none, none, none), self, none, pairs)

    def forget(self, pairs: IntArray) -> None:
        """Release the keys of pairs without further looks."""
        for keys in self._keys.values():
            for pair in pairs.tolist():
                keys.pop(pair, None)


class _ReadWords:
    """The next words of each pair's stream of one purpose: streams are read for several windows at
    once.

    `words` has one row per pair; `longest` is the largest number of words that is read so.
    """

    def __init__(self, pairs: int) -> None:
        # At most 256 words of a pair, and 16 MB of all pairs for each purpose. Reading a stream
        # costs as much as 1 000 words of it, so that a window of some ten looks of each pair is
        # read in advance; twice as many save a tenth more.
        self._width = min(256, (1 << 21) // max(pairs, 1))
        self.longest = self._width // 2
        self.words = np.empty((pairs, self._width), dtype=np.uint64)
        self._start = np.full(pairs, -self._width, dtype=np.int64)

    def lacking(
        self, pairs: IntArray, start: IntArray, count: IntArray
    ) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """Return pairs, first words, numbers of words and places in `words` of what must be read
        before `copy`.
        """
        offset = start - self._start[pairs]
        rows = np.flatnonzero((offset < 0) | (offset + count > self._width))
        pairs = pairs[rows]
        start = start[rows]
        self._start[pairs] = start
        return pairs, start, np.full(len(rows), self._width), pairs * self._width

    def copy(
        self, into: WordArray, pairs: IntArray, first_word: IntArray, count: IntArray, at: IntArray
    ) -> None:
        """Copy `count` words of each pair, from word `first_word` of its stream on, to the
        place `at`.
        """
        place = np.arange(int(count.sum()))
        place_of_pair = np.cumsum(count) - count
        source = place + np.repeat(
            pairs * self._width + first_word - self._start[pairs] - place_of_pair, count
        )
        if len(place) == len(into):
            self.words.reshape(-1).take(source, out=into, mode="clip")
        else:
            into[place + np.repeat(at - place_of_pair, count)] = self.words.reshape(-1).take(source)


class WindowNumbers:
    """The random numbers of all looks of a window, by purpose; a pair's numbers are drawn when
    first needed.

    The looks are those of the `active` pairs end to end, `scans` of each from `first_scan` on.
    """

    def __init__(
        self, streams: PairStreams, active: IntArray, first_scan: IntArray, scans: IntArray
    ) -> None:
        self._streams = streams
        self._active = active
        self._first_scan = first_scan
        self._scans = scans
        self._ends = np.cumsum(scans)
        self._drawn: dict[tuple[str, int], tuple[WordArray, BoolArray]] = {}

    def words(self, purpose: str, pairs: BoolArray | None = None) -> WordArray:
        """Return (looks,) raw words, drawn at each call; 0 for pairs not in the mask `pairs`
        (active,), if given.
        """
        if pairs is None:
            return self._streams.words(purpose, 1, self._active, self._first_scan, self._scans)
        words = np.zeros(int(self._ends[-1]) if len(self._ends) else 0, dtype=np.uint64)
        self._draw(words.reshape(-1, 1), purpose, pairs)
        return words

    def of_rows(self, purpose: str, words: int, rows: IntArray, pair: IntArray) -> WordArray:
        """Return (rows, words) raw words of some of the looks, which are of pairs (rows,).

        Sorted rows are read directly; otherwise all looks of a pair are drawn and kept.
        """
        if np.all(rows[1:] > rows[:-1]):
            return self._in_order(purpose, words, rows)
        key = (purpose, words)
        if key not in self._drawn:
            looks = int(self._ends[-1]) if len(self._ends) else 0
            self._drawn[key] = (
                np.empty((looks, words), dtype=np.uint64),
                np.zeros(len(self._active), dtype=np.bool_),
            )
        drawn, is_drawn = self._drawn[key]
        if not is_drawn.all():
            needed = np.zeros(int(self._active[-1]) + 1, dtype=np.bool_)
            needed[pair] = True
            missing = needed[self._active] & ~is_drawn
            self._draw(drawn, purpose, missing)
            is_drawn |= missing
        return drawn.take(rows, axis=0)

    def _in_order(self, purpose: str, words: int, rows: IntArray) -> WordArray:
        """Return (rows, words) raw words of sorted looks: of each pair from its first row to its
        last.
        """
        behind = np.searchsorted(rows, self._ends)
        count = np.diff(behind, prepend=0)
        places = np.flatnonzero(count)
        behind = behind[places]
        count = count[places]
        start = rows[behind - count]
        end = rows[behind - 1]
        scan = self._first_scan[places] + start - (self._ends - self._scans)[places]
        span = end - start + 1
        at = np.cumsum(span) - span
        read = np.empty((int(span.sum()), words), dtype=np.uint64)
        self._streams.fill(read, purpose, self._active[places], scan, span, at)
        return (
            read
            if len(read) == len(rows)
            else read.take(rows + np.repeat(at - start, count), axis=0)
        )

    def of(self, rows: IntArray, pair: IntArray, seeds: WordArray | None = None) -> "RowDraws":
        """Return random draws of some of the looks, of pairs `pair`; `seeds` are random words of
        the rows, if known.
        """
        return RowDraws(self, self._streams, rows, pair, seeds)

    def _draw(self, into: WordArray, purpose: str, pairs: BoolArray) -> None:
        places = np.flatnonzero(pairs)
        scans = self._scans[places]
        at = self._ends[places] - scans
        self._streams.fill(into, purpose, self._active[places], self._first_scan[places], scans, at)


@frozen(eq=False, repr=False)
class RowDraws:
    """Random draws of a batch of rows: a `RandomDraws`.

    With `seeds`, raw words of the looks, numbers are derived from these without reading a stream.
    """

    numbers: WindowNumbers
    streams: PairStreams
    rows: IntArray
    pair: IntArray
    seeds: WordArray | None = None

    def uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        """Return (rows, words) numbers in [0, 1), fresh for each scan."""
        columns = np.empty((words, len(self.rows)))
        for place, column in enumerate(self._words(purpose, words)):
            columns[place] = uniforms_of(column.copy() if self.seeds is None else column)
        return columns.T

    def normals(self, purpose: str, count: int = 1) -> FloatArray:
        """Return (rows, count) standard normal numbers, fresh for each scan: two per raw word."""
        columns = np.empty((count, len(self.rows)))
        for place, words in enumerate(self._words(purpose, (count + 1) // 2)):
            pair = normal_pairs(words)
            columns[2 * place : 2 * place + 2] = pair[: count - 2 * place]
        return columns.T

    def _words(self, purpose: str, count: int) -> Iterable[WordArray]:
        """Return `count` columns (rows,) of raw words."""
        if self.seeds is None:
            return self.numbers.of_rows(purpose, count, self.rows, self.pair).T
        numbers = purpose_number(purpose) + np.arange(count, dtype=np.uint64)
        return [further_words(self.seeds, numbers[place : place + 1]) for place in range(count)]

    def pair_uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        """Return (rows, words) numbers in [0, 1), the same for all scans of a sensor and a
        target.
        """
        return self.streams.constants(purpose, words)[self.pair]

    def take(self, rows: Any) -> "RowDraws":
        """Return the random draws of some of the rows."""
        seeds = None if self.seeds is None else self.seeds[rows]
        return RowDraws(self.numbers, self.streams, self.rows[rows], self.pair[rows], seeds)


#: Random numbers for time and direction: scan in the block, distance from nadir, angle about nadir.
PLACE_WORDS = 3


@frozen(eq=False, repr=False)
class Drawn(Columns):
    """False alarms of scans in or near a window; their times in the scan depend on their
    directions.
    """

    sensor: IndexArray
    scan: IntArray
    serial: IntArray
    uniforms: FloatArray


class FalseAlarmStream:
    """The false alarms of one sensor, block by block."""

    def __init__(
        self, sensor: Sensor, number: int, name: str, seed: int, rate: float, words: int
    ) -> None:
        self._sensor = sensor
        self._number = number
        self._words = words + PLACE_WORDS
        # The scans of a block: 256 false alarms in the mean, and a million scans at most.
        self._scans = int(min(max(1.0, 256.0 / rate), 1 << 20))
        self._table = poisson_table(rate * self._scans)
        self._counts = Stream(stream_key(seed, name, "noise-count"))
        self._numbers = Stream(stream_key(seed, name, "noise"))
        self._phase = float(
            uniforms_of(Stream(stream_key(seed, self._sensor.id, "scan-phase")).words(0, 1))[0]
        )

    def near(self, start_ns: int, end_ns: int) -> Drawn:
        """Return the false alarms of scans with looks in [start, end) of scene time."""
        period_ns = self._sensor.scan.period_ns
        block_ns = self._scans * period_ns
        # Looks of a scan are up to one period after its start.
        first_block = max((start_ns - period_ns) // block_ns, 0)
        counts = self._block_counts(
            first_block, max(-(-end_ns // block_ns), first_block + 1) - first_block
        )
        room = len(self._table) * self._words
        words = [
            self._numbers.words((first_block + row) * room, count * self._words)
            for row, count in enumerate(counts.tolist())
            if count
        ]
        uniforms = uniforms_of(np.concatenate([*words, np.empty(0, dtype=np.uint64)])).reshape(
            -1, self._words
        )
        block = np.repeat(first_block + np.arange(len(counts)), counts)
        place = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        scan = block * self._scans + np.floor(uniforms[:, 0] * self._scans).astype(np.int64)
        in_reach = np.flatnonzero(
            (scan * period_ns >= start_ns - period_ns) & (scan * period_ns < end_ns)
        )
        serial = block * len(self._table) + place
        sensor = np.full(len(scan), self._number, dtype=np.int32)
        return Drawn(sensor, scan, serial, uniforms).take(in_reach)

    def phase_ns(self, sensor_m: FloatArray, target_m: FloatArray) -> IntArray:
        """Return the scan phases, ns, at which the sensor at positions (n, 3) looks at positions
        (n, 3).
        """
        return self._sensor.scan.phase_ns(sensor_m, target_m, self._phase)

    def _block_counts(self, first_block: int, blocks: int) -> IntArray:
        """Return the numbers of false alarms in blocks of scans."""
        return np.searchsorted(
            self._table, uniforms_of(self._counts.words(first_block, blocks)), side="right"
        )


@lru_cache(maxsize=64)
def poisson_table(mean: float) -> FloatArray:
    """Return the cumulative Poisson probabilities of 0, 1, 2, … events, up to a negligible tail."""
    maximum = int(mean + 12.0 * math.sqrt(mean) + 40.0)
    number = np.arange(maximum + 1)
    log_factorial = np.array([math.lgamma(n + 1.0) for n in range(maximum + 1)])
    cumulative = np.cumsum(np.exp(number * math.log(mean) - mean - log_factorial))
    # Every number in [0, 1) is below the last: rounding must not leave a gap.
    cumulative[-1] = 1.0
    table: FloatArray = np.minimum(cumulative, 1.0)
    table.flags.writeable = False
    return table
