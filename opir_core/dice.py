"""The random numbers of a window's looks: one stream a pair and purpose, read in bulk, handed out by row."""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.randomness import Stream, stream_key, uniforms_of
from opir_core.records import FloatArray, IntArray


class PairStreams:
    """The streams of all pairs of a run, made when first read.

    `names` are each pair's sensor and target ids; a pair's streams are keyed by the seed, these and a purpose.
    """

    def __init__(self, seed: int, names: Sequence[tuple[str, str]]) -> None:
        self._seed = seed
        self._names = names
        self._streams: dict[tuple[str, int], dict[int, Stream]] = {}
        self._constants: dict[tuple[str, int], FloatArray] = {}

    def uniforms(self, purpose: str, words: int, pairs: IntArray, first_scan: IntArray, scans: IntArray) -> FloatArray:
        """Return (sum of scans, words) numbers: for each pair in turn, those of its `scans` from `first_scan` on."""
        streams = self._streams.setdefault((purpose, words), {})
        parts = []
        for pair, first, count in zip(pairs.tolist(), first_scan.tolist(), scans.tolist(), strict=True):
            stream = streams.get(pair)
            if stream is None:
                stream = streams[pair] = Stream(stream_key(self._seed, *self._names[pair], purpose), words)
            parts.append(stream.words(first, count))
        raw = np.concatenate(parts) if parts else np.empty(0, dtype=np.uint64)
        return uniforms_of(raw).reshape(-1, words)

    def constants(self, purpose: str, words: int) -> FloatArray:
        """Return (pairs, words) numbers, one row for all scans of a pair."""
        key = (purpose, words)
        if key not in self._constants:
            everyone = np.arange(len(self._names))
            zeros = np.zeros_like(everyone)
            self._constants[key] = self.uniforms(f"{purpose}:pair", words, everyone, zeros, zeros + 1)
        return self._constants[key]

    def forget(self, pairs: IntArray) -> None:
        """Let go of the streams of pairs that have no more looks."""
        for streams in self._streams.values():
            for pair in pairs.tolist():
                streams.pop(pair, None)


class WindowNumbers:
    """The numbers of all looks of a window, by purpose, each drawn once, when first asked for.

    The looks are those of the `active` pairs laid end to end, `scans` of each from `first_scan` on.
    """

    def __init__(self, streams: PairStreams, active: IntArray, first_scan: IntArray, scans: IntArray) -> None:
        self._streams = streams
        self._looks = (active, first_scan, scans)
        self._drawn: dict[tuple[str, int], FloatArray] = {}

    def uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        """Return (looks, words) numbers in [0, 1)."""
        key = (purpose, words)
        if key not in self._drawn:
            self._drawn[key] = self._streams.uniforms(purpose, words, *self._looks)
        return self._drawn[key]

    def of(self, rows: IntArray, pair: IntArray) -> "RowDice":
        """Return the dice of some of the looks; `pair` is each row's pair."""
        return RowDice(self, self._streams, rows, pair)


@frozen(eq=False)
class RowDice:
    """The dice of a batch of rows, as `opir_core.protocols.Dice` promises them."""

    numbers: WindowNumbers
    streams: PairStreams
    rows: IntArray
    pair: IntArray

    def uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        """Return (rows, words) numbers in [0, 1), fresh for each scan."""
        chosen: FloatArray = self.numbers.uniforms(purpose, words)[self.rows]
        return chosen

    def pair_uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        """Return (rows, words) numbers in [0, 1), the same for all scans of a sensor and a target."""
        chosen: FloatArray = self.streams.constants(purpose, words)[self.pair]
        return chosen
