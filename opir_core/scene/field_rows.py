"""The fields of a configuration class as rows of plain values: for `opir describe`, messages and
references.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, get_args, get_origin, get_type_hints

from attrs import NOTHING, Attribute, asdict, fields, frozen, has

from opir_core.scene.fields import METADATA_KEY, info_of

#: A default that is there, though not a value: the scene has to give one.
REQUIRED = "required"


@frozen(kw_only=True)
class FieldRow:
    """One field that a scene may set; `key` is dotted where it lies in a nested block.

    `default` is a plain value, None also where `is_required`. `interval` and `choices` say what is
    allowed.
    """

    key: str
    kind: str
    is_required: bool
    default: Any
    unit: str
    interval: str
    choices: tuple[str, ...]
    help: str
    source: str
    plausible: str = ""

    @property
    def default_text(self) -> str:
        """Return the default as a scene would have it; "required" where there is none."""
        return REQUIRED if self.is_required else shown(self.default)

    @property
    def bounds(self) -> str:
        """Return unit, interval, plausible range and choices in one line."""
        allowed = " ".join(
            bound for bound in (self.unit, self.interval, ", ".join(self.choices)) if bound
        )
        return ", ".join(bound for bound in (allowed, self.plausible) if bound)


def field_rows(config: type, prefix: str = "", base: Any = None) -> Iterator[FieldRow]:
    """Yield a row for each field of a configuration class, nested ones below their parent.

    What a scene leaves out of a nested block is as in the block's own default, `base`.
    """
    hints = get_type_hints(config)
    for attribute in [attribute for attribute in fields(config) if attribute.init]:
        kind = hints[attribute.name]
        default = _default(attribute, base)
        info = info_of(attribute)
        is_required = default is NOTHING
        yield FieldRow(
            key=f"{prefix}{attribute.name}",
            kind=f"{info.role} part" if info.role else _kind_text(kind),
            is_required=is_required,
            default=None if is_required else plain(default),
            unit=info.unit,
            interval=info.interval,
            choices=info.choices or tuple(info.named_values),
            help=info.help,
            source=info.source,
            plausible=info.plausible_text,
        )
        inner = nested_config(kind)
        if inner is not None:
            yield from field_rows(
                inner, f"{prefix}{attribute.name}.", default if isinstance(default, inner) else None
            )


def named_values(config: type) -> Mapping[str, Any]:
    """Return the values that texts stand for, plain, by `field: text` as a scene has it."""
    return {
        f"{attribute.name}: {name}": plain(value)
        for attribute in fields(config)
        for name, value in info_of(attribute).named_values.items()
    }


def plain(value: Any) -> Any:
    """Return a value as JSON has it."""
    if has(type(value)):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(item) for item in value]
    return value


def shown(value: Any) -> str:
    """Return a value as YAML people would write it."""
    if value is None or isinstance(value, bool):
        return {None: "none", True: "true", False: "false"}[value]
    if has(type(value)):
        return shown(asdict(value))
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {shown(item)}" for key, item in value.items()) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(shown(item) for item in value) + "]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _default(attribute: "Attribute[Any]", base: Any) -> Any:
    """Return the default value of a field, `NOTHING` if the field is required."""
    if base is not None:
        return getattr(base, attribute.name)
    default: Any = attribute.default
    return default.factory() if hasattr(default, "takes_self") else default


def nested_config(kind: Any) -> type | None:
    """Return the configuration class that a field holds, if it holds one."""
    members = get_args(kind) or (kind,)
    return next(
        (member for member in members if isinstance(member, type) and _is_config(member)), None
    )


def _is_config(kind: type) -> bool:
    """Return whether a class is one of settings: some of its fields say what they are."""
    return has(kind) and any(METADATA_KEY in attribute.metadata for attribute in fields(kind))


_KINDS = {
    float: "number",
    int: "whole number",
    str: "text",
    bool: "true or false",
    type(None): "none",
}


def _kind_text(kind: Any) -> str:
    if isinstance(kind, type) and has(kind):
        return "block"
    if isinstance(kind, type) and kind in _KINDS:
        return _KINDS[kind]
    members = get_args(kind)
    if type(None) in members:
        return " or ".join(_kind_text(member) for member in members)
    origin = get_origin(kind)
    return (
        "mapping"
        if isinstance(origin, type) and issubclass(origin, Mapping)
        else "list"
        if members
        else "any"
    )
