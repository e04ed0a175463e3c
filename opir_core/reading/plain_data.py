"""Mappings, lists, scalars and quantities with units of Python to nodes, and back."""

import math
import re
from collections.abc import Mapping
from itertools import count
from typing import Any

from opir_core.reading.nodes import (
    MAXIMUM_DEPTH,
    MAXIMUM_DIGITS,
    MAXIMUM_VALUES,
    UNREADABLE,
    Complaint,
    InvalidNode,
    Node,
    SwitchWord,
)
from opir_core.reading.strict_yaml import quoted_value

_TOO_LONG = 10**MAXIMUM_DIGITS
_POWERS = str.maketrans({"²": "2", "³": "3"})
#: A power behind the name of a unit: `m2`.
_POWER = re.compile(r"(?<=[A-Za-z])(\d)")
#: Units of settings that are none.
_PURE = {"1": "", "sigma": ""}


def node_of_data(data: Any) -> Node:
    """Return the nodes of plain data: mappings with text keys, lists, tuples, text, finite numbers,
    quantities with units, bools and None.

    What is wrong with single values waits in the nodes; data that is too deep or too large raises
    `InvalidNode`.
    """
    return _node(data, 0, count(1))


def data_of_node(node: Node) -> Any:
    """Return a node's plain data: dicts, lists and scalars; raises `InvalidNode` where some of it
    cannot be read.
    """
    value = node.value
    if isinstance(value, list):
        return [data_of_node(child) for child in value]
    if isinstance(value, dict):
        return {key: data_of_node(child) for key, child in value.items()}
    if isinstance(value, SwitchWord):
        raise node.refused(
            f"{value} is a truth value to some YAML readers; write true or false, or '{value}' in"
            f" quotes"
        )
    if value is UNREADABLE:
        raise InvalidNode
    return value


def _node(data: Any, depth: int, counter: "count[int]") -> Node:
    if next(counter) > MAXIMUM_VALUES:
        raise InvalidNode([Complaint(f"there are more than {MAXIMUM_VALUES} values")])
    if isinstance(data, Mapping | list | tuple):
        if depth >= MAXIMUM_DEPTH:
            raise InvalidNode([Complaint(f"blocks and lists are more than {MAXIMUM_DEPTH} deep")])
        return _container(data, depth + 1, counter)
    try:
        return Node(_scalar(data))
    except ValueError as error:
        return Node(UNREADABLE, complaints=(Complaint(str(error)),))


def _container(data: Any, depth: int, counter: "count[int]") -> Node:
    if not isinstance(data, Mapping):
        return Node([_node(item, depth, counter) for item in data])
    node = Node({})
    for key, value in data.items():
        complaint = _key_complaint(key)
        if complaint:
            node.complaints = (*node.complaints, Complaint(complaint))
        else:
            node.value[str(key)] = _node(value, depth, counter)
    return node


def _key_complaint(key: Any) -> str | None:
    if not isinstance(key, str):
        return f"a key is of type {_type_name(key)}; keys are text"
    try:
        quoted_value(key)
    except ValueError as error:
        return f"in a key, {error}"
    return None


def _scalar(data: Any) -> Any:
    if data is None or isinstance(data, bool) or is_quantity(data):
        return data
    if isinstance(data, str):
        return quoted_value(str(data))
    if isinstance(data, int):
        if abs(int(data)) >= _TOO_LONG:
            raise ValueError(f"a whole number of more than {MAXIMUM_DIGITS} digits")
        return int(data)
    if isinstance(data, float):
        if not math.isfinite(data):
            raise ValueError(f"{float(data)!r} is not a finite number")
        return float(data)
    raise ValueError(
        f"a value of type {_type_name(data)} is not plain data; scenes hold mappings, lists, text,"
        f" numbers and bools"
    )


def _type_name(data: Any) -> str:
    kind = type(data)
    return (
        kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__qualname__}"
    )


def is_quantity(value: Any) -> bool:
    """Whether a value has a unit, by its attributes: a quantity of astropy or of pint."""
    of_astropy = hasattr(value, "unit") and hasattr(value, "to_value")
    return of_astropy or (hasattr(value, "units") and hasattr(value, "m_as"))


def write_in_unit(node: Node, unit: str) -> None:
    """Write the quantities of a node, those of lists and blocks too, as numbers in a unit.

    Raises `InvalidNode` for quantities of another dimension, and for arrays.
    """
    value = node.value
    if isinstance(value, list | dict):
        for item in value if isinstance(value, list) else value.values():
            write_in_unit(item, unit)
    if is_quantity(value):
        try:
            node.value = number_in(value, unit)
        except ValueError as error:
            raise node.refused(str(error)) from error


def number_in(value: Any, unit: str) -> float:
    """Return a quantity in a unit; raises `ValueError` for one of another dimension, and for an
    array.
    """
    name = _POWER.sub(r"**\1", _PURE.get(unit, unit).translate(_POWERS))
    try:
        return float((value.to_value if hasattr(value, "to_value") else value.m_as)(name))
    except Exception as error:  # each library has classes of its own
        raise ValueError(f"{value} is not a number of the unit {unit or '1'}") from error
