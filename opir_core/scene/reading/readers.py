"""Readers of values: each takes a node only as its type is written, and says what it would have taken.

Nothing is coerced: a number in quotes is text, a whole number is written without a point, `1` is no truth value. The
one conversion is from whole numbers to floats, where it keeps the number exactly.
"""

from collections.abc import Callable, Iterable
from typing import Any

from opir_core.scene.reading.nodes import (
    UNREADABLE,
    ErrorCollector,
    InvalidNode,
    Node,
    SwitchWord,
    index_step,
    key_step,
    shown_text,
)
from opir_core.scene.reading.yaml_scalars import is_decimal_text, is_on

#: Takes a node and its type (which the reader knows already); returns the value or raises `InvalidNode`.
Reader = Callable[[Node, Any], Any]

_FEW_KEYS = 8


def read_float(node: Node, _type: Any = None) -> float:
    """Return a number; -0.0 becomes 0.0, so that equal scenes are written alike."""
    value = node.value
    if type(value) is float:
        return value + 0.0
    if type(value) is not int:
        raise _no_number(node, "a number is needed")
    if int(float(value)) != value:
        raise node.refused(f"{value} has more digits than a number keeps; write it as {float(value)!r}")
    return float(value)


def read_int(node: Node, _type: Any = None) -> int:
    """Return a whole number."""
    value = node.value
    if type(value) is int:
        return value
    if type(value) is not float:
        raise _no_number(node, "a whole number is needed")
    hint = f": write {int(value)}" if value.is_integer() and abs(value) < 2**53 else ""
    raise node.refused(f"{_as_written(node)} is not written as a whole number, and one is needed{hint}")


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
    parts = zip(readers, items, strict=True)
    return tuple(_all_read((index_step(index), reader, item) for index, (reader, item) in enumerate(parts)))


def read_items(reader: Reader, node: Node, _type: Any = None) -> tuple[Any, ...]:
    """Return a list of any length."""
    return tuple(_all_read((index_step(index), reader, item) for index, item in enumerate(items_of(node))))


def read_mapping(reader: Reader, node: Node, _type: Any = None) -> dict[str, Any]:
    """Return a block whose keys are free."""
    block = block_of(node)
    values = _all_read((key_step(key), reader, item) for key, item in block.items())
    return dict(zip(block, values, strict=True))


def block_of(node: Node, keys: Iterable[str] = ()) -> dict[str, Node]:
    """Return the entries of a block, or raise that one is needed (with `keys`, where these are few)."""
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
    """Return that a node is something other than what is needed; nothing more where it already complains of itself."""
    if node.value is UNREADABLE:
        return InvalidNode()
    return node.refused(f"{_what_it_is(node)}; {needed}")


def _what_it_is(node: Node) -> str:
    value = node.value
    if isinstance(value, list | dict):
        return "this is a list" if isinstance(value, list) else "this is a block"
    if value is None:
        return "nothing is given"
    if isinstance(value, SwitchWord):
        return f"{value} is a truth value to some YAML readers"
    if isinstance(value, str):
        return f"{shown_text(value)} is text"
    return f"{_as_written(node)} is {'a truth value' if isinstance(value, bool) else 'a number'}"


def _as_written(node: Node) -> str:
    if isinstance(node.value, bool) and node.written is None:
        return str(node.value).lower()
    return node.written or str(node.value)


def _no_number(node: Node, needed: str) -> InvalidNode:
    if isinstance(node.value, str) and is_decimal_text(node.value):
        return refusal(node, f"{needed}: write {node.value} without quotes")
    return refusal(node, needed)


def _all_read(parts: Iterable[tuple[str, Reader, Node]]) -> list[Any]:
    """Return what all parts come to, or raise the complaints of all parts."""
    gathering, values = ErrorCollector(), []
    for step, reader, node in parts:
        with gathering.at(step):
            values.append(reader(node, None))
    gathering.require_whole()
    return values
