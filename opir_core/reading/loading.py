"""Files and mappings, with overrides, to scenes, or to one error with all problems."""

import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

from opir_core.errors import PluginError, Problem, SceneError
from opir_core.host.host import Host
from opir_core.reading.format_versions import MANIFEST_FORMAT
from opir_core.reading.nodes import (
    MAXIMUM_FILE_BYTES,
    UNREADABLE,
    Complaint,
    InvalidNode,
    Node,
    Place,
    complaints_inside,
    cut_short,
    index_step,
    key_step,
    ordered,
    shown_text,
)
from opir_core.reading.plain_data import node_of_data
from opir_core.reading.scene_builder import SceneBuilder
from opir_core.reading.scene_schema import CHOICES
from opir_core.reading.strict_yaml import node_of_scalar, node_of_yaml
from opir_core.reading.structuring import block_of
from opir_core.scene.input_file import file_bytes
from opir_core.scene.scene import Scene

#: Returns the name of the component that a key chooses, given the nodes of a scene.
DefaultName = Callable[[str, Mapping[str, Any]], str]

_BYTE_ORDER_MARKS = {b"\xef\xbb\xbf": "UTF-8", b"\xff\xfe": "UTF-16", b"\xfe\xff": "UTF-16"}


def load_scene(
    path: str | os.PathLike[str], *, overrides: Sequence[str] = (), host: Host | None = None
) -> Scene:
    """Return the scene of a YAML file, or of the manifest of a run (JSON).

    `overrides` (`sensors[0].scan_period_ms=50`, or `sensors[*].scan_period_ms=50` for every item)
    change it before it is checked. Components come from `host`, by default from the installed
    plugins. Raises `SceneError` with every problem and its scene path, line and column; if the
    scene is valid, `PluginError` for missing components.
    """
    source = os.fspath(path)
    try:
        root = node_of_yaml(_text_of_file(source))
    except InvalidNode as refused:
        raise _scene_error(refused.complaints, source) from None
    return _scene_of_node(_of_manifest(root, source), overrides, host, source)


def _of_manifest(root: Node, source: str) -> Node:
    """Return the scene in the manifest of a run; any other node is a scene itself."""
    if not isinstance(root.value, dict) or "manifest_version" not in root.value:
        return root
    version = root.value["manifest_version"]
    stated = version.value if isinstance(version, Node) else version
    MANIFEST_FORMAT.require_readable(stated, Path(source), "manifest_version")
    scene = root.value.get("scene")
    return scene if isinstance(scene, Node) and isinstance(scene.value, dict) else root


def scene_from_mapping(
    mapping: Mapping[str, Any],
    *,
    overrides: Sequence[str] = (),
    host: Host | None = None,
    source: str = "scene",
) -> Scene:
    """Return the scene of a mapping laid out as a scene file is; `source` is its name in messages.

    It is checked as a file is, and holds plain data only: mappings with text keys, lists, tuples,
    text, finite numbers, bools and None; and quantities of astropy or pint (`0.05 * u.s`), which
    become numbers in the unit of their setting. Raises as `load_scene` does.
    """
    try:
        root = node_of_data(mapping)
    except InvalidNode as refused:
        raise _scene_error(refused.complaints, source) from None
    return _scene_of_node(root, overrides, host, source)


def placed(
    problems: Iterable[Problem], source: str, overrides: Sequence[str] = ()
) -> list[Problem]:
    """Return problems of a scene file with the lines that their paths stand in, as far as there are
    any.
    """
    try:
        root = node_of_yaml(_text_of_file(source))
    except InvalidNode:
        return list(problems)
    overridden(root, overrides)
    return [
        Problem(problem.path, Complaint(problem.message, _place_of(root, problem.path)).text)
        for problem in problems
    ]


def _place_of(root: Node, path: str) -> Place:
    """Return the place of the deepest node on a path; None if not even its first step is there."""
    node = root
    place = None
    for key, index, _ in _STEP.findall(f".{path}"):
        value = node.value
        if isinstance(value, dict) and key in value:
            node = value[key]
        elif isinstance(value, list) and index and int(index) < len(value):
            node = value[int(index)]
        else:
            break
        place = node.place
    return place


def _scene_of_node(root: Node, overrides: Sequence[str], host: Host | None, source: str) -> Scene:
    try:
        block_of(root, ("scene", "epoch", "duration_s", "sensors"))
    except InvalidNode as refused:
        raise _scene_error([*complaints_inside(root), *refused.complaints], source) from None
    builder = SceneBuilder(host or Host.discover())
    complaints = overridden(root, overrides, builder.default_name)
    complaints += complaints_inside(root)
    scene = builder.scene(root)
    complaints += builder.collector.complaints
    if complaints:
        raise _scene_error(complaints, source)
    if scene is None:
        words = list(dict.fromkeys(map(str, builder.components.failures)))
        raise builder.components.failures[0] if len(words) == 1 else PluginError("\n".join(words))
    return scene


def _text_of_file(source: str) -> str:
    raw = _bytes_of_file(source)
    for mark, encoding in _BYTE_ORDER_MARKS.items():
        if raw.startswith(mark):
            raise _invalid(
                f"begins with a byte-order mark of {encoding}; save it as UTF-8 without one"
            )
    if b"\0" in raw:
        raise _invalid("is not text: it contains zero bytes")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise _invalid(f"is not UTF-8: byte 0x{raw[error.start]:02x} in line {line}") from None


def _bytes_of_file(source: str) -> bytes:
    try:
        raw = file_bytes(source, MAXIMUM_FILE_BYTES)
    except FileNotFoundError:
        link = Path(source)
        words = (
            f"is a link to {str(link.readlink())!r}, which is not there"
            if link.is_symlink()
            else ""
        )
        raise _invalid(words or "there is no such file") from None
    except IsADirectoryError:
        raise _invalid("is a directory; a scene is a file") from None
    except (OSError, ValueError) as error:
        words = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise _invalid(f"cannot be read: {words}") from None
    if len(raw) > MAXIMUM_FILE_BYTES:
        raise _invalid(
            f"is larger than {MAXIMUM_FILE_BYTES} bytes, the most that a scene file may have"
        )
    return raw


def _invalid(message: str) -> InvalidNode:
    return InvalidNode([Complaint(message)])


def _scene_error(complaints: Iterable[Complaint], source: str) -> SceneError:
    shown = cut_short(ordered(complaints))
    return SceneError(
        [Problem(complaint.path, complaint.text) for complaint in shown], source=source
    )


_STEP = re.compile(r"\.([^\s.\[\]=]+)|\[([0-9]{1,9})\]|\[(\*)\]")
_SECRET = re.compile(r"password|passphrase|secret|token|credential", re.IGNORECASE)
#: What the values that are read as YAML begin with, and what these end with.
_YAML = {"'": "'", '"': '"', "[": "]", "{": "}", "&": "", "*": "", "!": ""}


def overridden(
    root: Node, overrides: Sequence[str], default_name: DefaultName | None = None
) -> list[Complaint]:
    """Apply overrides to a scene's nodes in order, and return their errors.

    A key that its block lacks is created, and so are blocks on the way to it; an item that its list
    lacks is not. `[*]` stands for every item of a list. `default_name` returns the name of the
    component that a key chooses where the scene has none: a component named without settings
    (`detection: constant`) becomes a block when a setting of it is overridden.
    """
    complaints: list[Complaint] = []
    for override in overrides:
        try:
            _apply(root, override, default_name)
        except InvalidNode as refused:
            complaints += refused.complaints
    return complaints


def _apply(root: Node, override: str, default_name: DefaultName | None) -> None:
    path, equals, text = override.partition("=")
    # A path that may set a secret: no message repeats its value.
    is_secret = _SECRET.search(path.rpartition(".")[2])
    shown = f"override {shown_text(f'{path}=...' if is_secret else override)}"
    if not equals:
        raise _invalid(f"{shown} has no '='; write path=value")
    steps = _steps(path.strip(), shown)
    value = _value(text.strip(), shown)
    if default_name is not None and steps[0] in CHOICES:
        _open_choice(root, steps, default_name, shown)
    _set(root, steps, value, shown)


#: A step of an override's path: a key, the number of an item, or `None` for every item.
_Step = str | int | None


def _steps(path: str, shown: str) -> list[_Step]:
    steps: list[_Step] = []
    at = 0
    dotted = f".{path}"
    while step := _STEP.match(dotted, at):
        steps.append(
            step[1] if step[1] is not None else int(step[2]) if step[2] is not None else None
        )
        at = step.end()
    if at < len(dotted) or not steps:
        raise _invalid(
            f"{shown}: {shown_text(path)} is not a scene path; write it like sensors[0].id"
        )
    return steps


def _value(text: str, shown: str) -> Node:
    """Return the node of an override's value: an unquoted scalar as it stands, or quotes, [...] and
    {...} of YAML.
    """
    if not text:
        raise _invalid(f"{shown} has no value; write null for none, or '' for empty text")
    if text[0] not in _YAML:
        return node_of_scalar(text, shown)
    if not text.endswith(_YAML[text[0]]):
        raise _invalid(f"{shown}: text that begins with {text[0]} needs quotes")
    try:
        return node_of_yaml(text, shown)
    except InvalidNode as refused:
        raise InvalidNode(
            Complaint(f"{shown}: {complaint.message}") for complaint in refused.complaints
        ) from refused


def _open_choice(root: Node, steps: Sequence[_Step], default_name: DefaultName, shown: str) -> None:
    """Turn the name of a component into a block, if the path leads to one of its settings."""
    key = steps[0]
    if len(steps) == 1 or not isinstance(key, str) or not isinstance(root.value, dict):
        return
    choice = root.value.get(key) or Node(default_name(key, root.value), shown)
    if type(choice.value) is str and choice.value:
        root.value[key] = Node({"model": choice}, choice.place, choice.key_place)


def _set(node: Node, steps: Sequence[_Step], value: Node, shown: str, path: str = "") -> None:
    for place, step in enumerate(steps):
        if node.value is UNREADABLE:
            raise InvalidNode
        if step is None:
            for number in range(_count(node, path, shown)):
                inner = f"{path}{index_step(number)}".removeprefix(".")
                _set(node.value[number], steps[place + 1 :], deepcopy(value), shown, inner)
            return
        node = (
            _item(node, step, path, shown)
            if isinstance(step, int)
            else _entry(node, step, path, shown)
        )
        path = (
            f"{path}{index_step(step) if isinstance(step, int) else key_step(step)}".removeprefix(
                "."
            )
        )
    node.value = value.value
    node.place = value.place
    node.written = value.written
    node.complaints = value.complaints


def _entry(node: Node, key: str, path: str, shown: str) -> Node:
    """Return the value of a key, an empty block where there is none."""
    if not isinstance(node.value, dict):
        raise _invalid(f"{shown}: {path or 'the scene'} is {_kind(node)}, which has no key {key}")
    return node.value.setdefault(key, Node({}, shown, shown))


def _count(node: Node, path: str, shown: str) -> int:
    """Return the number of items that `[*]` stands for, at least one."""
    if not isinstance(node.value, list) or not node.value:
        description = "an empty list" if isinstance(node.value, list) else _kind(node)
        raise _invalid(
            f"{shown}: {path or 'the scene'} is {description}, which has no items for [*]"
        )
    return len(node.value)


def _item(node: Node, index: int, path: str, shown: str) -> Node:
    if not isinstance(node.value, list):
        raise _invalid(
            f"{shown}: {path or 'the scene'} is {_kind(node)}, which has no item {index}"
        )
    count = len(node.value)
    if index >= count:
        raise _invalid(
            f"{shown}: {path} has {count} item{'s' if count != 1 else ''}, numbered from 0"
        )
    return node.value[index]


def _kind(node: Node) -> str:
    if isinstance(node.value, list | dict):
        return "a list" if isinstance(node.value, list) else "a block"
    return "a single value"
