"""The random numbers of a window's looks: one stream a pair and purpose, read in bulk, handed out by row."""

from collections.abc import Sequence

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.randomness import Stream, stream_key, uniforms_of
from opir_core.records import FloatArray, IntArray

Words = NDArray[np.uint64]


class PairStreams:
    """The streams of all pairs of a run, made when first read.

    `names` are each pair's sensor and target ids; a pair's streams are keyed by the seed, these and a purpose. Those of
    its scans go by `scan_names`, where these differ.
    """

    def __init__(
        self, seed: int, names: Sequence[tuple[str, str]], scan_names: Sequence[tuple[str, str]] | None = None
    ) -> None:
        self._seed = seed
        self._names = names
        self._scan_names = names if scan_names is None else scan_names
        self._streams: dict[tuple[str, int], dict[int, Stream]] = {}
        self._constants: dict[tuple[str, int], FloatArray] = {}

    def words(self, purpose: str, words: int, pairs: IntArray, first_scan: IntArray, scans: IntArray) -> Words:
        """Return (sum of scans · words,) raw words: in turn those of each pair's `scans` from `first_scan` on."""
        return self._words(self._scan_names, purpose, words, pairs, first_scan, scans)

    def _words(
        self,
        names: Sequence[tuple[str, str]],
        purpose: str,
        words: int,
        pairs: IntArray,
        first_scan: IntArray,
        scans: IntArray,
    ) -> Words:
        streams = self._streams.setdefault((purpose, words), {})
        parts = []
        for pair, first, count in zip(pairs.tolist(), first_scan.tolist(), scans.tolist(), strict=True):
            stream = streams.get(pair)
            if stream is None:
                stream = streams[pair] = Stream(stream_key(self._seed, *names[pair], purpose), words)
            parts.append(stream.words(first, count))
        return np.concatenate(parts) if parts else np.empty(0, dtype=np.uint64)

    def constants(self, purpose: str, words: int) -> FloatArray:
        """Return (pairs, words) numbers, one row for all scans of a pair."""
        key = (purpose, words)
        if key not in self._constants:
            everyone = np.arange(len(self._names))
            zeros = np.zeros_like(everyone)
            raw = self._words(self._names, f"{purpose}:pair", words, everyone, zeros, zeros + 1)
            self._constants[key] = uniforms_of(raw).reshape(-1, words)
        return self._constants[key]

    def of_pairs(self) -> "RowDice":
        """Return the dice of the pairs themselves, one row each, which have no scans."""
        everyone, none = np.arange(len(self._names)), np.zeros(0, dtype=np.int64)
        return RowDice(WindowNumbers(self, none, none, none), self, none, everyone)

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

    def words(self, purpose: str) -> Words:
        """Return (looks,) raw words, drawn anew at each call."""
        return self._streams.words(purpose, 1, *self._looks)

    def uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        """Return (looks, words) numbers in [0, 1)."""
        key = (purpose, words)
        if key not in self._drawn:
            raw = self._streams.words(purpose, words, *self._looks)
            self._drawn[key] = uniforms_of(raw).reshape(-1, words)
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
