"""Streams that any part can be read of at any time, and normals that are normal."""

import itertools

import numpy as np
import pytest
from hypothesis import given, strategies as st
from lone_rows import assert_rows_independent
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
    start: int, scans: int, words: int, cuts: list[int]
) -> None:
    key = stream_key(7, "S-1", "T-1", "detection")
    stream = Stream(key, words)
    edges = sorted({0, scans, *(cut for cut in cuts if cut < scans)})
    slices = [stream.words(start + low, high - low) for low, high in itertools.pairwise(edges)]
    expected = Stream(key, words).words(start, scans)
    assert np.array_equal(np.concatenate([*slices, np.empty(0, dtype=np.uint64)]), expected)


def test_going_back_gives_the_same_words_again() -> None:
    stream = Stream(stream_key(7, "a"))
    words = stream.words(1000, 10)
    stream.words(0, 3)
    assert np.array_equal(stream.words(1000, 10), words)


def test_words_are_those_of_numpys_philox() -> None:
    key = stream_key(3, "a", "b")
    assert np.array_equal(
        Stream(key).words(0, 9), np.random.Philox(key=key, counter=0).random_raw(9)
    )


@given(st.integers(0, 2**128 - 1), st.integers(0, 2**66), st.integers(0, 40))
def test_a_reader_reads_what_a_generator_placed_there_reads(
    key: int, start: int, count: int
) -> None:
    reader = Reader()
    reader.words(7, 11, 13)
    generator = np.random.Philox(key=key, counter=start // 4)
    expected = generator.random_raw(start % 4 + count)[start % 4 :]
    assert np.array_equal(reader.words(key, start, count), expected)


def test_all_pairs_and_purposes_of_a_run_share_one_generator(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls = []
    philox = np.random.Philox
    monkeypatch.setattr(np.random, "Philox", lambda **place: calls.append(place) or philox(**place))
    pairs = np.arange(50)
    streams = PairStreams(1, [("S", f"T-{number}") for number in pairs])
    for start in (0, 7, 14):
        numbers = WindowNumbers(streams, pairs, pairs + start, np.full(50, 7))
        numbers.words("detection")
        numbers.of(np.arange(350), np.repeat(pairs, 7)).normals("measurement", 3)
    streams.constants("classification", 1)
    assert len(calls) == 1


@pytest.mark.parametrize("pairs", [3, 20_000])
@pytest.mark.parametrize("words", [1, 2])
def test_windows_anywhere_read_what_a_generator_reads(pairs: int, words: int) -> None:
    """One window after the other, back again, long ones, and one far away."""
    streams = PairStreams(1, [("S", f"T-{number}") for number in range(pairs)])
    starts = [0, 7, 37, 30, 60, 560, 561, 661, 2**40]
    counts = [7, 30, 30, 9, 500, 1, 100, 30, 30]
    numbers = np.array([0, 2])
    for start, count in zip(starts, counts, strict=True):
        scans = np.array([start, start + 5]), np.array([count, count // 2 + 1])
        expected = [
            Stream(stream_key(1, "S", f"T-{pair}", "detection"), words).words(*place)
            for pair, *place in zip(numbers, *(column.tolist() for column in scans), strict=True)
        ]
        read = streams.words("detection", words, numbers, *scans)
        assert np.array_equal(read, np.concatenate(expected))


def test_a_stream_is_read_for_several_windows_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = np.arange(50)
    calls = []
    words = Reader.words
    monkeypatch.setattr(Reader, "words", lambda *place: calls.append(place) or words(*place))
    streams = PairStreams(1, [("S", f"T-{number}") for number in pairs])
    for start in range(0, 200, 20):
        WindowNumbers(streams, pairs, np.full(50, start), np.full(50, 20)).words("detection")
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
    a, b = normal_pairs(raw(400_000, seed=5))
    for column in (a, b, (a + b) / np.sqrt(2.0), (a - b) / np.sqrt(2.0)):
        assert stats.kstest(column, "norm").pvalue > 0.001
    assert abs(np.corrcoef(a, b)[0, 1]) < 3.29 / np.sqrt(len(a))
    assert stats.kstest(np.hypot(a, b) ** 2 / 2.0, "expon").pvalue > 0.001


def test_normal_pairs_are_box_and_mullers_to_1e_12() -> None:
    words = raw(10_000, seed=9)
    radius = np.sqrt(-2.0 * np.log1p(-(words >> 24).astype(float) * 2.0**-40))
    turns = (words & 4095).astype(float) / 4096 + ((words >> 12) & 4095) / 2.0**24
    columns = np.array(normal_pairs(words))
    directions = np.array([np.cos(2.0 * np.pi * turns), np.sin(2.0 * np.pi * turns)])
    np.testing.assert_allclose(columns, radius * directions, rtol=0.0, atol=3e-12)


def test_normal_pairs_are_the_same_however_many_are_made_at_once() -> None:
    rows = [slice(start, start + 777) for start in range(0, 50_000, 777)]
    assert_rows_independent(normal_pairs, raw(50_000, seed=10), rows=rows)


def test_further_words_are_those_of_splitmix64() -> None:
    # The first five of the seed 1234567, as Rosetta Code's page "Pseudo-random numbers/Splitmix64"
    # has them.
    expected = [
        6457827717110365317,
        3203168211198807973,
        9817491932198370423,
        4593380528125082431,
        16408922859458223821,
    ]
    seeds = np.full(5, 1234567, dtype=np.uint64)
    assert further_words(seeds, np.arange(1, 6, dtype=np.uint64)).tolist() == expected


def test_normals_of_a_look_s_word_are_normal_and_independent() -> None:
    """Of its direction and of other purposes: 10 tests of normality, 132 rank correlations of
    values and of sizes: 99.9 % in all (Bonferroni).
    """
    words = raw(60_000, seed=4)
    none = np.zeros(0, dtype=np.int64)
    rows = np.arange(len(words))
    rng = WindowNumbers(PairStreams(1, []), none, none, none).of(rows, rows, words)
    derived = [*rng.normals("measurement", 5).T, *rng.normals("other", 5).T]
    columns = np.array([*normal_pairs(words), *derived])
    for column in derived:
        assert stats.kstest(column, "norm").pvalue > 0.001 / 142
    bound = stats.norm.isf(0.0005 / 142) / np.sqrt(len(words))
    for values in (columns, np.abs(columns)):
        # Spearman's rank correlation of each pair of columns.
        correlation = np.corrcoef(stats.rankdata(values, axis=1))
        assert np.abs(correlation[np.triu_indices(len(columns), 1)]).max() < bound
    taken = rng.take(slice(100, 200)).normals("measurement", 5)
    assert np.array_equal(taken, rng.normals("measurement", 5)[100:200])
    assert np.array_equal(taken[:, :2], rng.normals("measurement", 2)[100:200])


def test_numbers_do_not_depend_on_which_rows_ask_first() -> None:
    names = [("S", "T-1"), ("S", "T-2"), ("S", "T-3")]
    columns = np.array([0, 2]), np.array([5, 0]), np.array([4, 3])

    def numbers() -> WindowNumbers:
        return WindowNumbers(PairStreams(1, names), *columns)

    words = numbers().words("line-of-sight")
    row = np.arange(7)
    pair = np.repeat(columns[0], columns[2])
    window = numbers()
    for rows in (slice(5, 6), slice(1, 7), slice(0, 7)):
        of_rows = window.of_rows("line-of-sight", 1, row[rows], pair[rows])[:, 0]
        assert np.array_equal(of_rows, words[rows])
    masked = numbers().words("line-of-sight", np.array([False, True]))
    assert np.array_equal(masked, [0, 0, 0, 0, *words[4:]])
    normals = numbers().of(row, pair).normals("x", 3)
    assert np.array_equal(normals[2:5], numbers().of(row, pair).take(slice(2, 5)).normals("x", 3))


def test_pairs_of_a_run_do_not_share_numbers() -> None:
    streams = PairStreams(1, [("S-1", "T-1"), ("S-1", "T-2"), ("S-2", "T-1")])
    words = streams.words(
        "detection", 1, np.arange(3), np.zeros(3, dtype=np.int64), np.full(3, 100)
    )
    assert len(np.unique(words)) == 300
    assert len(np.unique(streams.constants("classification", 2))) == 6
