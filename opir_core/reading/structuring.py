"""Readers of configuration classes: nodes to checked values.

cattrs finds the reader of each type. Every reader is strict and converts nothing: a number in
quotes is text, a whole number has no decimal point, and `1` is not a truth value. The one
conversion is from whole numbers to floats, where it is exact. The reader of a class reports the
errors of every field of its block.
"""

import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, partial
from typing import Any, Union, get_args, get_origin, get_type_hints

from attrs import NOTHING, Attribute, fields, frozen, has
from cattrs import Converter

from opir_core.errors import nearest_names
from opir_core.reading.nodes import (
    UNREADABLE,
    ErrorCollector,
    InvalidNode,
    Node,
    SwitchWord,
    key_step,
    read_each,
    shown_text,
)
from opir_core.reading.plain_data import data_of_node, is_quantity, write_in_unit
from opir_core.reading.strict_yaml import is_decimal_text, is_on
from opir_core.scene.fields import METADATA_KEY, FieldInfo, info_of, named_value

#: Takes a node and its type (which the reader knows already); returns the value or raises
#: `InvalidNode`.
Reader = Callable[[Node, Any], Any]

_FEW_KEYS = 8
#: Types of values without quantities in them.
_PLAIN = (float, int, str, bool, type(None))


def read_float(node: Node, _type: Any = None) -> float:
    """Return a number; -0.0 becomes 0.0, so that equal scenes are written alike."""
    value = node.value
    if type(value) is float:
        return value + 0.0
    if type(value) is not int:
        raise _no_number(node, "a number is needed")
    if int(float(value)) != value:
        raise node.refused(
            f"{value} has more digits than a number keeps; write it as {float(value)!r}"
        )
    return float(value)


def read_int(node: Node, _type: Any = None) -> int:
    """Return a whole number."""
    value = node.value
    if type(value) is int:
        return value
    if type(value) is not float:
        raise _no_number(node, "a whole number is needed")
    hint = f": write {int(value)}" if value.is_integer() and abs(value) < 2**53 else ""
    raise node.refused(
        f"{_as_written(node)} is not written as a whole number, and one is needed{hint}"
    )


def read_bool(node: Node, _type: Any = None) -> bool:
    """Return a truth value: true, false, and unquoted yes, no, on and off."""
    if isinstance(node.value, SwitchWord):
        return is_on(node.value)
    if isinstance(node.value, bool):
        return node.value
    raise refusal(node, "true or false is needed")


def read_text(node: Node, _type: Any = None) -> str:
    """Return text."""
    if type(node.value) is str:
        return node.value
    if isinstance(node.value, SwitchWord | bool | int | float):
        raise refusal(node, f"text is needed: write '{_as_written(node)}' in quotes")
    raise refusal(node, "text is needed")


def read_node(node: Node, _type: Any = None) -> Node:
    """Return the node itself, to be read later."""
    return node


def read_optional(reader: Reader, node: Node, _type: Any = None) -> Any:
    """Return None for nothing, else what `reader` makes of it."""
    return None if node.value is None else reader(node, None)


def read_tuple(readers: tuple[Reader, ...], node: Node, _type: Any = None) -> tuple[Any, ...]:
    """Return a list of as many items as there are readers."""
    items = items_of(node)
    if len(items) != len(readers):
        raise node.refused(f"this list has {len(items)} items; {len(readers)} are needed")
    return tuple(read_each(items, lambda index, item: readers[index](item, None)))


def read_items(reader: Reader, node: Node, _type: Any = None) -> tuple[Any, ...]:
    """Return a list of any length."""
    return tuple(read_each(items_of(node), lambda _index, item: reader(item, None)))


def read_mapping(reader: Reader, node: Node, _type: Any = None) -> dict[str, Any]:
    """Return a block whose keys are free."""
    block = block_of(node)
    collector = ErrorCollector()
    values = {}
    for key, item in block.items():
        with collector.at(key_step(key)):
            values[key] = reader(item, None)
    collector.require_whole()
    return values


def block_of(node: Node, keys: Iterable[str] = ()) -> dict[str, Node]:
    """Return the entries of a block, or raise that one is needed (with `keys`, where these are
    few).
    """
    if isinstance(node.value, dict):
        return node.value
    names = list(keys)
    holding = f" of {', '.join(names)}" if 0 < len(names) <= _FEW_KEYS else ""
    raise refusal(node, f"a block{holding} is needed")


def items_of(node: Node) -> list[Node]:
    """Return the items of a list, or raise that one is needed."""
    if isinstance(node.value, list):
        return node.value
    raise refusal(node, "a list is needed")


def refusal(node: Node, needed: str) -> InvalidNode:
    """Return the error of a node of the wrong kind; an empty one if the node already has its own."""
    if node.value is UNREADABLE:
        return InvalidNode()
    return node.refused(f"{_what_it_is(node)}; {needed}")


def _what_it_is(node: Node) -> str:
    value = node.value
    if isinstance(value, list | dict):
        return "this is a list" if isinstance(value, list) else "this is a block"
    if value is None:
        return "the value is missing"
    if isinstance(value, SwitchWord):
        return f"{value} is a truth value to some YAML readers"
    if isinstance(value, str):
        return f"{shown_text(value)} is text"
    if is_quantity(value):
        return f"{value} has a unit, and this setting has none"
    return f"{_as_written(node)} is {'a truth value' if isinstance(value, bool) else 'a number'}"


def _as_written(node: Node) -> str:
    if isinstance(node.value, bool) and node.written is None:
        return str(node.value).lower()
    return node.written or str(node.value)


def _no_number(node: Node, needed: str) -> InvalidNode:
    if isinstance(node.value, str) and is_decimal_text(node.value):
        return refusal(node, f"{needed}: write {node.value} without quotes")
    return refusal(node, needed)


#: Says where a key belongs that means nothing in its block, "" where nowhere; takes the key and
#: whether a known one is like it.
Home = Callable[[str, bool], str]


class UnreadableTypeError(TypeError):
    """A configuration class with a field of a type that scenes cannot hold."""


@frozen
class FieldReader:
    """One field of a configuration class and the reader of its type."""

    attribute: "Attribute[Any]"
    read: Reader

    def value(self, node: Node) -> Any:
        """Return the field's value, or raise what its type or its validator says of it."""
        default = self.attribute.default
        info = info_of(self.attribute)
        if info.named_values and isinstance(node.value, str):
            return self._named(info, node)
        if info.unit and type(node.value) not in _PLAIN:
            write_in_unit(node, info.unit)
        # Of an optional block, the reader of the block itself.
        inner = (
            self.read.args[0]
            if isinstance(self.read, partial) and node.value is not None
            else self.read
        )
        if isinstance(inner, ClassReader) and isinstance(default, inner.config_class):
            value = inner.made(node, (), base=default)
        else:
            value = self.read(node, None)
        if METADATA_KEY in self.attribute.metadata and self.attribute.validator is not None:
            try:
                self.attribute.validator(None, self.attribute, value)
            except ValueError as error:
                raise node.refused(_words_of(error)) from error
        return value

    def _named(self, info: FieldInfo, node: Node) -> Any:
        """Return the value that a text stands for."""
        try:
            return named_value(info, node.value)
        except ValueError as error:
            raise node.refused(_words_of(error)) from error


@frozen
class ClassReader:
    """Reads a block into a configuration class; `fields` are its fields by name."""

    config_class: type
    fields: Mapping[str, FieldReader]

    def __call__(self, node: Node, _type: Any = None) -> Any:
        """Return the instance, or raise all that is wrong with the block and its fields."""
        return self.made(node, ())

    def made(
        self, node: Node, other_keys: Sequence[str], home: Home | None = None, base: Any = None
    ) -> Any:
        """Return the instance, or raise all that is wrong; `other_keys` may stand beside these.

        What the block leaves out is as in `base`, where one is given.
        """
        collector = ErrorCollector()
        values = self.values(node, collector, other_keys, home, base)
        collector.require_whole()
        try:
            return self.config_class(
                **{str(self.fields[name].attribute.alias): values[name] for name in values}
            )
        except ValueError as error:
            raise node.refused(_words_of(error)) from error

    def values(
        self,
        node: Node,
        collector: ErrorCollector,
        other_keys: Sequence[str] = (),
        home: Home | None = None,
        base: Any = None,
    ) -> dict[str, Any]:
        """Return the values that can be read, by name; errors go to `collector`.

        `home` says where a key belongs that means nothing here; what the block leaves out is as in
        `base`.
        """
        keys = (*other_keys, *self.fields)
        block = block_of(node, keys)
        for key in [key for key in block if key not in self.fields]:
            with collector.at(key_step(key)):
                raise unknown_key(key, block[key], keys, home)
        values = {}
        for name, field in self.fields.items():
            with collector.at(key_step(name)):
                if name in block:
                    values[name] = field.value(block[name])
                elif base is not None:
                    values[name] = getattr(base, name)
                elif field.attribute.default is NOTHING:
                    requirement = info_of(field.attribute).requirement
                    raise node.refused(
                        f"is missing: {requirement}" if requirement else "is missing"
                    )
        return values


@cache
def class_reader(config_class: type) -> ClassReader:
    """Return the reader of a configuration class; raises `UnreadableTypeError` where a scene cannot
    hold one.
    """
    try:
        hints = get_type_hints(config_class)
    except Exception as error:
        raise UnreadableTypeError(
            f"the field types of {config_class.__qualname__} are not known: {error}"
        ) from error
    fields_read = {}
    for attribute in fields(config_class):
        try:
            if attribute.init:
                fields_read[attribute.name] = FieldReader(
                    attribute, reader_of(hints[attribute.name])
                )
        except UnreadableTypeError as error:
            raise UnreadableTypeError(
                f"{config_class.__qualname__}.{attribute.name}: {error}"
            ) from error
    return ClassReader(config_class, fields_read)


def reader_of(kind: Any) -> Reader:
    """Return the reader of a type; raises `UnreadableTypeError` where a scene cannot hold one."""
    if not any(fits(kind) for fits, _ in _KINDS):
        raise UnreadableTypeError(f"scenes cannot hold a value of type {kind}")
    return _converter().get_structure_hook(kind)


def unknown_key(key: str, node: Node, keys: Sequence[str], home: Home | None = None) -> InvalidNode:
    """Return the refusal of a key that means nothing here: the nearest known one, where it belongs,
    or all known.
    """
    similar = nearest(key, keys)
    if node.written == "" and ":" in key:
        hint = "a space is missing after its ':'"
    else:
        belongs = home(key, similar is not None) if home else ""
        meant = f"did you mean {similar}?{' Otherwise ' if belongs else ''}" if similar else ""
        all_known = f"known here: {', '.join(keys)}" if keys else "there is nothing to set here"
        hint = f"{meant}{belongs}" or all_known
    return node.refused(f"unknown key; {hint}", at_key=True)


def required(block: dict[str, Node], key: str, node: Node) -> Node:
    """Take a key out of a block and return its value; raise that it is missing, with a key that may
    be meant for it.
    """
    if key in block:
        return block.pop(key)
    similar = nearest(key, block)
    raise node.refused(f"is missing{f'; is {similar} meant for it?' if similar else ''}")


def nearest(key: str, keys: Iterable[str]) -> str | None:
    """Return the known key that is most similar to a key, letter case ignored, or None where none
    is similar.
    """
    return next(iter(nearest_names(key, keys, most=1, cutoff=0.6)), None)


@cache
def _converter() -> Converter:
    converter = Converter(forbid_extra_keys=True, detailed_validation=True)
    for fits, factory in _KINDS:
        converter.register_structure_hook_factory(fits, factory)
    for kind, reader in _SCALARS.items():
        converter.register_structure_hook(kind, reader)
    return converter


def _read_data(node: Node, _type: Any = None) -> Any:
    return data_of_node(node)


def _is_optional(kind: Any) -> bool:
    arguments = get_args(kind)
    return (
        get_origin(kind) in (Union, types.UnionType)
        and len(arguments) == 2
        and type(None) in arguments
    )


def _is_mapping(kind: Any) -> bool:
    return get_origin(kind) in (dict, Mapping) and get_args(kind)[0] is str


def _optional_reader(kind: Any) -> Reader:
    (inner,) = (argument for argument in get_args(kind) if argument is not type(None))
    return read_node if inner is Node else partial(read_optional, reader_of(inner))


def _tuple_reader(kind: Any) -> Reader:
    arguments = get_args(kind)
    if len(arguments) == 2 and arguments[1] is ...:
        return partial(read_items, reader_of(arguments[0]))
    return partial(read_tuple, tuple(reader_of(argument) for argument in arguments))


def _mapping_reader(kind: Any) -> Reader:
    return partial(read_mapping, reader_of(get_args(kind)[1]))


_SCALARS: Mapping[type, Reader] = {
    float: read_float,
    int: read_int,
    bool: read_bool,
    str: read_text,
    Node: read_node,
}

#: (predicate, factory) of each readable type; the first match makes its reader.
_KINDS: tuple[tuple[Callable[[Any], bool], Callable[[Any], Reader]], ...] = (
    (lambda kind: isinstance(kind, type) and kind in _SCALARS, lambda kind: _SCALARS[kind]),
    (lambda kind: kind is Any, lambda _kind: _read_data),
    (_is_optional, _optional_reader),
    (lambda kind: get_origin(kind) is tuple and bool(get_args(kind)), _tuple_reader),
    (_is_mapping, _mapping_reader),
    (lambda kind: isinstance(kind, type) and has(kind) and kind is not Node, class_reader),
)


def _words_of(error: Exception) -> str:
    return str(error.args[0]) if error.args else type(error).__name__
