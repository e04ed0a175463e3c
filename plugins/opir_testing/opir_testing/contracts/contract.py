"""The base class of conformance tests, the error that a failed one raises, and checks that they
share.

The checks are independence of rows, equal events, pickling, and statistical bounds of 99.9 %.
"""

import doctest
import math
import pickle
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from importlib.metadata import distribution
from typing import Any, ClassVar

import numpy as np
from attrs import fields, fields_dict

from opir_core.arrays import FloatArray
from opir_core.errors import ModelError, kind_of
from opir_core.geometry import geodetic_to_ecef
from opir_core.interfaces import has_own
from opir_core.plugin import Component, Host
from opir_core.reading import InvalidNode, Node, class_reader, node_of_data
from opir_core.scene import info_of
from opir_testing.bench import BenchRun, bench_host, bench_run
from opir_testing.execution_monitor import LOOP_STEPS, Use, steps_per_row, use_of
from opir_testing.packages import MOST_MODULES, build_module, foreign_modules, is_mentioned

#: The angle at the Earth's centre from its launch point at which a target may ignite: 3 deg are
#: 330 km, the way of a carrier aircraft.
_AWAY_RAD = math.radians(3.0)

_CORE_RANGE = re.compile(r"opir[-_.]+core\s*\(?\s*[~=!<>]", re.IGNORECASE)


class ConformanceError(AssertionError):
    """A requirement that a component does not meet: `seen` is the observation, `change` the
    remedy.

    `evidence` is what it shows, from which its cause follows: `OUTSIDE_INPUTS`, `REPEAT`, `ROWS`, `EVENTS`
    or `DIFFERENCE`; "" for a value that is wrong by itself.
    """

    def __init__(self, seen: str, change: str, evidence: str = "") -> None:
        self.seen = seen
        self.change = change
        self.evidence = evidence
        super().__init__(f"{seen}\n{change}")


#: What a failed test shows: an input from outside, a repetition with another result, rows that
#: depend on other rows, runs with other events, or any other difference between two results.
OUTSIDE_INPUTS = "outside inputs"
REPEAT = "repeat"
ROWS = "rows"
EVENTS = "events"
DIFFERENCE = "difference"


def require(condition: object, seen: str, change: str, evidence: str = "") -> None:
    """Raise `ConformanceError` with the observation and the remedy unless a condition holds."""
    if not condition:
        raise ConformanceError(seen, change, evidence)


def require_equal(is_equal: object, seen: str, change: str) -> None:
    """Require that two results, which a test has compared, are equal."""
    require(is_equal, seen, change, DIFFERENCE)


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
    def offered(cls) -> Any:
        """Return what the hook yields under the name, which has the component."""
        return cls.component()

    @classmethod
    def afresh(cls) -> Any:
        """Return the tests of the same component, without what these have built and computed."""
        return type(cls.__name__, (cls,), {})()

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

    def exercise(self) -> object:
        """Build the part and use it; `use` calls it with nothing built before."""
        return self.part()

    @classmethod
    @cache
    def use(cls) -> Use:
        """Return what building and using the part reads from outside and leaves behind."""
        return use_of(lambda: cls.afresh().exercise(), cls.component().config)

    def test_build_returns_a_complete_part(self) -> None:
        """`build` returns an object with all that its kind requires."""
        self.part()

    def test_every_setting_is_documented(self) -> None:
        """Every setting has a help text, and the defaults are valid; settings do not change."""
        require_documented(self.component())
        require_constant(self.config())

    def test_every_setting_is_read(self) -> None:
        """Every setting has an effect: `build`, or what it returns, reads it."""
        unread = [
            name
            for name in fields_dict(self.component().config)
            if name not in self.use().settings_read and not is_mentioned(self.component(), name)
        ]
        require(
            not unread,
            f"nothing reads the setting {', '.join(unread)}",
            "Read it from the configuration that build gets, or leave it out.",
        )

    def test_nothing_is_printed_warned_of_or_left_open(self) -> None:
        """Building and using the part prints nothing, warns of nothing, and leaves no file open and
        no thread at work.
        """
        effects = self.use().effects
        require(
            not effects,
            f"it {'; '.join(effects[:3])}",
            "Return results and raise errors instead of printing; close files (with open(...) as"
            " file) and end threads; compute without warnings (np.errstate, np.where).",
        )

    def test_the_package_is_light_and_states_its_range_of_opir_core(self) -> None:
        """The distribution requires a range of opir-core, and its plugin module imports no large
        library.
        """
        owner = self.host().provenance(self.offered().hook, self.offered().name)
        if not owner.distribution or owner.distribution == "opir-core":
            return
        package = distribution(owner.distribution)
        require(
            any(map(_CORE_RANGE.match, package.requires or ())),
            f"{owner.distribution} requires no range of opir-core",
            'Write dependencies = ["opir-core>=0.1,<0.2"], and install it again: pip then rejects'
            " an opir-core that it does not fit.",
        )
        points = package.entry_points.select(group="opir", name=owner.plugin)
        count, largest = foreign_modules(next(iter(points)).module)
        require(
            count <= MOST_MODULES,
            f"importing its plugin module imports {count} modules, most of {largest}",
            f"Import {largest} in build: each command of opir imports plugin modules.",
        )

    def test_examples_are_right(self) -> None:
        """The examples (`>>>`) in the module of `build` give what they say."""
        module = import_module(build_module(self.component()))
        report: list[str] = []
        finder = doctest.DocTestFinder(recurse=True)
        for example in finder.find(module):
            doctest.DocTestRunner(verbose=False).run(example, out=report.append)
        require(not report, " ".join("".join(report).split()), "Correct the example, or the code.")


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


def require_constant(config: Any) -> None:
    """Require that a configuration cannot be changed, and can be pickled."""
    name = next(iter(fields_dict(type(config))), None)
    try:
        if name:
            setattr(config, name, getattr(config, name))
    except AttributeError:
        name = None
    require(
        name is None,
        f"the settings of {type(config).__name__} can be changed",
        "Write @frozen(kw_only=True) before the class: a scene and its runs share the settings.",
    )
    require_pickling(config)


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
    require_rows(what, values, rows, values.ndim)
    choices = {
        "in reverse": everyone[::-1],
        "every third": everyone[::3],
        "the last only": everyone[-1:],
        "none": everyone[:0],
    }
    for selection, rows_chosen in choices.items():
        chosen_values = np.asarray(compute(rows_chosen))
        require_rows(what, chosen_values, len(rows_chosen), values.ndim)
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
                ROWS,
            )


def require_rows(what: str, values: Any, rows: int, axes: int = 1) -> None:
    """Require one value for each row; more than one `axes` for vectors and matrices."""
    require(
        np.ndim(values) == max(axes, 1) and len(values) == rows,
        f"{what} has shape {np.shape(values)} for {rows} rows",
        f"Return an array of {max(axes, 1)} axes with one row for each row of the input, here"
        f" {rows}, and an empty one for none.",
    )


def require_near(
    what: str, position_m: FloatArray, place: Mapping[str, float | None], where: str
) -> None:
    """Require that a position (3,) is above or below a place with `lat_deg` and `lon_deg`, m; a
    place without them is not judged.
    """
    angles_deg = [place.get("lat_deg"), place.get("lon_deg")]
    if None in angles_deg:
        return
    latitude, longitude = np.radians(np.array(angles_deg, dtype=np.float64))[:, None]
    expected_m = geodetic_to_ecef(latitude, longitude, np.zeros(1))[0]
    cosine = np.dot(position_m, expected_m) / (
        np.linalg.norm(position_m) * np.linalg.norm(expected_m)
    )
    away_rad = math.acos(np.clip(cosine, -1.0, 1.0))
    require(
        not away_rad > _AWAY_RAD,
        f"{what} {math.degrees(away_rad):.1f} deg from {where}",
        "Convert degrees to radians; positions are ECEF, which turns with the Earth, in metres.",
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


def require_no_outside_inputs(use: Use, change: str) -> None:
    """Require that neither clock, entropy, environment, network nor global random state is used."""
    inputs = use.inputs
    require(not inputs, f"it uses {'; '.join(inputs[:3])}", change, OUTSIDE_INPUTS)


def require_same_events(
    expected: Sequence[bytes],
    lines: Sequence[bytes],
    where: str,
    change: str,
    evidence: str = EVENTS,
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
        evidence,
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
    is_equal = np.array_equal(results(require_pickling(part)), results(part), equal_nan=True)
    require_equal(
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
