"""Streams that any part can be read of at any time, and normals that are normal."""

import itertools

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy import stats

from opir_core.random_streams import (
    PairStreams,
    Stream,
    WindowNumbers,
    further_words,
    normal_pairs,
    stream_key,
    uniforms_of,
)
from opir_core.random_streams.philox import Reader


def raw(count: int, seed: int = 1) -> np.ndarray:
    return Stream(stream_key(seed, "test")).words(0, count)


@given(
    st.integers(0, 10**12),
    st.integers(0, 300),
    st.integers(1, 5),
    st.lists(st.integers(0, 300), max_size=4),
)
def test_any_slice_of_a_stream_is_the_same_however_it_is_read(
    first: int, scans: int, words: int, cuts: list[int]
) -> None:
    key = stream_key(7, "S-1", "T-1", "detection")
    whole = Stream(key, words).words(first, scans)
    stream = Stream(key, words)
    edges = sorted({0, scans, *(cut for cut in cuts if cut < scans)})
    parts = [stream.words(first + low, high - low) for low, high in itertools.pairwise(edges)]
    assert np.array_equal(np.concatenate([*parts, np.empty(0, dtype=np.uint64)]), whole)


def test_going_back_gives_the_same_words_again() -> None:
    stream = Stream(stream_key(7, "a"))
    ahead = stream.words(1000, 10)
    stream.words(0, 3)
    assert np.array_equal(stream.words(1000, 10), ahead)


def test_words_are_those_of_numpys_philox() -> None:
    key = stream_key(3, "a", "b")
    assert np.array_equal(
        Stream(key).words(0, 9), np.random.Philox(key=key, counter=0).random_raw(9)
    )


@given(st.integers(0, 2**128 - 1), st.integers(0, 2**66), st.integers(0, 40))
def test_a_reader_that_is_sent_anywhere_reads_what_a_generator_made_there_reads(
    key: int, first: int, count: int
) -> None:
    reader = Reader()
    reader.words(7, 11, 13)
    made = np.random.Philox(key=key, counter=first // 4).random_raw(first % 4 + count)[first % 4 :]
    assert np.array_equal(reader.words(key, first, count), made)


def test_all_pairs_and_purposes_of_a_run_share_one_generator(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = []
    philox = np.random.Philox
    monkeypatch.setattr(np.random, "Philox", lambda **place: made.append(place) or philox(**place))
    pairs = np.arange(50)
    streams = PairStreams(1, [("S", f"T-{number}") for number in pairs])
    for first in (0, 7, 14):
        numbers = WindowNumbers(streams, pairs, pairs + first, np.full(50, 7))
        numbers.words("detection")
        numbers.of(np.arange(350), np.repeat(pairs, 7)).normals("measurement", 3)
    streams.constants("classification", 1)
    assert len(made) == 1


@pytest.mark.parametrize("pairs", [3, 20_000])
@pytest.mark.parametrize("words", [1, 2])
def test_windows_that_read_ahead_jump_back_or_are_long_read_what_a_generator_reads(
    pairs: int, words: int
) -> None:
    streams = PairStreams(1, [("S", f"T-{number}") for number in range(pairs)])
    windows = [
        (0, 7),
        (7, 30),
        (37, 30),
        (30, 9),
        (60, 500),
        (560, 1),
        (561, 100),
        (661, 30),
        (2**40, 30),
    ]
    for first, scans in windows:
        some = np.array([0, 2])
        read = streams.words(
            "detection",
            words,
            some,
            np.array([first, first + 5]),
            np.array([scans, scans // 2 + 1]),
        )
        parts = (0, first, scans), (2, first + 5, scans // 2 + 1)
        keys = [stream_key(1, "S", f"T-{pair}", "detection") for pair, _, _ in parts]
        made = [
            Stream(key, words).words(start, count)
            for key, (_, start, count) in zip(keys, parts, strict=True)
        ]
        assert np.array_equal(read, np.concatenate(made))


def test_a_stream_is_read_for_several_windows_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = np.arange(50)
    calls = []
    words = Reader.words
    monkeypatch.setattr(Reader, "words", lambda *place: calls.append(place) or words(*place))
    streams = PairStreams(1, [("S", f"T-{number}") for number in pairs])
    for first in range(0, 200, 20):
        WindowNumbers(streams, pairs, np.full(50, first), np.full(50, 20)).words("detection")
    assert len(calls) == 50


def test_names_are_distinguished() -> None:
    keys = {
        stream_key(1, "ab", "c"),
        stream_key(1, "a", "bc"),
        stream_key(1, "abc"),
        stream_key(11, "ab", "c"),
    }
    assert len(keys) == 4


def test_uniforms_are_in_the_unit_interval_and_uniform() -> None:
    numbers = uniforms_of(raw(200_000))
    assert numbers.min() >= 0.0
    assert numbers.max() < 1.0
    assert stats.kstest(numbers, "uniform").pvalue > 0.001


def test_extreme_words_give_finite_numbers() -> None:
    ends = np.array([0, 2**64 - 1, 2**63, 2**24 - 1, 2**64 - 2**24], dtype=np.uint64)
    assert np.isfinite(normal_pairs(ends.copy())).all()
    assert uniforms_of(ends.copy()).max() < 1.0


def test_normal_pairs_are_standard_normal_and_independent() -> None:
    first, second = normal_pairs(raw(400_000, seed=5))
    for column in (first, second, (first + second) / np.sqrt(2.0), (first - second) / np.sqrt(2.0)):
        assert stats.kstest(column, "norm").pvalue > 0.001
    assert abs(np.corrcoef(first, second)[0, 1]) < 3.29 / np.sqrt(len(first))
    assert stats.kstest(np.hypot(first, second) ** 2 / 2.0, "expon").pvalue > 0.001


def test_normal_pairs_are_box_and_mullers_to_1e_12() -> None:
    words = raw(10_000, seed=9)
    radius = np.sqrt(-2.0 * np.log1p(-(words >> np.uint64(24)).astype(float) * 2.0**-40))
    turns = (words & np.uint64(4095)).astype(float) / 4096 + (
        (words >> np.uint64(12)) & np.uint64(4095)
    ) / 2.0**24
    first, second = normal_pairs(words)
    assert first == pytest.approx(radius * np.cos(2.0 * np.pi * turns), abs=3e-12)
    assert second == pytest.approx(radius * np.sin(2.0 * np.pi * turns), abs=3e-12)


def test_normal_pairs_are_the_same_however_many_are_made_at_once() -> None:
    words = raw(50_000, seed=10)
    whole = np.array(normal_pairs(words))
    parts = [
        np.array(normal_pairs(words[start : start + 777])) for start in range(0, len(words), 777)
    ]
    assert whole.tobytes() == np.concatenate(parts, axis=1).tobytes()


def test_further_words_are_those_of_splitmix64() -> None:
    # The first five of the seed 1234567, as Rosetta Code's page "Pseudo-random numbers/Splitmix64"
    # has them.
    known = [
        6457827717110365317,
        3203168211198807973,
        9817491932198370423,
        4593380528125082431,
        16408922859458223821,
    ]
    seeds = np.full(5, 1234567, dtype=np.uint64)
    numbers = np.arange(1, 6, dtype=np.uint64)
    assert further_words(seeds, numbers).tolist() == known


def test_normals_spun_from_a_looks_word_are_normal_and_know_nothing_of_its_direction_or_of_other_purposes() -> (
    None
):
    """10 tests of normality, 132 rank correlations of values and of sizes: 99.9 % in all
    (Bonferroni).
    """
    words = raw(60_000, seed=4)
    none = np.zeros(0, dtype=np.int64)
    rows = np.arange(len(words))
    rng = WindowNumbers(PairStreams(1, []), none, none, none).of(rows, rows, words)
    spun = [*rng.normals("measurement", 5).T, *rng.normals("other", 5).T]
    known = [*normal_pairs(words), *spun]
    for column in spun:
        assert stats.kstest(column, "norm").pvalue > 0.001 / 142
    most = stats.norm.isf(0.0005 / 142) / np.sqrt(len(words))
    for values in (np.stack(known), np.abs(known)):
        # Spearman's rank correlation of each pair of columns.
        correlation = np.corrcoef(stats.rankdata(values, axis=1))
        assert np.abs(correlation[np.triu_indices(len(known), 1)]).max() < most
    part = rng.take(slice(100, 200)).normals("measurement", 5)
    assert np.array_equal(part, rng.normals("measurement", 5)[100:200])
    assert np.array_equal(part[:, :2], rng.normals("measurement", 2)[100:200])


def test_a_window_hands_out_the_same_numbers_whichever_rows_ask_first() -> None:
    names = [("S", "T-1"), ("S", "T-2"), ("S", "T-3")]
    columns = np.array([0, 2]), np.array([5, 0]), np.array([4, 3])

    def numbers() -> WindowNumbers:
        return WindowNumbers(PairStreams(1, names), *columns)

    whole = numbers().words("line-of-sight")
    row = np.arange(7)
    pair = np.repeat(columns[0], columns[2])
    late_first = numbers()
    for rows in (slice(5, 6), slice(1, 7), slice(0, 7)):
        found = late_first.of_rows("line-of-sight", 1, row[rows], pair[rows])[:, 0]
        assert np.array_equal(found, whole[rows])
    assert np.array_equal(
        numbers().words("line-of-sight", np.array([False, True])), [0, 0, 0, 0, *whole[4:]]
    )
    both = numbers().of(row, pair).normals("x", 3)
    assert np.array_equal(both[2:5], numbers().of(row, pair).take(slice(2, 5)).normals("x", 3))


def test_pairs_of_a_run_do_not_share_numbers() -> None:
    streams = PairStreams(1, [("S-1", "T-1"), ("S-1", "T-2"), ("S-2", "T-1")])
    words = streams.words(
        "detection", 1, np.arange(3), np.zeros(3, dtype=np.int64), np.full(3, 100)
    )
    assert len(np.unique(words)) == 300
    assert len(np.unique(streams.constants("classification", 2))) == 6
