"""Detection ids: UUIDs of version 8 that name a look and betray nothing."""

import uuid
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from lone_rows import assert_rows_independent

from opir_core.random_streams import id_key, uuid8_words, uuid_characters, uuid_text
from opir_core.random_streams.detection_ids import stream_key_words

WORD = st.integers(0, 2**64 - 1)
SCAN = st.integers(-(2**63), 2**63 - 1)
MASK = 2**64 - 1


def keys(*numbers: int) -> np.ndarray:
    return np.array([id_key("run", number) for number in numbers], dtype=np.uint64)


def mixed(word: int) -> int:
    """The finaliser of SplitMix64 in Python's unbounded integers."""
    word = (word ^ word >> 30) * 0xBF58476D1CE4E5B9 & MASK
    word = (word ^ word >> 27) * 0x94D049BB133111EB & MASK
    return word ^ word >> 31


def uuid_of(high: int, low: int, scan: int) -> uuid.UUID:
    """The same id, one at a time, with the standard library setting version and variant."""
    upper = mixed(mixed((scan * 0x9E3779B97F4A7C15 + high) & MASK) ^ low)
    lower = mixed(mixed((scan * 0x6A09E667F3BCC909 + low) & MASK) ^ high)
    bare = uuid.UUID(int=upper << 64 | lower, version=4).int
    return uuid.UUID(int=bare & ~(0xF << 76) | 8 << 76)


@given(WORD, WORD, SCAN)
def test_ids_are_what_unbounded_integers_make_of_key_and_scan(
    high: int, low: int, scan: int
) -> None:
    words = uuid8_words(np.array([[high, low]], dtype=np.uint64), np.array([scan]))
    assert uuid_text(words) == [str(uuid_of(high, low, scan))]


@given(arrays(np.uint64, st.tuples(st.integers(0, 5), st.just(2)), elements=WORD))
def test_text_is_the_standard_library_s(words: np.ndarray) -> None:
    expected = [str(uuid.UUID(int=high << 64 | low)) for high, low in words.tolist()]
    assert uuid_text(words) == expected
    assert [row.tobytes().decode() for row in uuid_characters(words)] == expected


@pytest.mark.parametrize(("streams", "scans"), [(1200, 1000), (1, 1_000_000)])
def test_a_million_ids_differ(streams: int, scans: int) -> None:
    words = uuid8_words(
        np.repeat(keys(*range(streams)), scans, axis=0), np.tile(np.arange(scans), streams)
    )
    assert len(np.unique(words.view("V16"))) == streams * scans


def test_ids_do_not_depend_on_how_rows_are_grouped() -> None:
    rows = [slice(start, start + 7) for start in range(0, 50, 7)]
    assert_rows_independent(
        lambda *columns: (uuid8_words(*columns),), keys(*range(50)), np.arange(50), rows=rows
    )


@pytest.mark.parametrize(
    ("streams", "scans"), [([3] * 20_001, range(20_001)), (range(20_001), [0] * 20_001)]
)
def test_neighbours_share_no_more_bits_than_chance(streams: Any, scans: Any) -> None:
    """Scans of a stream, and streams."""
    # Half of 122 bits flip from one to the next; over 20 000 a bit's rate has a standard error of
    # 0.0035.
    words = uuid8_words(keys(*streams), np.array(scans, dtype=np.int64))
    bits = np.unpackbits((words[1:] ^ words[:-1]).astype(">u8").view(np.uint8), axis=1)
    flips = bits.mean(axis=0)
    fixed = [48, 49, 50, 51, 64, 65]
    assert np.all(flips[fixed] == 0.0)
    assert np.all(np.abs(np.delete(flips, fixed) - 0.5) < 0.025)


def test_no_two_ways_of_naming_a_stream_share_a_key() -> None:
    streams = [
        ("ab", "c"),
        ("a", "bc"),
        ("abc",),
        ("abc", ""),
        ("", "abc"),
        (1, "c"),
        ("1", "c"),
        ("s1:", "c"),
    ]
    assert len({id_key(*names) for names in streams}) == len(streams)


def test_a_scene_s_keys_follow_seed_name_epoch_sensor_and_target() -> None:
    runs = [(1, "scene", 0), (2, "scene", 0), (1, "other", 0), (1, "scene", 1)]
    streams = [("S-1", "T-1"), ("S-1", "T-2"), ("S-2", "T-1")]
    all_keys = np.concatenate([stream_key_words(*run, streams) for run in runs])
    assert len(np.unique(all_keys, axis=0)) == len(runs) * len(streams)


def test_a_stream_s_key_does_not_depend_on_the_other_streams() -> None:
    keys_of_two = stream_key_words(1, "scene", 0, [("S-0", "T-0"), ("S-1", "T-1")])
    assert np.array_equal(keys_of_two[1:], stream_key_words(1, "scene", 0, [("S-1", "T-1")]))


def test_a_scene_without_streams_has_no_keys() -> None:
    assert stream_key_words(1, "scene", 0, []).shape == (0, 2)
    assert (
        uuid_text(uuid8_words(np.empty((0, 2), dtype=np.uint64), np.empty(0, dtype=np.int64))) == []
    )


def test_ids_stay_what_they_are() -> None:
    words = uuid8_words(
        np.array([id_key(7, "scene", 0, "S-1", "T-1")], dtype=np.uint64), np.array([42])
    )
    assert uuid_text(words) == ["342bacf7-1e58-8022-85f7-24a2841f5be4"]
