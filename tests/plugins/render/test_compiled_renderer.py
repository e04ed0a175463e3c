"""The compiled renderer passes the conformance tests of its hook; without a compiler the reference
is used.
"""

import sys

import pytest
from opir_testing import RendererContract

from opir_core.errors import SinkError
from opir_core.output import chosen_renderer, reference
from opir_core.plugin import Host

pytest.importorskip("opir_render.compiled", reason="needs opir-render, built with a compiler")


class TestCompiledRenderer(RendererContract):
    name = "compiled"


def test_the_compiled_renderer_is_used_where_it_is_installed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("OPIR_RENDERER", raising=False)
    assert chosen_renderer(Host.discover())[0] == "compiled"
    assert chosen_renderer(Host.discover(["render"]))[0] == "compiled"
    assert chosen_renderer(Host.discover([])) == ("reference", reference)


def test_without_a_compiler_the_reference_is_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "opir_render.compiled", None)
    monkeypatch.delenv("OPIR_RENDERER", raising=False)
    assert chosen_renderer(Host.discover()) == ("reference", reference)
    monkeypatch.setenv("OPIR_RENDERER", "compiled")
    words = r"OPIR_RENDERER=compiled: .*where a C compiler is, .*install \./plugins/opir_render"
    with pytest.raises(SinkError, match=words):
        chosen_renderer(Host.discover())
