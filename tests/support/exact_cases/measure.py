"""Functions in float64 held to the same in 40 digits (mpmath), with the condition number of every
input drawn.

The relative error of a well-computed result is about the unit roundoff u times one plus its
condition number: the sum, over the inputs, of the relative change of the result for a relative
change of that input. A loss of digits that the input makes is thus distinguished from one that the
formula makes: `scaled` is the error over (1 + condition) u, a few units for a good formula however
ill-conditioned the input.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import mpmath as mp
import numpy as np

#: The unit roundoff of float64.
ROUNDOFF = 2.0**-53
#: The least normal float64: below it results keep absolute, not relative, accuracy.
TINY = 2.2250738585072014e-308
DIGITS = 40
#: Relative step of the differences that give condition numbers.
_STEP = mp.mpf(10) ** -18

#: A value of mpmath, or a list of them.
Exact = Any


class Case(NamedTuple):
    """A function, how its inputs are drawn, and its reference.

    `draw(rng, n)` returns the inputs, columns (n,) or (n, k). `call(*columns)` returns one or
    several outputs, each (n,) or (n, k), whose error is that of the vector. `exact(*row)` returns
    the same of one row in mpmath, None for an output that does not exist (nan). Errors are relative
    to the output's length, or to its `scale` if larger. `angles` are outputs modulo a whole turn.
    `fixed` inputs are exact: they add nothing to the condition number. `condition(*row)`, where
    given, replaces differences. `share` of the draws are enough for a slow reference. With
    `samples` the condition number is estimated from that number of random directions instead of
    each input by itself. `inner(*row)` is the condition number of a step on the way that a user
    chooses with the inputs, and is added.
    """

    name: str
    draw: Callable[[np.random.Generator, int], Sequence[Any]]
    call: Callable[..., Any]
    exact: Callable[..., Any]
    scale: tuple[float, ...] = ()
    angles: tuple[int, ...] = ()
    fixed: tuple[int, ...] = ()
    condition: Callable[..., Any] | None = None
    share: float = 1.0
    digits: int = DIGITS
    samples: int = 0
    inner: Callable[..., float] | None = None


class Bound(NamedTuple):
    """A function with a stated bound of its error, and how it is looked for.

    `search(rng, n)` returns the inputs, columns (n,) or (n, k), the errors (n,) and the bounds
    (n,).
    """

    name: str
    stated: str
    search: Callable[[np.random.Generator, int], tuple[Sequence[Any], np.ndarray, np.ndarray]]
    share: float = 1.0
    digits: int = DIGITS


class Searched(NamedTuple):
    """What was found of a bound: the inputs, the errors (n,) and the errors over the bounds
    (n,).
    """

    case: Bound
    inputs: tuple[Any, ...]
    error: np.ndarray
    ratio: np.ndarray

    @property
    def worst(self):
        """The row of the largest error over its bound."""
        return int(np.argmax(self.ratio))


def searched(case, rng, draws):
    """Return the errors of a function at inputs drawn over their bounds, with floating-point
    warnings as errors.
    """
    with np.errstate(all="raise", under="ignore"), mp.workdps(case.digits):
        inputs, error, bound = case.search(rng, max(4, round(draws * case.share)))
    ratio = np.where(np.isnan(error), np.inf, error / bound)
    return Searched(case, tuple(np.asarray(column) for column in inputs), error, ratio)


def bound_of(
    name,
    stated,
    draw,
    call,
    exact,
    bound,
    **remainder,
):
    """Return the search of a function of one output against its reference, relative to the output's
    length.
    """
    case = Case(name, draw, call, exact, **remainder)

    def search(rng, draws):
        inputs = [np.asarray(column) for column in draw(rng, draws)]
        output = _outputs(call(*inputs))[0]
        error = np.zeros(draws)
        for row, point in enumerate(zip(*inputs, strict=True)):
            group = _groups(exact(*map(exactly, point)))[0]
            values = [float(value) for value in np.ravel(output[row])]
            error[row] = _error(case, 0, group, values, _length(case, 0, group))
        return inputs, error, bound(*inputs)

    return Bound(name, stated, search, case.share, case.digits)


def row_text(inputs, number):
    """Return the inputs of a draw as text that gives the same floats."""
    return ", ".join(_text(column[number]) for column in inputs)


class Outcome(NamedTuple):
    """What was found of a case: columns (n,) of the worst output of each draw, and the draws that
    raised.
    """

    case: Case
    inputs: tuple[Any, ...]
    error: np.ndarray
    condition: np.ndarray
    scaled: np.ndarray
    raised: list[tuple[int, str]]

    @property
    def worst(self):
        """The row of the largest scaled error."""
        return int(np.argmax(self.scaled))


def measured(case, rng, draws):
    """Return the errors of a case at inputs drawn, with every floating-point warning an error."""
    inputs = tuple(
        np.asarray(column) for column in case.draw(rng, max(4, round(draws * case.share)))
    )
    count = len(inputs[0])
    outputs, raised = _called(case, inputs)
    error = np.zeros(count)
    condition = np.zeros(count)
    scaled = np.zeros(count)
    failed = {row for row, _ in raised}
    with mp.workdps(case.digits):
        for row in range(count):
            if row in failed:
                error[row] = np.inf
                condition[row] = error[row]
                scaled[row] = error[row]
                continue
            result = [output[row] for output in outputs]
            error[row], condition[row], scaled[row] = _compared(
                case, [column[row] for column in inputs], result
            )
    return Outcome(case, inputs, error, condition, scaled, raised)


def exactly(value):
    """Return a float, or an array of them, in mpmath; integers, texts and times as they are."""
    if isinstance(value, np.ndarray):
        return [exactly(item) for item in value]
    return mp.mpf(float(value)) if isinstance(value, float | np.floating) else value


def _called(case, inputs):
    """Return the outputs of all rows; where the whole raises, row by row, with nan for rows that
    raise.
    """
    try:
        with np.errstate(all="raise", under="ignore"):
            return _outputs(case.call(*inputs)), []
    except (ArithmeticError, Warning):
        pass
    rows = []
    raised = []
    for row in range(len(inputs[0])):
        try:
            with np.errstate(all="raise", under="ignore"):
                rows.append(
                    [
                        output[0]
                        for output in _outputs(
                            case.call(*(column[row : row + 1] for column in inputs))
                        )
                    ]
                )
        except (ArithmeticError, Warning) as problem:
            raised.append((row, f"{type(problem).__name__}: {problem}"))
            rows.append(None)
    total = next((row_outputs for row_outputs in rows if row_outputs is not None), [np.nan])
    filled = [
        row_outputs
        if row_outputs is not None
        else [np.full_like(output, np.nan) for output in total]
        for row_outputs in rows
    ]
    return [np.array(column) for column in zip(*filled, strict=True)], raised


def _outputs(result):
    return [
        np.asarray(output, dtype=np.float64)
        for output in (result if isinstance(result, tuple) else (result,))
    ]


def _compared(case, inputs, result):
    """Return error, condition number and scaled error of the worst output of one draw."""
    row = [exactly(value) for value in inputs]
    exact = _groups(case.exact(*row))
    if len(exact) != len(result):
        raise AssertionError(
            f"{case.name}: {len(result)} outputs, and {len(exact)} in the reference"
        )
    lengths = [_length(case, number, group) for number, group in enumerate(exact)]
    conditions = None
    worst = 0.0, 0.0, -1.0
    for number, (group, length) in enumerate(zip(exact, lengths, strict=True)):
        values = [float(value) for value in np.ravel(result[number])]
        error = _error(case, number, group, values, length)
        if error == 0.0:
            worst = max(worst, (0.0, 0.0, 0.0), key=lambda outcome: outcome[2])
            continue
        if conditions is None:
            conditions = _conditions(case, row, exact, lengths)
        scaled = error / ((1.0 + conditions[number]) * ROUNDOFF)
        worst = max(worst, (error, conditions[number], scaled), key=lambda outcome: outcome[2])
    return worst


def _error(case, number, group, values, length):
    if group is None:
        return 0.0 if all(np.isnan(values)) else np.inf
    if all(
        abs(value) > 1.8e308 and value * exact_value > 0
        for value, exact_value in zip(values, group, strict=True)
    ):
        return 0.0
    if not np.all(np.isfinite(values)):
        return 0.0 if _is_beyond(group) else np.inf
    return float(_distance(case, number, [mp.mpf(value) for value in values], group) / length)


def _is_beyond(group):
    """Return whether a number is beyond the range of float64."""
    return any(abs(value) > 1.7976931348623157e308 for value in group)


def _conditions(case, row, exact, lengths):
    """Return the condition number of each output."""
    if case.condition is not None:
        return [float(value) for value in case.condition(*row)]
    if case.samples:
        inner = float(case.inner(*row)) if case.inner is not None else 0.0
        return [inner + value for value in _sampled_conditions(case, row, exact, lengths)]
    total = [mp.mpf(0)] * len(exact)
    for number, value in enumerate(row):
        if number in case.fixed:
            continue
        for moved in _moved(value):
            outputs = _groups(case.exact(*row[:number], moved, *row[number + 1 :]))
            for output, (group, reference) in enumerate(zip(outputs, exact, strict=True)):
                if group is not None and reference is not None:
                    total[output] += (
                        _distance(case, output, group, reference) / lengths[output] / _STEP
                    )
    return [float(value) for value in total]


def _sampled_conditions(case, row, exact, lengths):
    """Return estimates of condition numbers: the largest of changes for all inputs moved at once,
    with random signs.

    Source: C. S. Kenney and A. J. Laub, SIAM J. Sci. Comput. 15 (1994) 36 (small-sample condition
    estimation).
    """
    signs = np.random.default_rng(1)
    worst = [0.0] * len(exact)
    for _ in range(case.samples):
        moved = [
            value
            if number in case.fixed or not isinstance(value, mp.mpf)
            else value * (1 + _STEP * int(signs.choice([-1, 1])))
            for number, value in enumerate(row)
        ]
        groups = zip(_groups(case.exact(*moved)), exact, strict=True)
        for output, (group, reference) in enumerate(groups):
            if group is not None and reference is not None:
                change = _distance(case, output, group, reference) / lengths[output]
                worst[output] = max(worst[output], float(change / _STEP))
    return worst


def _moved(value):
    """Return an input with each of its numbers a little larger, one at a time."""
    if isinstance(value, list):
        return [
            [*value[:place], moved, *value[place + 1 :]]
            for place, number in enumerate(value)
            for moved in _moved(number)
        ]
    return (
        [value * (1 + _STEP)]
        if isinstance(value, mp.mpf) and value != 0 and mp.isfinite(value)
        else []
    )


def _groups(result):
    """Return the outputs of a reference as lists of numbers."""
    outputs = result if isinstance(result, tuple) else (result,)
    return [
        output if output is None or isinstance(output, list) else [output] for output in outputs
    ]


def _length(case, number, group):
    floor = case.scale[number] if number < len(case.scale) else TINY
    return mp.mpf(1) if group is None else max(norm(group), mp.mpf(max(floor, TINY)))


def _distance(case, number, one, other):
    separation = [a - b for a, b in zip(one, other, strict=True)]
    if number in case.angles:
        turn = 2 * mp.pi
        separation = [min(abs(angle), abs(turn - abs(angle))) for angle in separation]
    return norm(separation)


def norm(vector):
    """Return the length of a vector."""
    return (
        abs(vector[0]) if len(vector) == 1 else mp.sqrt(mp.fsum(value * value for value in vector))
    )


def dot(one, other):
    """Return a scalar product."""
    return mp.fsum(a * b for a, b in zip(one, other, strict=True))


def cross(one, other):
    """Return a vector product."""
    (a, b, c), (d, e, f) = one, other
    return [b * f - c * e, c * d - a * f, a * e - b * d]


def less(left_side, right_side):
    """Return a difference of vectors."""
    return [a - b for a, b in zip(left_side, right_side, strict=True)]


def plus(vector, increment, times=1):
    """Return a vector plus a multiple of another."""
    return [a + times * b for a, b in zip(vector, increment, strict=True)]


def times(factor, vector):
    """Return a multiple of a vector."""
    return [factor * value for value in vector]


def _text(value):
    if isinstance(value, np.ndarray) and value.ndim:
        return f"[{', '.join(map(_text, value))}]"
    return repr(float(value)) if isinstance(value, float | np.floating | np.ndarray) else str(value)
