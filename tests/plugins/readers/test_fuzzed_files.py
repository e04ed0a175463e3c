"""Spoilt files of every format: refused with a reason or read to finite numbers, soon and in little
memory.

`OPIR_FUZZ_S=600 python -m pytest tests/plugins/readers/test_fuzzed_files.py` searches for 600
seconds in all.
"""

import os
import random
import time
import tracemalloc
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, strategies as st
from opir_readers.reading import reader_of
from opir_readers.table_checks import findings_of
from read_files import READERS, read
from repository import DATA

from opir_core.plugin import BadFileError, StateTable

SITE = {"lat_deg": 34.73, "lon_deg": -120.57, "height_m": 100.0, "azimuth_deg": 270.0}
NAMES = [reader.name for reader in READERS]
SECONDS = float(os.environ.get("OPIR_FUZZ_S", "0"))

#: Replacements of a word.
WORDS = (DATA / "spoilt_words.txt").read_text(encoding="utf-8").split("\n")
SEPARATORS = ' ,;\t\n=<>"'


def require_whole(reader, text):
    """Read a text as `opir import` does, and require that the content is whole."""
    with suppress(BadFileError):
        reader_of(text, READERS)
    has_site = any(field.name == "site" for field in reader.config.__attrs_attrs__)
    try:
        content = read(reader.name, text, **({"site": SITE} if has_site else {}))
    except BadFileError as refused:
        reason = str(refused)
        assert len(reason) > 3
        return
    if not isinstance(content, StateTable):
        assert len(content) > 0
        return
    velocity = [] if content.velocity_m_s is None else content.velocity_m_s
    for values in (content.time_s, content.position_m, velocity, content.burns_s):
        assert np.isfinite(values).all()
    assert (content.burns_s[:, 1] > content.burns_s[:, 0]).all()
    findings_of(content)
    content.line_of(len(content.time_s) - 1)


def spoilt(text, rng):
    """Return a text with a few of its words, lines or characters changed."""
    for _ in range(rng.randint(1, 4)):
        kind = rng.randrange(6)
        if kind == 0 and text:
            place = rng.randrange(len(text))
            text = text[:place] + rng.choice(WORDS) + text[place + rng.randint(0, 3) :]
        elif kind in (1, 2):
            mark = rng.choice(SEPARATORS)
            words = text.split(mark)
            words[rng.randrange(len(words))] = rng.choice(WORDS)
            text = mark.join(words)
        else:
            lines = text.split("\n")
            i = rng.randrange(len(lines))
            j = rng.randrange(len(lines))
            if kind == 3:
                lines[i], lines[j] = lines[j], lines[i]
            elif kind == 4:
                lines.insert(i, lines[j])
            else:
                del lines[i]
            text = "\n".join(lines)
    return text


@pytest.mark.parametrize("reader", READERS, ids=NAMES)
@given(seed=st.integers(0, 2**32))
def test_spoilt_files_are_refused_or_read(reader, seed):
    require_whole(reader, spoilt(reader.example, random.Random(seed)))


@pytest.mark.parametrize("reader", READERS, ids=NAMES)
@given(
    text=st.text(
        alphabet=st.sampled_from("0123456789.,;=<>/{}[]\"'#*PV+-eE \n\tTZabcXYZ:°"), max_size=200
    )
)
def test_any_text_is_refused_or_read(reader, text):
    require_whole(reader, text)
    require_whole(reader, reader.example[: len(reader.example) // 2] + text)


@pytest.mark.parametrize("end", ["", "]", " (km)"])
def test_a_line_of_brackets_is_read_in_one_pass(end):
    """A search from each bracket to the end would take minutes: longer than a test may."""
    text = "[" * 200_000 + end
    with pytest.raises(BadFileError):
        reader_of(text, READERS)


def cost(reader, text):
    """Return the processor time, s, and the memory, bytes, of reading a text."""
    tracemalloc.start()
    began_s = time.process_time()
    require_whole(reader, text)
    elapsed_s = time.process_time() - began_s
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return elapsed_s, peak


@pytest.mark.skipif(not SECONDS, reason="set OPIR_FUZZ_S")
@pytest.mark.parametrize("reader", READERS, ids=NAMES)
def test_a_longer_search_finds_nothing_slow_or_large(reader):
    rng = random.Random(f"{reader.name} {SECONDS}")
    end_s = time.monotonic() + SECONDS / len(READERS)
    count = 0
    require_whole(reader, reader.example)  # what it imports is not the file's
    while time.monotonic() < end_s:
        text = spoilt(reader.example * rng.choice((1, 1, 1, 3)), rng)
        elapsed_s, peak = cost(reader, text)
        assert elapsed_s < 2.0, text
        assert peak < 20e6 + 500 * len(text), text
        count += 1
    assert count > 10


@pytest.mark.parametrize("reader", READERS, ids=NAMES)
def test_memory_and_time_are_bounded_by_the_file(reader):
    require_whole(reader, reader.example)
    text = reader.example + "".join(reader.example.splitlines(keepends=True)[-2:]) * 3_000
    elapsed_s, peak = cost(reader, text)
    assert peak < 20e6 + 100 * len(text)
    assert elapsed_s < 30.0
