"""Scenes spoilt by chance: a written form that can hold what YAML can, ways to spoil it, and what
it means.
"""

import copy
import json
from collections.abc import Callable
from datetime import UTC, date, datetime
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import yaml
from attrs import frozen
from fake_components import good_mapping
from hypothesis import strategies as st


@frozen
class Raw:
    """A scalar as it stands in the file."""

    text: str


class Block(list[tuple[str, Any]]):
    """A block as the pairs of its keys and values, so that keys can be doubled."""


WITHOUT_BLANKS = r"""
    010 007.5 -01 00 0o10 0x1F 0b101 1_000 1_0.5 12:30:00 1:30 190:20:30.15 1e3 1E3 1e2 1.5e-3 1e999 1e-999 1e-320 .nan
    -.inf .INF nan inf yes NO On off y true False TRUE ~ null Null '50' "50" "1e3" 1. .5 -.5 +3 -0 -0.0 0.1 0 1 -1 2 64
    65 64.0 900 9007199254740992 9007199254740993 123456789012345678901234567890 1234567890123456789012345678901 1;5
    10km 0.1000000000000000055511151231257827 2026-04-01 2026-04-01T12:00:00Z text '' "" [] {} [1] {a:1} *a &a ! = <<
    ICBM constant none "\ud800" "\0" @x `x %x |- > - -- ? : # '#' } ]
"""
WITH_BLANKS = """
    &a 3, !!int 3, !!str 3, [1 010], {a: 1}, 900 s, 1 # one, - 1, ? 1, 'a b', a 'b
"""
RAW_VALUES = [
    Raw(text)
    for text in (
        *WITHOUT_BLANKS.split(),
        *map(str.strip, WITH_BLANKS.split(",")),
        "\u0663",
        "\u00b2",
    )
]
PYTHON_VALUES: list[Any] = [
    None, True, 0, 1, -1, 7, 10**19, 2**53 + 1, 10**29, 10**400, 0.5, -0.0, 1e300, float("nan"), float("inf"), "", "50",
    "NO", "off", "1e3", "nan", "\x00", "\ud800", "x" * 300, b"50", (), (1, 2), [], {}, {1: 2}, {None: 1}, {"\x00": 1},
    {"": 1}, {1, 2}, np.float64(0.5), np.float64("nan"), np.float32(0.1), np.int64(3), np.bool_(True), np.str_("text"),
    np.zeros(3), np.array(["a"]), Decimal("0.1"), Fraction(1, 3), 1j, object(), date(2026, 4, 1),
    datetime(2026, 4, 1, tzinfo=UTC), print, Ellipsis, {"model": "constant"}, [[[[]]]],
]  # fmt: skip


def pairs(data):
    """Return data with its mappings as blocks."""
    if isinstance(data, dict):
        return Block((key, pairs(value)) for key, value in data.items())
    return [pairs(item) for item in data] if isinstance(data, list) else data


def yaml_of(tree):
    """Return a tree as YAML in one line; text is quoted, raw scalars are not."""
    if isinstance(tree, Raw):
        return tree.text
    if isinstance(tree, Block):
        return "{" + ", ".join(f"{json.dumps(key)}: {yaml_of(value)}" for key, value in tree) + "}"
    if isinstance(tree, list):
        return "[" + ", ".join(map(yaml_of, tree)) + "]"
    return json.dumps(tree)


def containers(tree):
    """Return every list and block in a tree, the outermost first."""
    if not isinstance(tree, list):
        return []
    children = [value for _, value in tree] if isinstance(tree, Block) else tree
    return [tree, *(result for child in children for result in containers(child))]


def set_value(container, index, value):
    container[index] = (container[index][0], value) if isinstance(container, Block) else value


def value_at(container, index):
    return container[index][1] if isinstance(container, Block) else container[index]


@st.composite
def spoilt(draw, values, doubles=True):
    """Return the good scene with one to three things done to it."""
    tree = pairs(good_mapping())
    for _ in range(draw(st.integers(1, 3))):
        full = [container for container in containers(tree) if container]
        container = draw(st.sampled_from(full))
        index = draw(st.integers(0, len(container) - 1))
        draw(st.sampled_from(DEEDS if doubles else DEEDS[:-1]))(
            draw, tree, container, index, values
        )
    return tree


def drop(_draw, _tree, container, index, _values):
    del container[index]


def replace(draw, _tree, container, index, values):
    # A copy: a later deed may spoil what stands here.
    set_value(container, index, copy.deepcopy(draw(st.sampled_from(values))))


def rename(draw, _tree, container, index, _values):
    if isinstance(container, Block):
        key, value = container[index]
        renamed = draw(
            st.sampled_from(
                [f"{key}x", key[:-1], key.upper(), "", "preset", "members", "model", "a b", "\x7f"]
            )
        )
        if renamed not in (name for name, _ in container):
            container[index] = renamed, value


def swap(draw, tree, container, index, _values):
    """Put a value of elsewhere here."""
    other = draw(st.sampled_from([result for result in containers(tree) if result]))
    value = value_at(other, draw(st.integers(0, len(other) - 1)))
    set_value(container, index, copy.deepcopy(value))


def wrap(_draw, _tree, container, index, _values):
    set_value(container, index, [value_at(container, index)])


def requote(_draw, _tree, container, index, _values):
    """Put a number in quotes."""
    value = value_at(container, index)
    if isinstance(value, int | float):
        set_value(container, index, str(value))


def double(_draw, _tree, container, index, _values):
    container.insert(index, copy.deepcopy(container[index]))


DEEDS: list[Callable[..., None]] = [drop, replace, replace, rename, swap, wrap, requote, double]


def has_doubled_key(tree):
    return any(
        len({key for key, _ in container}) < len(container)
        for container in containers(tree)
        if isinstance(container, Block)
    )


def meaning(raw):
    """Return what an unquoted scalar means, found without opir: a fraction, text, a truth value or
    None.
    """
    words = {
        "true": True,
        "false": False,
        "yes": True,
        "no": False,
        "on": True,
        "off": False,
        "null": None,
        "~": None,
    }
    if raw.lower() in words:
        return words[raw.lower()]
    if raw[0] in "'\"":
        return raw[1:-1]
    if raw[0] in "[{":
        return pairs(yaml.safe_load(raw))
    try:
        return Fraction(Decimal(raw)) if raw.isascii() else raw
    except (ArithmeticError, ValueError):
        return raw
