"""What varies in a study: paths of the scene with their levels, and the designs made of them."""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.errors import Problem, SceneError
from opir_core.reading import InvalidNode, data_of_node, node_of_scalar, node_of_yaml
from opir_studies.refusals import refusal
from opir_studies.sobol import sobol_points
from opir_studies.study import FACTORIAL, LATIN_HYPERCUBE, SAMPLED, SOBOL, Study

#: The most designs of a study.
MAXIMUM_DESIGNS = 10_000

_SCALES = ("linear", "log")
#: Digits of the values of ranges and of a Latin hypercube.
_DIGITS = 6


class AxisError(ValueError):
    """An invalid axis; the message names the valid forms."""


@frozen
class Level:
    """One value of an axis: its label in tables, and the text of its override."""

    label: str | float | int | bool | None
    text: str


@frozen
class Axis:
    """A path of the scene with its levels, or with an interval to draw from for a Latin
    hypercube.
    """

    path: str
    levels: tuple[Level, ...] = ()
    interval: tuple[float, float] | None = None
    is_log: bool = False


@frozen
class Design:
    """A combination of levels, one of each axis; designs are numbered from 0."""

    number: int
    levels: tuple[Level, ...]
    paths: tuple[str, ...]

    @property
    def overrides(self) -> list[str]:
        """Return the overrides that make the design's scene."""
        return [f"{path}={level.text}" for path, level in zip(self.paths, self.levels, strict=True)]

    @property
    def labels(self) -> str:
        """Return the values in words, `tracker=imm`."""
        return ", ".join(
            f"{path}={level.label}" for path, level in zip(self.paths, self.levels, strict=True)
        )

    @property
    def name(self) -> str:
        """Return the design in words, `design 2 (tracker=imm)`."""
        labels = self.labels
        return f"design {self.number}{f' ({labels})' if labels else ''}"


def designs_of(study: Study) -> tuple[Design, ...]:
    """Return the designs of a study; raises `SceneError` with every axis that is invalid."""
    problems = list[Problem]()
    is_sampled = study.design in SAMPLED
    axes = axes_of(study.vary, "vary", problems, is_sampled=is_sampled)
    conditions = axes_of(study.conditions, "conditions", problems)
    problems += [
        Problem(f"conditions.{path}", "varies too; name it in `vary` or in `conditions`")
        for path in study.conditions
        if path in study.vary
    ]
    if is_sampled and not study.vary:
        problems.append(Problem("vary", f"{study.design} needs at least one path that varies"))
    if problems:
        raise SceneError(problems, source=f"study {study.study}")
    combinations = list(product(*(axis.levels for axis in conditions)))
    pairs = product(_limited(_combinations(study, axes)), combinations)
    rows = list(_limited([*levels, *condition] for levels, condition in pairs))
    if len(rows) > MAXIMUM_DESIGNS:
        words = (
            f"gives more than {MAXIMUM_DESIGNS} designs; vary less, or use design:"
            f" {LATIN_HYPERCUBE}"
        )
        raise refusal("vary", words, f"study {study.study}")
    paths = tuple(axis.path for axis in (*axes, *conditions))
    return tuple(Design(number, tuple(row), paths) for number, row in enumerate(rows))


def axes_of(
    paths: Mapping[str, Any], key: str, problems: list[Problem], *, is_sampled: bool = False
) -> list[Axis]:
    """Return the axes of paths with values under a key of the study; problems are added to those
    that there are.
    """
    axes = list[Axis]()
    for path, values in paths.items():
        try:
            axes.append(axis_of(path, values, is_sampled=is_sampled))
        except AxisError as error:
            problems.append(Problem(f"{key}.{path}", str(error)))
    return axes


def _limited(rows: Iterable[Sequence[Level]]) -> Iterator[Sequence[Level]]:
    yield from (row for _, row in zip(range(MAXIMUM_DESIGNS + 1), rows, strict=False))


def _combinations(study: Study, axes: Sequence[Axis]) -> Iterable[Sequence[Level]]:
    if study.design == LATIN_HYPERCUBE:
        return _hypercube(axes, study.samples, study.seed)
    if study.design == SOBOL:
        return _sobol(axes, study.samples, study.seed)
    if study.design == FACTORIAL:
        return product(*(axis.levels for axis in axes))
    reference = [axis.levels[0] for axis in axes]
    changes = ((place, level) for place, axis in enumerate(axes) for level in axis.levels[1:])
    return [
        reference,
        *([*reference[:place], level, *reference[place + 1 :]] for place, level in changes),
    ]


def _hypercube(axes: Sequence[Axis], samples: int, seed: int) -> Iterator[Sequence[Level]]:
    """Yield the samples of a Latin hypercube; each list is cut into parts of equal probability."""
    from scipy.stats import qmc  # takes half a second

    points = qmc.LatinHypercube(len(axes), seed=np.random.default_rng(seed)).random(samples)
    for point in points.tolist():
        yield [_drawn(axis, uniform) for axis, uniform in zip(axes, point, strict=True)]


def _sobol(axes: Sequence[Axis], samples: int, seed: int) -> Iterator[Sequence[Level]]:
    """Yield the designs of Sobol indices, as `sobol_points` orders them."""
    for point in sobol_points(len(axes), samples, seed).tolist():
        yield [_drawn(axis, uniform) for axis, uniform in zip(axes, point, strict=True)]


def _drawn(axis: Axis, uniform: float) -> Level:
    if axis.interval is None:
        return axis.levels[min(int(uniform * len(axis.levels)), len(axis.levels) - 1)]
    low, high = axis.interval
    return _level(
        _rounded(low * (high / low) ** uniform if axis.is_log else low + (high - low) * uniform)
    )


def axis_of(path: str, values: Any, *, is_sampled: bool = False) -> Axis:
    """Return the axis of a path and its values in a study; raises `AxisError`."""
    if isinstance(values, Mapping):
        return _axis_of_block(path, values, is_sampled)
    if isinstance(values, str) or not isinstance(values, Sequence):
        values = [values]
    if not values:
        raise AxisError("the list is empty; give at least one value")
    return _with_distinct_levels(path, [_level(value) for value in values])


def _with_distinct_levels(path: str, levels: Sequence[Level]) -> Axis:
    twice = [level.label for place, level in enumerate(levels) if level in levels[:place]]
    if twice:
        raise AxisError(f"{twice[0]} is given twice")
    return Axis(path, tuple(levels))


def _axis_of_block(path: str, block: Mapping[str, Any], is_sampled: bool) -> Axis:
    keys = set(block)
    if keys == {"named"} and isinstance(block["named"], Mapping) and block["named"]:
        return Axis(
            path, tuple(Level(name, override_text(value)) for name, value in block["named"].items())
        )
    if "uniform" in keys and keys <= {"uniform", "scale"}:
        if not is_sampled:
            raise AxisError(
                f"uniform is for design: {LATIN_HYPERCUBE}; give a list, or from, to and count"
            )
        low, high = _bounds(block["uniform"], block.get("scale"))
        return Axis(path, interval=(low, high), is_log=block.get("scale") == "log")
    if {"from", "to"} <= keys <= {"from", "to", "step"} or {"from", "to", "count"} <= keys <= {
        *_COUNTED
    }:
        low, high = _bounds([block["from"], block["to"]], block.get("scale"))
        return _with_distinct_levels(path, [_level(value) for value in _range(block, low, high)])
    words = (
        "write a list, {from, to, step}, {from, to, count, scale}, {uniform: [low, high]} or"
        " {named: {name: value}}"
    )
    raise AxisError(f"{{{', '.join(map(str, block))}}} says no values; {words}")


_COUNTED = ("from", "to", "count", "scale")


def _bounds(pair: Any, scale: Any) -> tuple[float, float]:
    is_pair = isinstance(pair, Sequence) and len(pair) == 2 and all(map(_is_number, pair))
    if not is_pair or not pair[0] < pair[1]:
        raise AxisError(f"{pair!r} is not [low, high] with low below high")
    if scale not in (None, *_SCALES):
        raise AxisError(f"scale {scale!r} is not linear or log")
    if scale == "log" and pair[0] <= 0:
        raise AxisError("a logarithmic scale needs positive bounds")
    return float(pair[0]), float(pair[1])


def _range(block: Mapping[str, Any], low: float, high: float) -> Sequence[float]:
    step = block.get("step", 0.0)
    count = block.get("count")
    if "count" in block:
        if type(count) is not int or not 2 <= count <= MAXIMUM_DESIGNS:
            raise AxisError(f"count {count!r} is not a whole number from 2 to {MAXIMUM_DESIGNS}")
        spaced = np.geomspace if block.get("scale") == "log" else np.linspace
        return [_rounded(value) for value in spaced(low, high, count).tolist()]
    if not _is_number(step) or step <= 0 or (high - low) / step > MAXIMUM_DESIGNS:
        raise AxisError(
            f"step {step!r} is not positive, or gives more than {MAXIMUM_DESIGNS} values; give"
            f" step, or count"
        )
    return [
        _rounded(low + step * number)
        for number in range(math.floor((high - low) / step * (1 + 1e-12)) + 1)
    ]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _rounded(value: float) -> float:
    short = float(f"{value:.{_DIGITS}g}")
    return int(short) if short.is_integer() and abs(short) < 2**53 else short


def _level(value: Any) -> Level:
    text = override_text(value)
    return Level(value if value is None or isinstance(value, str | int | float) else text, text)


def override_text(value: Any) -> str:
    """Return a value as the text of an override."""
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False)


def vary_of_text(words: str) -> tuple[str, Any]:
    """Return path and values of `--vary PATH=VALUES`; values are separated by commas, or a block in
    {}.

    Raises `AxisError` for any other text.
    """
    path, equals, text = words.partition("=")
    if not equals or not path.strip() or not text.strip():
        raise AxisError(f"{words!r} has no values; write PATH=VALUE,VALUE")
    try:
        values = [_value(word) for word in _split(text)]
    except InvalidNode as refused:
        raise AxisError(
            "; ".join(complaint.message for complaint in refused.complaints)
        ) from refused
    is_block = len(values) == 1 and isinstance(values[0], dict)
    return path.strip(), values[0] if is_block and {"from", "uniform", "named"} & values[
        0
    ].keys() else values


def vary_argument(words: str, flag: str = "--vary") -> tuple[str, Any]:
    """Return path and values of an argument of a flag; raises `SceneError` for any other text."""
    try:
        return vary_of_text(words)
    except AxisError as error:
        raise refusal(flag, str(error)) from error


def combinations(vary: Mapping[str, Any]) -> list[Design]:
    """Return the designs of all values of paths, one without any; raises `SceneError`."""
    try:
        axes = [axis_of(path, values) for path, values in vary.items()]
    except AxisError as error:
        raise refusal("--vary", str(error)) from error
    rows = _limited(product(*(axis.levels for axis in axes)))
    paths = tuple(axis.path for axis in axes)
    return [Design(number, tuple(row), paths) for number, row in enumerate(rows)]


def _value(text: str) -> Any:
    if not text.strip():
        raise AxisError("a value is missing between two commas")
    return value_of_text(text)


def value_of_text(text: str) -> Any:
    """Return the value of a text of the command line: YAML in quotes or brackets, else a scalar.

    Raises `InvalidNode` for invalid YAML, and `IndexError` for an empty text.
    """
    plain = text.strip()
    make_node = node_of_yaml if plain[0] in "'\"[{" else node_of_scalar
    return data_of_node(make_node(plain, plain))


def _split(text: str) -> Iterator[str]:
    """Yield the parts of a text between commas outside quotes and brackets."""
    depth = 0
    quote = ""
    start = 0
    for place, letter in enumerate(text):
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "'\"":
            quote = letter
        elif letter in "[{":
            depth += 1
        elif letter in "]}":
            depth -= 1
        elif letter == "," and not depth:
            yield text[start:place]
            start = place + 1
    yield text[start:]
