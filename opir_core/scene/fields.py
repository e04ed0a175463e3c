"""Fields of configuration classes, with unit, range, meaning and source of the default.

The attributes of a configuration class, a frozen attrs class, are made here. The scene reader, the
error messages and the generated reference read the same `FieldInfo`.
"""

import math
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any, TypeVar

from attrs import NOTHING, Attribute, Converter, Factory, evolve, field, fields, fields_dict, frozen

#: The key of a field's `FieldInfo` in attrs metadata.
METADATA_KEY = "opir"


#: Plausible magnitudes of numbers by unit, for fields that give no range of their own.
PLAUSIBLE_BY_UNIT: Mapping[str, tuple[float, float]] = {
    "um": (0.3, 30.0),
    "urad": (0.1, 10_000.0),
    "urad/s": (1e-4, 10_000.0),
    "ms": (1.0, 3_600_000.0),
    "K": (100.0, 12_000.0),
    "W/m²": (1e-18, 1e-3),
    "W/cm²": (1e-22, 1e-7),
    "W/sr": (1.0, 1e9),
    "m² s": (1e-9, 100.0),
    "m2": (1e-3, 1e10),
    "m/s": (0.01, 72_000.0),
    "1/sr": (1e-3, 1e7),
    "1/day": (1e-4, 1e5),
    "e⁻": (0.1, 1e12),
    "e⁻/s": (1e-2, 1e13),
    "kg/m²": (10.0, 1e7),
}


#: The smallest value with a meaning, by unit, of settings that must be above 0: a nanosecond, in
#: which times are counted; a nanoradian; a millimetre, some thirty of the longest wavelengths; one
#: electron; 1 K; of rates one event in a million years; of others what single precision tells from
#: 0 beside the plausible. A setting without a unit is a share or a ratio.
LEAST_BY_UNIT: Mapping[str, float] = {
    "": 1e-30,
    "1": 1e-30,
    "s": 1e-9,
    "ms": 1e-6,
    "urad": 1e-3,
    "deg": 1e-7,
    "deg/s": 1e-7,
    "m": 1e-3,
    "km": 1e-6,
    "m2": 1e-6,
    "km2": 1e-12,
    "m² s": 1e-15,
    "m/s": 1e-6,
    "m/s2": 1e-6,
    "m/s²": 1e-6,
    "m/s²/√s": 1e-6,
    "K": 1.0,
    "J": 1e-6,
    "e⁻": 1.0,
    "1/s": 1e-12,
    "1/min": 1e-9,
    "1/day": 1e-9,
    "1/sr": 1e-9,
    "kg/m³": 1e-30,
}


#: Subjects: what settings describe that only some components read. A component `reads` subjects; a
#: field of a `subject` has an effect only in scenes with a component that reads it.
LIGHT = "light"
SOURCES = "sources"
BANDS = "bands"
BODIES = "bodies"
BIAS = "bias"
DRAG = "drag"
DETECTION_PROBABILITY = "detection_probability"
CONFUSION = "confusion"
STRUCTURE = "structure"
RESIDUAL = "residual"
SKY = "sky"
CLOUD = "cloud"
ANY_CLOUD = "any cloud"
#: The subject of settings that no model reads: they are printed only.
DESCRIPTION = "description"

#: What reads each subject, in words.
READ_BY: Mapping[str, str] = {
    LIGHT: "a detection model that reads light does; constant reads detection_probability alone",
    SOURCES: "the detection model has none for sources",
    BANDS: "sensors do",
    BODIES: "sensors with follows_bodies: true do, and all do where a target glides",
    BIAS: "a tracker does, of sensors with a bias or with clocks that are off",
    DRAG: "it is read with drag among the scene's forces",
    DETECTION_PROBABILITY: "detection: constant does",
    CONFUSION: "classification: paper does",
    STRUCTURE: "sensors with a focal plane do",
    RESIDUAL: "sensors without a focal plane (focal_plane: null) do",
    SKY: "it is hidden below the atmosphere's opaque cloud",
    CLOUD: "it is read with an opaque cloud of the atmosphere",
    ANY_CLOUD: "it is read with a cloudy sky, or with a cloud of the atmosphere",
    DESCRIPTION: "it is a description, which no model reads",
}

#: A condition on the other settings of a block under which a setting is read: in words, and as a
#: test of the block.
ReadIf = tuple[str, Callable[[Any], bool]]


@frozen
class FieldInfo:
    """The description of a configuration field: meaning, unit, source of the default, allowed
    values.

    A field that may be none can be an alternative to an earlier one, for example in another unit:
    it is `instead_of` that field, and replaces it unless it is none. A scene's block, or Python,
    sets one of the two, not both; that takes precedence over presets, constellations and classes.

    `names_of` is a catalogue hook: the field's text, or the keys of its mapping, are names of
    components of that hook. With `names_depth` 1 they are the keys of the mappings in the mapping.
    With `inner_names` the keys one mapping deeper are such names too, or one of these. The scene
    reader checks them.

    `named_values` are the whole values of a nested field that texts stand for. `plausible` is the
    range of values that real equipment and studies have; without one `plausible_range` follows from
    the unit.

    The keys of a mapping with `keys_of` are those of this other field.

    A field with a `role` holds a tracker part of this role: its name, or a block of `model` and
    settings, which the scene reader replaces by a `Choice`; a motion model has `state_size` states.

    A field with a `subject` is read only by components that read this subject, one with `read_if`
    only under this condition. A scene that sets a field which nothing reads is warned of it.
    """

    help: str
    unit: str = ""
    source: str = "notional"
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None
    below: float | None = None
    choices: tuple[str, ...] = ()
    instead_of: str = ""
    names_of: str = ""
    names_depth: int = 0
    inner_names: tuple[str, ...] = ()
    named_values: Mapping[str, Any] = Factory(dict)
    plausible: tuple[float, float] | None = None
    keys_of: str = ""
    subject: str = ""
    read_if: ReadIf | None = None
    role: str = ""
    state_size: int | None = None

    @property
    def plausible_range(self) -> tuple[float, float] | None:
        """Return the plausible range of magnitudes; None if every allowed value is plausible. 0
        always is.
        """
        interval = self.plausible or PLAUSIBLE_BY_UNIT.get(self.unit)
        if interval is None:
            return None
        low = _bound(self.minimum, self.above)
        high = _bound(self.maximum, self.below)
        is_narrower = (
            low is not None and high is not None and low >= interval[0] and high <= interval[1]
        )
        return (
            None
            if is_narrower
            else (interval[0], interval[1] if high is None else min(high, interval[1]))
        )

    @property
    def plausible_text(self) -> str:
        """Return `plausible 1 to 3600000`, or "" if every allowed value is plausible."""
        inside = self.plausible_range
        return "" if inside is None else f"plausible {_figure(inside[0])} to {_figure(inside[1])}"

    def implausible(self, value: float) -> bool:
        """Return whether an allowed number is outside the plausible range."""
        inside = self.plausible_range
        return inside is not None and value != 0 and not inside[0] <= abs(value) <= inside[1]

    @property
    def interval(self) -> str:
        """Return the allowed interval, `[0, 1]` or `(0, inf)`; "" for any number."""
        low = _bound(self.minimum, self.above)
        high = _bound(self.maximum, self.below)
        if low is None and high is None:
            return ""
        opening = "[" if self.minimum is not None else "("
        closing = "]" if self.maximum is not None else ")"
        return (
            f"{opening}{'-inf' if low is None else _figure(low)},"
            f" {'inf' if high is None else _figure(high)}{closing}"
        )

    @property
    def requirement(self) -> str:
        """Return meaning, unit and allowed values in one line; "" without any."""
        details = (self.help, self.unit, self.interval, " or ".join(self.choices))
        return ", ".join(detail for detail in details if detail)

    def accepts(self, value: float) -> bool:
        """Return whether a number lies in the interval; NaN never does."""
        return (
            _is_finite(value)
            and (self.minimum is None or value >= self.minimum)
            and (self.maximum is None or value <= self.maximum)
            and (self.above is None or value > self.above)
            and (self.below is None or value < self.below)
        )


def number(
    *,
    help: str,  # noqa: A002 - the word attrs, argparse and click users expect
    default: Any = NOTHING,
    unit: str = "",
    source: str = "notional",
    minimum: float | None = None,
    maximum: float | None = None,
    above: float | None = None,
    below: float | None = None,
    instead_of: str = "",
    plausible: tuple[float, float] | None = None,
    subject: str = "",
    read_if: ReadIf | None = None,
) -> Any:
    """Return an attrs field for a finite number (annotate it `float`, `int`, or either `| None`).

    Values outside `plausible`, by default a range that follows from the unit, are allowed and
    warned of. `above` 0 is at least the smallest value with a meaning in that unit
    (`LEAST_BY_UNIT`). `subject` and `read_if` are as in `FieldInfo`.
    """
    if above == 0.0 and unit in LEAST_BY_UNIT:
        minimum, above = LEAST_BY_UNIT[unit], None
    info = FieldInfo(
        help,
        unit,
        source,
        minimum,
        maximum,
        above,
        below,
        instead_of=instead_of,
        plausible=plausible,
        subject=subject,
        read_if=read_if,
    )
    once = Converter(_set_once, takes_self=True, takes_field=True) if instead_of else None
    return field(
        default=default,
        converter=once,
        validator=_validate_number,
        metadata={METADATA_KEY: info},
        kw_only=True,
    )


def text(
    *,
    help: str,  # noqa: A002
    default: Any = NOTHING,
    choices: tuple[str, ...] = (),
    names_of: str = "",
    source: str = "notional",
    subject: str = "",
    read_if: ReadIf | None = None,
) -> Any:
    """Return an attrs field for a string, one of `choices` or a name of a component of the hook
    `names_of` if given.
    """
    info = FieldInfo(
        help, source=source, choices=choices, names_of=names_of, subject=subject, read_if=read_if
    )
    return field(
        default=default, validator=_validate_text, metadata={METADATA_KEY: info}, kw_only=True
    )


def flag(
    *,
    help: str,  # noqa: A002
    default: Any = NOTHING,
    source: str = "notional",
    subject: str = "",
    read_if: ReadIf | None = None,
) -> Any:
    """Return an attrs field for a truth value (annotate it `bool`)."""
    info = FieldInfo(help, source=source, subject=subject, read_if=read_if)
    return field(default=default, metadata={METADATA_KEY: info}, kw_only=True)


def part(
    *,
    help: str,  # noqa: A002
    role: str,
    default: str,
    state_size: int | None = None,
    source: str = "notional",
) -> Any:
    """Return an attrs field (annotate it `Any`) for a tracker part of a role, by default the one
    named; a motion model has `state_size` states.
    """
    info = FieldInfo(help, source=source, role=role, state_size=state_size)
    return field(default=default, metadata={METADATA_KEY: info}, kw_only=True)


def nested(
    *,
    help: str,  # noqa: A002
    default: Any = NOTHING,
    unit: str = "",
    source: str = "notional",
    minimum: float | None = None,
    maximum: float | None = None,
    check: Callable[[Any], str | None] | None = None,
    names_of: str = "",
    names_depth: int = 0,
    inner_names: tuple[str, ...] = (),
    named_values: Mapping[str, Any] | None = None,
    keys_of: str = "",
    subject: str = "",
    read_if: ReadIf | None = None,
) -> Any:
    """Return an attrs field for another configuration class, a tuple or a mapping.

    `minimum` and `maximum` bound every number in a tuple or a mapping; `check` returns the error of
    the whole value, or None; the others are as in `FieldInfo`. `named_values` are texts that a
    scene, or Python, may give instead of a whole value.
    """
    info = FieldInfo(
        help,
        unit,
        source,
        minimum,
        maximum,
        names_of=names_of,
        names_depth=names_depth,
        inner_names=inner_names,
        named_values=named_values or {},
        keys_of=keys_of,
        subject=subject,
        read_if=read_if,
    )
    by_name = Converter(_named_value, takes_field=True) if named_values else None
    validators = [_validate_numbers_inside, *([_from_check(check)] if check else [])]
    return field(
        default=default,
        converter=by_name,
        validator=validators,
        metadata={METADATA_KEY: info},
        kw_only=True,
    )


def info_of(attribute: "Attribute[Any]") -> FieldInfo:
    """Return the description of a configuration attribute; a bare attrs field has an empty help
    text.
    """
    info = attribute.metadata.get(METADATA_KEY)
    return info if isinstance(info, FieldInfo) else FieldInfo("", source="")


def field_infos(config_class: type) -> dict[str, FieldInfo]:
    """Return the fields of a configuration class, in order, by name."""
    return {attribute.name: info_of(attribute) for attribute in fields(config_class)}


@frozen
class Alternatives:
    """The names of two settings of one quantity; `other` replaces `plain` unless it is none."""

    plain: str
    other: str
    #: Whether the class's default is that of `other`.
    is_other_default: bool


@cache
def alternatives(config_class: type) -> tuple[Alternatives, ...]:
    """Return the pairs of settings of one quantity in a configuration class."""
    return tuple(
        Alternatives(
            info_of(attribute).instead_of, attribute.name, attribute.default not in (None, NOTHING)
        )
        for attribute in fields(config_class)
        if info_of(attribute).instead_of
    )


def error_of_both(plain: str) -> str:
    """Return the error of a setting that is given beside `plain`, which sets the same quantity."""
    return f"sets the same quantity as {plain}, which is also set; omit one of the two"


def _set_once(value: Any, config: Any, attribute: "Attribute[Any]") -> Any:
    """Return the value of an alternative field; None if only the class sets it and Python sets the
    plain field.

    A field that is not set holds the default object itself; a number that is set is a different
    object, even if equal.
    """
    plain = fields_dict(type(config))[info_of(attribute).instead_of]
    if value is None or getattr(config, plain.name) is plain.default:
        return value
    if value is attribute.default:
        return None
    raise ValueError(
        f"{attribute.name} {error_of_both(plain.name)}, or set {attribute.name} to None"
    )


def _named_value(value: Any, attribute: "Attribute[Any]") -> Any:
    """Return the value that a text stands for; any other value itself."""
    return named_value(info_of(attribute), value) if isinstance(value, str) else value


def named_value(info: FieldInfo, name: str) -> Any:
    """Return the value of a field that a text stands for, or raise `ValueError`."""
    if name not in info.named_values:
        raise ValueError(
            f"{name!r} is not {' or '.join(info.named_values)}; or give a block of settings"
        )
    return info.named_values[name]


def _bound(closed: float | None, opened: float | None) -> float | None:
    return closed if closed is not None else opened


def _validate_number(_instance: Any, attribute: "Attribute[Any]", value: Any) -> None:
    info = info_of(attribute)
    if value is None:
        return
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{value!r} is not a number")
    _require_inside(info, value)


def _validate_text(_instance: Any, attribute: "Attribute[Any]", value: Any) -> None:
    info = info_of(attribute)
    if value is not None and not isinstance(value, str):
        raise ValueError(f"{value!r} is not text")
    if value is not None and info.choices and value not in info.choices:
        raise ValueError(f"{value!r} is not one of {', '.join(info.choices)}")


def _validate_numbers_inside(_instance: Any, attribute: "Attribute[Any]", value: Any) -> None:
    info = info_of(attribute)
    for leaf in numbers_inside(value):
        _require_inside(info, leaf)


def numbers_inside(value: Any) -> list[float]:
    """Return the numbers in a value, in the lists and mappings in it included."""
    if isinstance(value, bool):
        return []
    if isinstance(value, int | float):
        return [value]
    children = (
        value.values()
        if isinstance(value, Mapping)
        else value
        if isinstance(value, tuple | list)
        else ()
    )
    return [leaf for child in children for leaf in numbers_inside(child)]


def _require_inside(info: FieldInfo, value: float) -> None:
    if not _is_finite(value):
        raise ValueError(f"{value!r} is not a finite number")
    if not info.accepts(value):
        unit = "" if info.unit in {"", "1"} else f" {info.unit}"
        raise ValueError(f"{value!r} is outside {info.interval}{unit}")


def _is_finite(value: float) -> bool:
    """Return whether a number is finite; whole numbers are, even those too large for a float."""
    return isinstance(value, int) or math.isfinite(value)


def _figure(value: float) -> str:
    """Return a bound as text."""
    return (
        str(int(value)) if float(value).is_integer() and abs(value) < _PLAIN_BELOW else f"{value:g}"
    )


#: Whole bounds below this are written out.
_PLAIN_BELOW = 1e19


def _from_check(check: Callable[[Any], str | None]) -> Callable[[Any, Any, Any], None]:
    def validate(_instance: Any, _attribute: Any, value: Any) -> None:
        complaint = check(value)
        if complaint:
            raise ValueError(complaint)

    return validate


C = TypeVar("C", bound=type)


@frozen
class Cited:
    """A default value and where it comes from."""

    value: Any
    source: str


@frozen
class Named:
    """Texts that stand for whole values of a nested field; the first is its default."""

    values: Mapping[str, Any]


def cited(value: Any, source: str) -> Cited:
    """Return a default that names its source; a default given bare is notional."""
    return Cited(value, source)


def named(**values: Any) -> Named:
    """Return the values that texts stand for in a model's nested field, the first its default, for
    `with_defaults`.
    """
    return Named(values)


def with_defaults(**defaults: Any) -> Callable[[C], C]:
    """Return a class decorator that makes a frozen attrs class of a configuration class's heir,
    with other defaults.

    Unit, help and range stay those of the inherited field, its source becomes that of `cited` or
    "notional". A field that the class does not have is a `TypeError`.
    """

    def decorated(heir: C) -> C:
        return frozen(heir, kw_only=True, field_transformer=partial(_redefaulted, defaults))

    return decorated


def _redefaulted(
    defaults: dict[str, Any], heir: type, attributes: "list[Attribute[Any]]"
) -> "list[Attribute[Any]]":
    unknown = sorted(set(defaults) - {attribute.name for attribute in attributes})
    if unknown:
        raise TypeError(f"{heir.__name__} has no field {', '.join(unknown)}")
    return [
        _with_default(attribute, defaults[attribute.name])
        if attribute.name in defaults
        else attribute
        for attribute in attributes
    ]


def _with_default(attribute: "Attribute[Any]", default: Any) -> "Attribute[Any]":
    if isinstance(default, Named):
        info = evolve(info_of(attribute), named_values=default.values)
        default_value = next(iter(default.values.values()))
        return attribute.evolve(
            default=default_value, metadata={**attribute.metadata, METADATA_KEY: info}
        )
    cited = default if isinstance(default, Cited) else Cited(default, "notional")
    info = evolve(info_of(attribute), source=cited.source)
    # Attribute.evolve is attrs' own way to change an attribute in a field transformer.
    return attribute.evolve(
        default=cited.value, metadata={**attribute.metadata, METADATA_KEY: info}
    )
