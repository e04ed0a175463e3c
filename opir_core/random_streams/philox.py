"""Random streams: one seed, one counter-based stream per named purpose, addressed by scan.

A stream is Philox4x64-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC11) as
numpy implements it, with the 128-bit key blake2b(seed, names) and the counter as address: word w of
scan k is output k · W + w of the stream, where W is the number of words a scan has. So a number
depends on the seed, the names and the scan alone, not on other streams or the order of reading.
Further numbers of a detection are derived from the word of its direction by SplitMix64, with one
part of the sequence per purpose: reading another stream of every pair would take four times as
long.
"""

from functools import cache
from hashlib import blake2b
from typing import Any

import numpy as np

from opir_core.arrays import FloatArray, WordArray

#: Name of this scheme in the manifest; it changes if any number changes.
SCHEME = (
    "philox4x64-10, key blake2b-128(seed, names), counter scan; uniforms 53 bits; numbers of"
    " detections splitmix64 of"
    " the word of their direction"
)

_WORDS_PER_BLOCK = 4

#: Failures that are read at a time.
_FAILURES_READ = 64

_SEPARATOR = b"\x1f"

#: Of the 4096 directions of normal pairs.
_COSINES = np.cos(2.0 * np.pi * 2.0**-12 * np.arange(1 << 12))
_SINES = np.sin(2.0 * np.pi * 2.0**-12 * np.arange(1 << 12))


def stream_key(seed: int, *names: str) -> int:
    """Return the 128-bit key of the stream with these names and seed."""
    text = _SEPARATOR.join([str(seed).encode(), *(name.encode() for name in names)])
    return int.from_bytes(blake2b(text, digest_size=16).digest(), "little")


@cache
def purpose_number(purpose: str) -> np.uint64:
    """Return the first number of a purpose in a look's SplitMix64 sequence, far from those of other
    purposes.
    """
    return np.uint64(int.from_bytes(blake2b(purpose.encode(), digest_size=8).digest(), "little"))


class Reader:
    """Reads words of any stream at any position, by repositioning one generator: 30 times faster
    than a new one.
    """

    def __init__(self) -> None:
        self._generator = np.random.Philox(key=0)
        self._place: dict[str, tuple[int, ...]] = {}
        # An empty buffer: the next word is the first of the block after the counter.
        self._state: Any = {
            "bit_generator": "Philox",
            "state": self._place,
            "buffer": (0,) * _WORDS_PER_BLOCK,
            "buffer_pos": _WORDS_PER_BLOCK,
            "has_uint32": 0,
            "uinteger": 0,
        }

    def words(self, key: int, start: int, count: int) -> WordArray:
        """Return `count` raw words of the stream with a 128-bit key, from word `start` on."""
        block, skipped = divmod(start, _WORDS_PER_BLOCK)
        self._place["key"] = divmod(key, 1 << 64)[::-1]
        self._place["counter"] = (*divmod(block, 1 << 64)[::-1], 0, 0)
        self._generator.state = self._state
        return self._generator.random_raw(skipped + count)[skipped:]


class Stream:
    """One stream of raw words, `words` of them per scan."""

    def __init__(self, key: int, words: int = 1) -> None:
        self._key = key
        self._words = words
        self._reader = Reader()

    def words(self, first_scan: int, scans: int) -> WordArray:
        """Return the (scans · words,) raw words of `scans` scans from `first_scan` on."""
        return self._reader.words(self._key, first_scan * self._words, scans * self._words)


def uniforms_of(words: WordArray) -> FloatArray:
    """Return numbers in [0, 1) from the upper 53 bits of raw words; overwrites the words."""
    words >>= 11
    numbers = _floats(words)
    numbers *= 2.0**-53
    return numbers


def failure_spans_s(
    key: int, *, mtbf_s: float, mttr_s: float, start_s: float, end_s: float
) -> FloatArray:
    """Return the spans (n, 2) of scene time, s, in which something has failed between two times.

    It works at `start_s`. Times between repair and failure have the mean `mtbf_s`, times to repair
    `mttr_s`, both exponential; in the long run it has failed for the share mttr / (mtbf + mttr).
    The last span is cut at `end_s`. `key` is that of a stream (`stream_key`).
    """
    stream = Stream(key, words=2)
    batches = [np.empty((0, 2))]
    time_s = start_s
    while time_s < end_s:
        uniforms = uniforms_of(stream.words(_FAILURES_READ * (len(batches) - 1), _FAILURES_READ))
        lengths_s = -np.log1p(-uniforms) * np.tile([mtbf_s, mttr_s], _FAILURES_READ)
        edges_s = time_s + np.cumsum(lengths_s)
        batches.append(edges_s.reshape(-1, 2))
        time_s = float(edges_s[-1])
    spans_s = np.concatenate(batches)
    spans_s = spans_s[spans_s[:, 0] < end_s]
    return np.minimum(spans_s, end_s)


def further_words(seeds: WordArray, numbers: WordArray) -> WordArray:
    """Return the words number (n,), or (1,), of the sequences of seeds (n,), which are random words
    themselves.

    SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", OOPSLA
    2014), read anywhere.
    """
    return mixed(seeds + numbers * 0x9E3779B97F4A7C15)


def mixed(words: WordArray) -> WordArray:
    """Return 64-bit words mixed one to one, in place: the finaliser of SplitMix64, Stafford's
    variant 13.
    """
    words ^= words >> 30
    words *= 0xBF58476D1CE4E5B9
    words ^= words >> 27
    words *= 0x94D049BB133111EB
    words ^= words >> 31
    return words


def normal_pairs(words: WordArray) -> tuple[FloatArray, FloatArray]:
    """Return two independent standard normal columns (n,) from one raw word per row (n,).

    Box and Muller (Ann. Math. Stat. 29, 1958): a fixed number of words per row, so that rows are
    addressable. The radius uses the upper 40 bits, up to 7.4 sigma. The angle uses the other 24,
    steps of 4e-7 rad: one of 4096 directions from a table, rotated by the rest with series accurate
    to 3e-13, in half the time of a sine and a cosine.
    """
    cosine = np.empty(len(words))
    sine = np.empty(len(words))
    # Few enough at once for all columns to stay in the processor's cache.
    size = 8192
    for start in range(0, len(words), size):
        rows = slice(start, start + size)
        _write_pairs(words[rows], cosine[rows], sine[rows])
    return cosine, sine


def _write_pairs(words: WordArray, cosine: FloatArray, sine: FloatArray) -> None:
    bits = words >> np.uint64(24)
    radius = _floats(bits)
    radius *= -(2.0**-40)
    radius += 1.0
    np.log(radius, out=radius)
    radius *= -2.0
    np.sqrt(radius, out=radius)
    direction = np.bitwise_and(words, 0xFFF, out=bits).view(np.int64)
    _COSINES.take(direction, out=cosine, mode="clip")
    _SINES.take(direction, out=sine, mode="clip")
    np.right_shift(words, 12, out=bits)
    bits &= 0xFFF
    remainder_rad = _floats(bits)
    remainder_rad *= 2.0 * np.pi * 2.0**-24
    _turn(cosine, sine, remainder_rad)
    cosine *= radius
    sine *= radius


def _turn(cosine: FloatArray, sine: FloatArray, by_rad: FloatArray) -> None:
    """Rotate directions by angles below 2e-3 rad, in place."""
    level = by_rad * by_rad
    rise = level * (-1.0 / 6.0)
    rise += 1.0
    rise *= by_rad
    level *= -0.5
    level += 1.0
    upwards = rise * cosine
    rise *= sine
    cosine *= level
    cosine -= rise
    sine *= level
    sine += upwards


def _floats(words: WordArray) -> FloatArray:
    """Return words below 2**63 as floats; signed integers are converted several times faster."""
    return words.view(np.int64).astype(np.float64)
