"""Broken renderers, and the sound one that they are made of."""

from typing import Any

import numpy as np
from attrs import field, frozen

from broken_components.offers import SOUND, mutant
from opir_core.plugin import Renderer, RendererModel


def offered(name, caught_by):
    """Offer a class that is made with the reference."""

    def offer(renderer):
        mutant(RendererModel, name, caught_by)(lambda _config, context: renderer(context.reference))
        return renderer

    return offer


def kinds(columns):
    return ["text" if isinstance(column, bytes) else column.plain()[0] for column in columns]


@offered("sound-renderer", "none")
@frozen
class Sound:
    reference: Renderer

    def __call__(self, count, columns):
        return self.reference(count, columns)


SOUND.add((RendererModel.hook, "sound-renderer"))


@offered("rowless", "test_texts_are_those_of_the_reference")
@frozen
class Rowless(Sound):
    def __call__(self, count, columns):
        lines = self.reference(count, columns)
        return b"\n".join(sorted(lines.split(b"\n"))) if "looked" in kinds(columns) else lines


@offered("writes-nan", "test_numbers_are_those_of_the_reference")
@frozen
class WritesNan(Sound):
    def __call__(self, count, columns):
        return self.reference(count, columns).replace(b"null", b"NaN")


@offered("capitals", "test_ids_and_times_are_those_of_the_reference")
@frozen
class Capitals(Sound):
    def __call__(self, count, columns):
        lines = self.reference(count, columns)
        return lines.upper() if "ids" in kinds(columns) else lines


@offered("never-empty", "test_no_lines_are_no_bytes")
@frozen
class NeverEmpty(Sound):
    def __call__(self, count, columns):
        return self.reference(count, columns) or b"\n"


@offered("rounds-in-place", "test_columns_are_not_modified")
@frozen
class RoundsInPlace(Sound):
    def __call__(self, count, columns):
        lines = self.reference(count, columns)
        for column in columns:
            if not isinstance(column, bytes) and column.plain()[0] == "decimal":
                np.round(column.values, column.decimals, out=column.values)
        return lines


@offered("holds-a-lambda", "test_a_built_renderer_pickles")
@frozen
class HoldsALambda(Sound):
    held: Any = field(default=lambda: None)
