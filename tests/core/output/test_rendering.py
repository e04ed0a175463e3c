"""Lines from typed columns: the compiled renderer makes the bytes of the reference, whose numbers
read back.
"""

import json
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from uuid import UUID

import numpy as np
import pytest
from hypothesis import assume, example, given, strategies as st

from opir_core.errors import PluginError, SinkError
from opir_core.output import Column, Decimal, Ids, Looked, Times, chosen_renderer, reference
from opir_core.output.events.text import END_UNIX_US, FIRST_UNIX_US
from opir_core.plugin import Host, RendererContext, RendererModel, hookimpl

LINES = 5
words = st.integers(0, 2**64 - 1)
rows = st.lists(st.integers(0, 3), min_size=LINES, max_size=LINES)
numbers = st.one_of(
    st.floats(),
    st.floats(-1e-3, 1e-3),
    st.floats(-360.0, 360.0),
    st.integers(-(10**16), 10**16).map(float),
    st.tuples(st.integers(-(10**7), 10**7), st.integers(0, 12)).map(
        lambda pair: pair[0] / 10.0 ** pair[1]
    ),
)
columns = st.one_of(
    st.binary(max_size=5),
    st.tuples(st.lists(st.binary(max_size=6), min_size=4, max_size=4), rows).map(
        lambda pair: Looked(pair[0], np.array(pair[1]))
    ),
    st.lists(st.binary(max_size=6), min_size=LINES, max_size=LINES).map(Looked),
    st.tuples(st.lists(numbers, min_size=LINES, max_size=LINES), st.integers(0, 12)).map(
        lambda pair: Decimal(np.array(pair[0]), pair[1])
    ),
    st.lists(st.tuples(words, words), min_size=LINES, max_size=LINES).map(
        lambda ids: Ids(np.array(ids, np.uint64))
    ),
    st.lists(st.integers(FIRST_UNIX_US, END_UNIX_US - 1), min_size=LINES, max_size=LINES).map(
        lambda times: Times(np.array(times))
    ),
)


@cache
def compiled() -> Callable[..., bytes]:
    pytest.importorskip("opir_render.compiled", reason="needs opir-render, built with a compiler")
    component = Host.discover(["render"]).component(RendererModel, "compiled")
    render: Callable[..., bytes] = component.build(
        component.config(), RendererContext(reference=reference)
    )
    return render


@given(st.lists(columns, max_size=8))
def test_the_compiled_renderer_makes_the_bytes_of_the_reference(line: list[Column]) -> None:
    # A NUL at the end of a text of fixed width is no text of JSON.
    assume(all(b"\0" not in column for column in line if isinstance(column, bytes)))
    assert compiled()(LINES, line) == reference(LINES, line)


@given(st.lists(numbers, min_size=1), st.integers(0, 12))
@example(
    [0.1 + 0.2, -0.0, 5e-10, 9.99999999949e-6, 1e-5, 123456789.0, 999999.9999999995, 1e15, 1e22], 9
)
def test_renderers_write_the_shortest_text_of_a_double(values: list[float], decimals: int) -> None:
    column = Decimal(np.array(values), decimals)
    texts = reference(len(values), [column, b"\n"]).splitlines()
    assert compiled()(len(values), [column, b"\n"]).splitlines() == texts
    scale = 10.0**decimals
    for value, text in zip(values, map(json.loads, texts), strict=True):
        if not np.isfinite(value):
            assert text is None
        elif abs(value) < 2.0**52 / scale:
            assert text == np.rint(value * scale) / scale
        else:
            assert text == value


@given(words, words, st.integers(FIRST_UNIX_US, END_UNIX_US - 1))
def test_ids_and_times_read_back(high: int, low: int, unix_us: int) -> None:
    line = [Ids(np.array([[high, low]], np.uint64)), b" ", Times(np.array([unix_us]))]
    for render in {reference, compiled()}:
        identity, time = render(1, line).decode().split(" ")
        assert identity == str(UUID(int=high << 64 | low))
        assert np.datetime64(time[:-1], "us").astype(np.int64) == unix_us
        assert time[-1] == "Z"


@pytest.mark.parametrize("unix_us", [FIRST_UNIX_US - 1, END_UNIX_US])
def test_a_time_outside_the_years_of_timestamps_is_refused(unix_us: int) -> None:
    with pytest.raises(SinkError, match="years 1 to 9999"):
        Times(np.array([unix_us]))


@pytest.mark.parametrize(
    ("column", "error"),
    [
        (Looked([b"a"], np.array([0, 1])), IndexError),
        (Looked([b"a"], np.array([0, -1])), IndexError),
        (Looked([b"a"]), IndexError),
        (Decimal(np.zeros(3), 2), ValueError),
        (Decimal(np.zeros(2), 23), ValueError),
        (Ids(np.zeros((2, 1), np.uint64)), ValueError),
    ],
)
def test_the_compiled_renderer_refuses_columns_of_another_length(
    column: Column, error: type[Exception]
) -> None:
    with pytest.raises(error):
        compiled()(2, [column])


class Traced:
    """A plugin with a renderer of its own."""

    @hookimpl
    def opir_renderers(self) -> Iterable[RendererModel]:
        yield RendererModel(
            name="traced", summary="the reference", build=lambda _config, _context: traced
        )


def traced(count: int, columns: Sequence[Column]) -> bytes:
    return reference(count, columns)


def test_the_environment_chooses_the_renderer(monkeypatch: pytest.MonkeyPatch) -> None:
    host = Host.of(Traced())
    for name, render in (("reference", reference), ("traced", traced)):
        monkeypatch.setenv("OPIR_RENDERER", name)
        assert chosen_renderer(host) == (name, render)
    monkeypatch.delenv("OPIR_RENDERER")
    assert chosen_renderer(host) == ("reference", reference)


def test_a_missing_renderer_is_refused_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OPIR_RENDERER", "fast")
    with pytest.raises(
        PluginError, match=r"(?s)OPIR_RENDERER: no renderer is named 'fast'.*installed: reference"
    ):
        chosen_renderer(Host.of())
    monkeypatch.setenv("OPIR_RENDERER", "compiled")
    with pytest.raises(
        PluginError,
        match=r"opir-render provides it; from a clone of opir: .* install \./plugins/opir_render",
    ):
        chosen_renderer(Host.of())
