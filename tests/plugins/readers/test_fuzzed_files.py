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
from opir_readers.configs_of_sites import SiteConfig
from opir_readers.formats import READERS
from opir_readers.reading import reader_of
from opir_readers.table_checks import findings_of

from opir_core.plugin import BadFileError, ReaderContext, StateTable

SITE = SiteConfig(lat_deg=34.73, lon_deg=-120.57, height_m=100.0, azimuth_deg=270.0)
NAMES = [reader.name for reader in READERS]
SECONDS = float(os.environ.get("OPIR_FUZZ_S", "0"))

#: What a word may become.
WORDS = (
    *(
        "",
        "0",
        "-0",
        "1",
        "-1",
        "1e999",
        "-1e308",
        "1e-320",
        "nan",
        "inf",
        "1_000",
        "٣",
        "0x10",
        "1,5",
        "1e",
        "--5",
    ),
    *(
        "9" * 400,
        "x" * 400,
        "\t",
        "é",
        "\u202e",
        "=",
        "#",
        '"',
        "<",
        ">",
        "{",
        "]",
        "2026-13-45T99:99:99",
        "99999",
    ),
    *(
        "9999-12-31T23:59:59",
        "0001-01-01T00:00:00",
        "2026-366T00:00:00",
        "-5600",
        "1e7",
        "360",
        "-91",
        "null",
        "true",
    ),
)
SEPARATORS = ' ,;\t\n=<>"'


def context_of(reader, text):
    config = (
        reader.config(site=SITE)
        if any(a.name == "site" for a in reader.config.__attrs_attrs__)
        else reader.config()
    )
    return config, ReaderContext(text=text, epoch_us=1_775_044_800_000_000)


def read(reader, text):
    """Read a text as `opir import` does, and require that what comes is whole."""
    with suppress(BadFileError):
        reader_of(text, READERS)
    try:
        content = reader.build(*context_of(reader, text))
    except BadFileError as refused:
        reason = str(refused)
        assert len(reason) > 3
        return
    if isinstance(content, StateTable):
        assert np.isfinite(content.time_s).all()
        assert np.isfinite(content.position_m).all()
        assert content.velocity_m_s is None or np.isfinite(content.velocity_m_s).all()
        assert np.isfinite(content.burns_s).all()
        assert (content.burns_s[:, 1] > content.burns_s[:, 0]).all()
        findings_of(content)
        content.line_of(len(content.time_s) - 1)
    else:
        assert len(content) > 0


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
            one = rng.randrange(len(lines))
            other = rng.randrange(len(lines))
            if kind == 3:
                lines[one], lines[other] = lines[other], lines[one]
            elif kind == 4:
                lines.insert(one, lines[other])
            else:
                del lines[one]
            text = "\n".join(lines)
    return text


@pytest.mark.parametrize("reader", READERS, ids=NAMES)
@given(seed=st.integers(0, 2**32))
def test_spoilt_files_are_refused_or_read(reader, seed):
    read(reader, spoilt(reader.example, random.Random(seed)))


@pytest.mark.parametrize("reader", READERS, ids=NAMES)
@given(
    text=st.text(
        alphabet=st.sampled_from("0123456789.,;=<>/{}[]\"'#*PV+-eE \n\tTZabcXYZ:°"), max_size=200
    )
)
def test_any_text_is_refused_or_read(reader, text):
    read(reader, text)
    read(reader, reader.example[: len(reader.example) // 2] + text)


@pytest.mark.skipif(not SECONDS, reason="set OPIR_FUZZ_S")
@pytest.mark.parametrize("reader", READERS, ids=NAMES)
def test_a_longer_search_finds_nothing_slow_or_large(reader):
    rng = random.Random(f"{reader.name} {SECONDS}")
    end_s = time.monotonic() + SECONDS / len(READERS)
    count = 0
    read(reader, reader.example)  # what it imports is not the file's
    while time.monotonic() < end_s:
        text = spoilt(reader.example * rng.choice((1, 1, 1, 3)), rng)
        tracemalloc.start()
        began_s = time.process_time()
        read(reader, text)
        took_s = time.process_time() - began_s
        (_, peak) = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert took_s < 2.0, text
        assert peak < 20e6 + 500 * len(text), text
        count += 1
    assert count > 10


@pytest.mark.parametrize("reader", READERS, ids=NAMES)
def test_memory_and_time_are_bounded_by_the_file(reader):
    read(reader, reader.example)
    text = reader.example + "".join(reader.example.splitlines(keepends=True)[-2:]) * 3_000
    tracemalloc.start()
    began_s = time.process_time()
    read(reader, text)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20e6 + 100 * len(text)
    assert time.process_time() - began_s < 30.0
