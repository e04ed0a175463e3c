"""Files and mappings to scenes, or to one error with everything that is wrong."""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from opir_core.errors import PluginError, Problem, SceneError
from opir_core.plugin.host import Host
from opir_core.scene.reading.limits import MAXIMUM_FILE_BYTES
from opir_core.scene.reading.nodes import Complaint, InvalidNode, Node, complaints_inside, cut_short, ordered
from opir_core.scene.reading.overrides import overridden
from opir_core.scene.reading.plain_data import node_of_data
from opir_core.scene.reading.readers import block_of
from opir_core.scene.reading.scene_builder import Assembler
from opir_core.scene.reading.scene_schema import CHOICES
from opir_core.scene.reading.strict_yaml import node_of_yaml
from opir_core.scene.scene import Scene

_BYTE_ORDER_MARKS = {b"\xef\xbb\xbf": "UTF-8", b"\xff\xfe": "UTF-16", b"\xfe\xff": "UTF-16"}
_DEFAULTS = {key: default for key, (_, default) in CHOICES.items()}


def load_scene(path: str | os.PathLike[str], *, overrides: Sequence[str] = (), host: Host | None = None) -> Scene:
    """Return the scene of a YAML file.

    `overrides` (`sensors[0].scan_period_ms=50`) change it before it is checked. Components come from `host`, by default
    from the installed plugins. Raises `SceneError` with every problem and its scene path, line and column; where the
    scene is right, `PluginError` for components that cannot be had.
    """
    source = os.fspath(path)
    try:
        root = node_of_yaml(_text_of_file(source))
    except InvalidNode as refused:
        raise _scene_error(refused.complaints, source) from None
    return _scene_of_node(root, overrides, host, source)


def scene_from_mapping(
    mapping: Mapping[str, Any], *, overrides: Sequence[str] = (), host: Host | None = None, source: str = "scene"
) -> Scene:
    """Return the scene of a mapping laid out as a scene file is; `source` is what messages call it.

    It is checked as a file is, and holds plain data only: mappings with text keys, lists, tuples, text, finite numbers,
    bools and None. Raises as `load_scene` does.
    """
    try:
        root = node_of_data(mapping)
    except InvalidNode as refused:
        raise _scene_error(refused.complaints, source) from None
    return _scene_of_node(root, overrides, host, source)


def _scene_of_node(root: Node, overrides: Sequence[str], host: Host | None, source: str) -> Scene:
    try:
        block_of(root, ("scene", "epoch", "duration_s", "sensors"))
    except InvalidNode as refused:
        raise _scene_error([*complaints_inside(root), *refused.complaints], source) from None
    complaints = overridden(root, overrides, _DEFAULTS)
    complaints += complaints_inside(root)
    assembler = Assembler(host or Host.discover())
    scene = assembler.scene(root)
    complaints += assembler.gathering.complaints
    if complaints:
        raise _scene_error(complaints, source)
    if scene is None:
        raise _plugin_error(assembler.chooser.failures)
    return scene


def _text_of_file(source: str) -> str:
    raw = _bytes_of_file(source)
    for mark, encoding in _BYTE_ORDER_MARKS.items():
        if raw.startswith(mark):
            raise InvalidNode([Complaint(f"begins with a byte-order mark of {encoding}; save it as UTF-8 without one")])
    if b"\0" in raw:
        raise InvalidNode([Complaint("is not text: it contains zero bytes")])
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InvalidNode([Complaint(f"is not UTF-8: byte 0x{raw[error.start]:02x} in line {line}")]) from None


def _bytes_of_file(source: str) -> bytes:
    try:
        with Path(source).open("rb") as file:
            raw = file.read(MAXIMUM_FILE_BYTES + 1)
    except FileNotFoundError:
        raise InvalidNode([Complaint("there is no such file")]) from None
    except IsADirectoryError:
        raise InvalidNode([Complaint("is a directory; a scene is a file")]) from None
    except (OSError, ValueError) as error:
        words = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InvalidNode([Complaint(f"cannot be read: {words}")]) from None
    if len(raw) > MAXIMUM_FILE_BYTES:
        raise InvalidNode(
            [Complaint(f"is larger than {MAXIMUM_FILE_BYTES} bytes, the most that a scene file may have")]
        )
    return raw


def _scene_error(complaints: Iterable[Complaint], source: str) -> SceneError:
    shown = cut_short(ordered(complaints))
    return SceneError([Problem(complaint.path, complaint.text) for complaint in shown], source=source)


def _plugin_error(failures: list[PluginError]) -> PluginError:
    words = list(dict.fromkeys(map(str, failures)))
    return failures[0] if len(words) == 1 else PluginError("\n".join(words))
