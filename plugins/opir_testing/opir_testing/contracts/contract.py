"""The base class of conformance tests, the error that a failed one raises, and checks that they
share.

The checks are independence of rows, equal events, pickling, and statistical bounds of 99.9 %.
"""

import math
import pickle
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, ClassVar

import numpy as np
from attrs import fields

from opir_core.arrays import FloatArray
from opir_core.errors import ModelError, kind_of
from opir_core.interfaces import has_own
from opir_core.plugin import Component, Host
from opir_core.reading import InvalidNode, Node, class_reader, node_of_data
from opir_core.scene import info_of
from opir_testing.bench import BenchRun, bench_host, bench_run
from opir_testing.execution_monitor import LOOP_STEPS, outside_inputs, steps_per_row


class ConformanceError(AssertionError):
    """A requirement that a component does not meet: `seen` is the observation, `change` the
    remedy.
    """

    def __init__(self, seen: str, change: str) -> None:
        self.seen = seen
        self.change = change
        super().__init__(f"{seen}\n{change}")


def require(condition: object, seen: str, change: str) -> None:
    """Raise `ConformanceError` with the observation and the remedy unless a condition holds."""
    if not condition:
        raise ConformanceError(seen, change)


class Contract:
    """The conformance tests of a kind of component.

    Inherit the class of your kind in a test file and set the component's `name`:

        class TestMySensor(SensorContract):
            name = "my-sensor"
            settings = {"scan_period_ms": 50.0}

    `settings` is its block in a scene. `plugins` are the modules of plugins that are not installed.
    `expected_failures` maps tests that it fails to reasons; such a test must fail. The docstring of
    a test is the requirement; a component that does not meet it raises `ConformanceError`. `opir
    check` runs the same methods without pytest.
    """

    kind: ClassVar[type[Component]]
    name: ClassVar[str] = ""
    settings: ClassVar[Mapping[str, Any]] = {}
    plugins: ClassVar[Sequence[str]] = ()
    expected_failures: ClassVar[Mapping[str, str]] = {}

    @classmethod
    @cache
    def host(cls) -> Host:
        """Return the plugin host with the component."""
        return bench_host(cls.plugins)

    @classmethod
    def component(cls) -> Any:
        """Return the component."""
        return cls.host().component(cls.kind, cls.name)

    @classmethod
    def config(cls, **settings: Any) -> Any:
        """Return the component's configuration as read from a scene, with additional settings."""
        return read_config(cls.component(), {**cls.block(), **settings})

    @classmethod
    def block(cls) -> Mapping[str, Any]:
        """Return the settings that the component is tested with."""
        return cls.settings

    @classmethod
    def built(cls, base: type, config: Any, *context: Any) -> Any:
        """Return what the component builds, as a part of a class; raises `ConformanceError` if a
        member is missing.
        """
        return complete_part(base, cls.component().build(config, *context))

    @classmethod
    def part(cls) -> Any:
        """Return what the component builds."""
        raise undefined(cls, "part()", "what the component builds")

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the test scene with the component; `changes` replace keys."""
        raise undefined(cls, "scene(**changes)", "the test scene with the component, as a dict")

    @classmethod
    @cache
    def run(cls) -> BenchRun:
        """Return the run of the scene, computed once."""
        return cls.run_of(cls.scene())

    @classmethod
    def run_of(cls, scene: Mapping[str, Any], **options: Any) -> BenchRun:
        """Return the run of a scene."""
        return bench_run(scene, cls.host(), **options)

    def test_build_returns_a_complete_part(self) -> None:
        """`build` returns an object with all that its kind requires."""
        self.part()


def undefined(contract: type[Contract], method: str, returned: str) -> ConformanceError:
    """Return the error of a contract that lacks a method: which class must define what, returning
    what.
    """
    return ConformanceError(
        f"{contract.__name__} must define {method}, which returns {returned}.",
        "The contract of each kind of component defines it: inherit that of your kind from"
        " opir_testing.",
    )


def complete_part(base: Any, part: Any) -> Any:
    """Return a built part as one of a class; raises `ConformanceError` if it is None or lacks a
    member.
    """
    change = f"Return it from build; opir_core.plugin.{base.__name__} says what is required."
    require(part is not None, "build returned None", change)
    if hasattr(base, "adopt"):
        try:
            return base.adopt(part)
        except ModelError as error:
            raise ConformanceError(str(error).partition(";")[0], change) from error
    members = [name for name in vars(base) if not name.startswith("_")] if is_protocol(base) else []
    missing = [name for name in members if not hasattr(part, name)]
    require(not missing, f"build made {kind_of(part)} without {', '.join(missing)}", change)
    require(
        members or isinstance(part, base), f"build made {kind_of(part)}, no {base.__name__}", change
    )
    return part


def is_protocol(base: type) -> bool:
    """Return whether a class is a protocol, whose parts need not derive from it."""
    return bool(getattr(base, "_is_protocol", False))


def read_config(component: Any, settings: Mapping[str, Any]) -> Any:
    """Return a component's configuration, read as from a scene; raises `ConformanceError` if
    invalid.
    """
    try:
        preset = component.presets.get(settings.get("preset"), {})
        written = {key: value for key, value in settings.items() if key != "preset"}
        node: Node = node_of_data({**preset, **written})
        return class_reader(component.config)(node)
    except InvalidNode as refused:
        problems = "; ".join(
            f"{complaint.path.lstrip('.')}: {complaint.message}".removeprefix(": ")
            for complaint in refused.complaints
        )
        raise ConformanceError(
            f"{component.kind} {component.name} rejects its settings: {problems}",
            "Give the contract settings = {...} (opir check: --set key=value), or the fields valid"
            " defaults.",
        ) from refused


def require_documented(component: Any) -> None:
    """Require a help text for each setting of a component."""
    config = component.config
    bare = [attribute.name for attribute in fields(config) if not info_of(attribute).help]
    require(
        not bare,
        f"{config.__name__} has fields without help: {', '.join(bare)}",
        "Make each field with number, text, flag or nested of opir_core.plugin, with help=, unit="
        " and a range.",
    )


def test_names(contract: type[Contract]) -> list[str]:
    """Return the names of a contract's tests, those of its parents first."""
    names: dict[str, None] = {}
    for parent in reversed(contract.__mro__):
        names |= dict.fromkeys(name for name in vars(parent) if name.startswith("test_"))
    return list(names)


def requirement(contract: type[Contract], test: str) -> str:
    """Return the requirement that a test checks, in one line."""
    paragraph = (getattr(contract, test).__doc__ or test).strip().partition("\n\n")[0]
    return " ".join(paragraph.split())


# pytest collects functions by this prefix, also where they are imported.
test_names.__test__ = False  # type: ignore[attr-defined]


Compute = Callable[[Any], Any]

#: The standard normal's 99.95 % point: the probability beyond it, both sides together, is 0.1 %.
Z_999 = 3.2905267314919255


def require_independent_rows(what: str, compute: Compute, rows: int) -> None:
    """Require that `compute(chosen)` returns for each row the same bits as `compute` of all
    rows.
    """
    everyone = np.arange(rows)
    values = np.asarray(compute(everyone))
    require_rows(what, values, rows)
    choices = {
        "in reverse": everyone[::-1],
        "every third": everyone[::3],
        "the last only": everyone[-1:],
        "none": everyone[:0],
    }
    for selection, rows_chosen in choices.items():
        chosen_values = np.asarray(compute(rows_chosen))
        require_rows(what, chosen_values, len(rows_chosen))
        expected = values[rows_chosen]
        is_equal = (chosen_values == expected) | (
            (chosen_values != chosen_values) & (expected != expected)
        )
        differs = ~is_equal.all(axis=tuple(range(1, is_equal.ndim)))
        if differs.any():
            row = int(np.flatnonzero(differs)[0])
            raise ConformanceError(
                f"{what} of row {int(rows_chosen[row])} is {values[rows_chosen][row]} among all"
                f" rows and {chosen_values[row]} in a selection ({selection})",
                "Compute each row from its own columns: no sums, means, sorting or running state"
                " over rows. Draw random numbers for all rows of the call.",
            )


def require_rows(what: str, values: Any, rows: int) -> None:
    """Require one value for each row."""
    require(
        np.ndim(values) >= 1 and len(values) == rows,
        f"{what} has shape {np.shape(values)} for {rows} rows",
        f"Return an array with one row for each row of the input, here ({rows}, ...), and an empty"
        f" one for none.",
    )


def require_array_computation(
    what: str, compute: Callable[[int], object], few: int, many: int
) -> None:
    """Require that `compute(rows)` takes about as many steps of Python for many rows as for few."""
    steps = steps_per_row(compute, few, many)
    require(
        steps < LOOP_STEPS,
        f"each additional {what} takes {steps:.1f} steps of Python",
        f"Replace the loop over each {what} by arithmetic on whole columns.",
    )


def require_no_outside_inputs(act: Callable[[], object], change: str) -> None:
    """Require that a function uses neither clock, entropy, network nor global random state."""
    inputs = outside_inputs(act)
    require(not inputs, f"it uses {'; '.join(inputs[:3])}", change)


def require_same_events(
    expected: Sequence[bytes], lines: Sequence[bytes], where: str, change: str
) -> None:
    """Require that two runs have the same events, line by line."""
    if list(expected) == list(lines):
        return
    pairs = zip(expected, lines, strict=False)
    row = next(
        (row for row, (event, line) in enumerate(pairs) if event != line),
        min(len(expected), len(lines)),
    )
    differing = " and ".join(
        (events[row].decode(errors="replace")[:300] if row < len(events) else "nothing")
        for events in (expected, lines)
    )
    raise ConformanceError(
        f"{where} there are {len(lines)} events instead of {len(expected)}, or different ones:"
        f" {differing}",
        change,
    )


def require_complete_abilities(base: type, part: Any, abilities: Sequence[Sequence[str]]) -> None:
    """Require that a built part defines all members of an optional ability of its base class, or
    none of them.
    """
    for members in abilities:
        missing = [name for name in members if not has_own(base, part, name)]
        if missing and len(missing) < len(members):
            raise ConformanceError(
                f"it defines {', '.join(name for name in members if name not in missing)} and not"
                f" {', '.join(missing)}",
                f"Define all of {', '.join(members)} of opir_core.plugin.{base.__name__}, or none"
                f" of them.",
            )


def require_pickling(part: Any) -> Any:
    """Return a pickled copy of a built part; raises `ConformanceError` if it cannot be pickled."""
    try:
        return pickle.loads(pickle.dumps(part))
    except Exception as error:
        raise ConformanceError(
            f"{type(part).__name__} cannot be pickled: {error}",
            "Keep no open files, locks, lambdas or local functions in the object that build"
            " returns. Define classes and functions at module level.",
        ) from error


def require_same_copy(part: Any, results: Callable[[Any], Any]) -> None:
    """Require that a built part can be pickled, and that its copy returns the same arrays."""
    is_equal = np.array_equal(results(require_pickling(part)), results(part))
    require(
        is_equal, "a pickled copy returns other values", "Keep all state in fields that pickle."
    )


def count_excess(count: float, chances: FloatArray) -> float:
    """Return the distance of a count from its expectation, in half widths of its 99.9 % interval;
    inside up to 1.

    `chances` (n,) are those of independent trials. The half width is that of the normal with the
    count's variance (Poisson binomial); half a count is the continuity correction.
    """
    spread = math.sqrt(float(np.sum(chances * (1.0 - chances))))
    return max(abs(count - float(np.sum(chances))) - 0.5, 0.0) / max(Z_999 * spread, 1e-9)


def rate_excess(count: float, expected: float) -> float:
    """Return the distance of a Poisson count from its mean, in half widths of its 99.9 % interval
    (normal).
    """
    return max(abs(count - expected) - 0.5, 0.0) / max(Z_999 * math.sqrt(expected), 1e-9)


def uniformity_excess(values: FloatArray) -> float:
    """Return the Kolmogorov-Smirnov distance of values (n,) from uniform on [0, 1], in units of its
    99.9 % point.

    Stephens' form of the point for finite n (J. R. Stat. Soc. B 32, 1970): D (sqrt n + 0.12 + 0.11
    / sqrt n) <= 1.950.
    """
    count = len(values)
    if count == 0:
        return 0.0
    ordered = np.sort(values)
    steps = np.arange(count + 1) / count
    distance = float(max(np.max(steps[1:] - ordered), np.max(ordered - steps[:-1])))
    return distance * (math.sqrt(count) + 0.12 + 0.11 / math.sqrt(count)) / 1.950
