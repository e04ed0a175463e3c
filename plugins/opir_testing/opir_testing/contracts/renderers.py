"""Conformance tests of renderers: the bytes of the reference."""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from opir_core.errors import kind_of
from opir_core.output import Column, Decimal, Ids, Looked, Times, reference
from opir_core.plugin import Renderer, RendererContext, RendererModel
from opir_testing.contracts.contract import Contract, require, require_equal, require_pickling

_ROWS = 60


class RendererContract(Contract):
    """Conformance tests of a renderer."""

    kind = RendererModel

    @classmethod
    @cache
    def renderer(cls) -> Renderer:
        """Return the built renderer."""
        output: Renderer = cls.component().build(cls.config(), RendererContext(reference=reference))
        require(
            callable(output),
            f"build returned {kind_of(output)}",
            "Return a function of a number and of columns.",
        )
        return output

    @classmethod
    def part(cls) -> Any:
        """Return the built renderer."""
        return cls.renderer()

    def exercise(self) -> object:
        """Build the renderer and render a line."""
        return self.renderer()(1, [b"[", Decimal(np.zeros(1), 3), b"]\n"])

    def require_reference(self, lines: Mapping[str, Sequence[Column]], count: int = _ROWS) -> None:
        """Require the bytes of the reference for the columns of lines, by description."""
        for name, columns in lines.items():
            expected = reference(count, columns)
            output = self.renderer()(count, columns)
            places = [
                place
                for place, (expected_byte, output_byte) in enumerate(
                    zip(expected, output, strict=False)
                )
                if expected_byte != output_byte
            ]
            at = places[0] if places else min(len(expected), len(output))
            require(
                output == expected,
                f"{name}: {output[at : at + 40]!r} at byte {at}, where the reference has"
                f" {expected[at : at + 40]!r}",
                "Return the bytes that context.reference(count, columns) returns.",
            )

    def test_texts_are_those_of_the_reference(self) -> None:
        """Text common to all lines, text of each line and text by row are joined as by the
        reference.
        """
        texts = [b"", b"a", b'"long text"', "é\u2028".encode()]
        row = np.arange(_ROWS) * 7 % len(texts)
        self.require_reference(
            {
                "common text": [b"{", b"}\n"],
                "text by row": [b"{", Looked(texts, row), b"}\n"],
                "text of each line": [
                    Looked([texts[place] for place in row.tolist()]),
                    Looked(texts, row),
                    b"\n",
                ],
            }
        )

    def test_numbers_are_those_of_the_reference(self) -> None:
        """Numbers are rounded and written as by the reference, the extreme, infinite and unknown
        ones too.
        """
        extreme = [
            0.0,
            -0.0,
            0.1 + 0.2,
            5e-10,
            1e-5,
            999999.9999999995,
            2.0**53,
            1e16,
            1e22,
            -1e300,
            5e-324,
        ]
        values = np.resize([*extreme, np.nan, np.inf, -np.inf, 0.5, -2.5, 123456.789], _ROWS)
        spread = np.random.default_rng(1).normal(size=_ROWS) * 10.0 ** np.linspace(
            -12.0, 12.0, _ROWS
        )
        self.require_reference(
            {
                f"{name} numbers, {decimals} decimals": [b"[", Decimal(column, decimals), b"]\n"]
                for name, column in {"extreme": values, "usual": spread}.items()
                for decimals in (0, 3, 9, 12)
            }
        )

    def test_ids_and_times_are_those_of_the_reference(self) -> None:
        """Ids and times are written as by the reference, those that stand twice in a line too."""
        words = np.random.default_rng(2).integers(0, 2**64, (_ROWS, 2), dtype=np.uint64)
        ids = Ids(words)
        times = Times(np.linspace(-6e16, 2.5e17, _ROWS).astype(np.int64))
        self.require_reference({"ids and times": [b'"', ids, b'","', times, b'","', times, b'"\n']})

    def test_no_lines_are_no_bytes(self) -> None:
        """No lines give no bytes, and one line is one."""
        for count in (0, 1):
            number = Decimal(np.full(count, 0.25), 3)
            ids = Ids(np.zeros((count, 2), np.uint64))
            self.require_reference({f"{count} lines": [b"[", number, b',"', ids, b'"]\n']}, count)

    def test_columns_are_not_modified(self) -> None:
        """A renderer does not change its columns: they are those of the engine."""
        values = np.linspace(-1.0, 1.0, _ROWS)
        self.renderer()(_ROWS, [Decimal(values, 3), b"\n"])
        is_equal = np.array_equal(values, np.linspace(-1.0, 1.0, _ROWS))
        require_equal(
            is_equal, "numbers change when they are written", "Copy columns before changing them."
        )

    def test_a_built_renderer_pickles(self) -> None:
        """The built renderer can be pickled, and its copy returns the same bytes."""
        columns: list[Any] = [b"[", Decimal(np.arange(3.0), 1), b"]\n"]
        is_equal = require_pickling(self.renderer())(3, columns) == self.renderer()(3, columns)
        require_equal(
            is_equal, "a pickled copy returns other bytes", "Keep all state in fields that pickle."
        )
