"""Detection ids: UUIDs of version 8 (RFC 9562, section 5.8), identical when a run is repeated.

Each stream (a sensor and a target of a run) has a key of 128 bits. An id is the hash of its
stream's key and the scan number, so the ids of one target have no visible pattern.
"""

from collections.abc import Iterable, Sequence
from hashlib import blake2b

import numpy as np

from opir_core.arrays import ByteArray, IntArray, WordArray
from opir_core.random_streams.philox import mixed

_PURPOSE = b"opir-detection"

_HEX_PAIRS = np.frombuffer(b"".join(b"%02x" % byte for byte in range(256)), dtype=np.uint16)
_HYPHEN = ord("-")
_TEXT_LENGTH = 36


def _groups(places: Sequence[int], length: int) -> np.dtype[np.void]:
    """Return the type of rows of characters with the five groups of a UUID's digits at these
    places.
    """
    lengths = ("V8", "V4", "V4", "V4", "V12")
    return np.dtype(
        {"names": list("12345"), "formats": lengths, "offsets": places, "itemsize": length}
    )


#: Rows of digits: fields of several characters are copied at once, in half the time.
_DIGITS = _groups((0, 8, 12, 16, 20), 32)


def id_key(*names: str | int) -> tuple[int, int]:
    """Return the 128-bit key of a stream by its names, as two 64-bit halves.

    Names are hashed (BLAKE2b) with type and length, so that different sequences of names hash
    different bytes.
    """
    digest = blake2b(digest_size=16, person=_PURPOSE)
    for name in names:
        text = str(name).encode()
        digest.update(b"%s%d:" % (b"i" if isinstance(name, int) else b"s", len(text)))
        digest.update(text)
    key = digest.digest()
    return int.from_bytes(key[:8], "big"), int.from_bytes(key[8:], "big")


def stream_key_words(
    seed: int, scene: str, epoch_us: int, streams: Iterable[tuple[str, str]]
) -> WordArray:
    """Return the keys (n, 2) of a run's streams, each named by the ids of its sensor and target.

    A run has the seed, the name and the epoch of its scene.
    """
    keys = [id_key(seed, scene, epoch_us, sensor, target) for sensor, target in streams]
    return np.array(keys, dtype=np.uint64).reshape(-1, 2)


def uuid8_words(key_words: WordArray, scan: IntArray) -> WordArray:
    """Return the ids (n, 2), most significant half first, of scans (n,) of streams with keys (n,
    2).

    Within a stream no two scans share a half before version and variant replace 6 of the 128 bits;
    ids of different streams collide with the probability of 122 random bits.
    """
    high = key_words[:, 0]
    low = key_words[:, 1]
    count = scan.astype(np.uint64)
    words = np.empty((len(count), 2), dtype=np.uint64)
    # Steps of the two halves from scan to scan: odd, so that multiplication by them is a bijection
    # of 64-bit words. The fractions of the golden ratio and of the square root of 2, to the nearest
    # odd word.
    words[:, 0] = mixed(mixed(count * 0x9E3779B97F4A7C15 + high) ^ low)
    words[:, 1] = mixed(mixed(count * 0x6A09E667F3BCC909 + low) ^ high)
    # Version in bits 48-51, variant in bits 64-65 (RFC 9562, section 5.8).
    words &= np.array([0xFFFFFFFFFFFF0FFF, 0x3FFFFFFFFFFFFFFF], dtype=np.uint64)
    words |= np.array([0x8000, 0x8000000000000000], dtype=np.uint64)
    return words


def uuid_text(words: WordArray) -> list[str]:
    """Return ids (n, 2) as text of 36 characters, in lower case (RFC 9562, section 4)."""
    text = uuid_characters(words).tobytes().decode("ascii")
    return [text[start : start + _TEXT_LENGTH] for start in range(0, len(text), _TEXT_LENGTH)]


def uuid_words(texts: Sequence[str]) -> WordArray:
    """Return ids (n, 2) from their texts, the inverse of `uuid_text`; `ValueError` for other
    texts.
    """
    words = np.empty((len(texts), 2), dtype=np.uint64)
    for row, text in enumerate(texts):
        digits = text.replace("-", "")
        if len(digits) != 32:
            raise ValueError(f"{text!r} is not a UUID")
        words[row] = int(digits[:16], 16), int(digits[16:], 16)
    return words


def uuid_characters(words: WordArray) -> ByteArray:
    """Return ids (n, 2) as ASCII codes (n, 36)."""
    octets = words.astype(">u8").view(np.uint8)
    digits = np.take(_HEX_PAIRS, octets).view(_DIGITS)[:, 0]
    text = np.full((len(words), _TEXT_LENGTH), _HYPHEN, dtype=np.uint8)
    groups = text.view(_groups((0, 9, 14, 19, 24), _TEXT_LENGTH))[:, 0]
    for name in _DIGITS.fields or ():
        groups[name] = digits[name]
    return text
