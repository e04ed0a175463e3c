"""The forces on targets in free flight: `kepler`, or a list of zonal harmonics and drag."""

from opir_core.reading.nodes import Gathering, Node, Refused, index_step, key_step, shown_text, under
from opir_core.reading.readers import block_of, items_of, refusal
from opir_core.reading.structuring import class_reader, nearest
from opir_core.scene import ZONAL_FORCES, SceneDrag, SceneForces

KEPLER = "kepler"
_DRAG = "drag"
_KNOWN = (*ZONAL_FORCES, _DRAG)
_NEEDED = f"{KEPLER}, or a list out of {', '.join(_KNOWN)}, is needed"
_ITEM_NEEDED = f"one of {', '.join(_KNOWN)}, or drag with its settings indented below it, is needed"


def read_forces(node: Node) -> SceneForces:
    """Return the forces of a node; raises `Refused` with all that is wrong with it."""
    if node.value == KEPLER:
        return SceneForces()
    if not isinstance(node.value, list):
        hint = f": write [{node.value}]" if isinstance(node.value, str) and node.value in _KNOWN else ""
        raise refusal(node, f"{_NEEDED}{hint}")
    if not node.value:
        raise node.refused(f"this list is empty; for the point mass alone, write {KEPLER}")
    gathering, found = Gathering(), dict[str, SceneDrag | None]()
    for index, item in enumerate(items_of(node)):
        with gathering.at(index_step(index)):
            name, drag = _force(item)
            if name in found:
                raise item.refused(f"{name} stands here twice")
            found[name] = drag
    gathering.require_whole()
    return SceneForces(tuple(name for name in ZONAL_FORCES if name in found), found.get(_DRAG))


def _force(node: Node) -> tuple[str, SceneDrag | None]:
    """Return an item's name, and its settings if it is drag."""
    if not isinstance(node.value, dict):
        return _named(node.value, node), SceneDrag() if node.value == _DRAG else None
    block = block_of(node)
    if len(block) != 1:
        raise refusal(node, _ITEM_NEEDED)
    ((key, settings),) = block.items()
    if _named(key, node) != _DRAG:
        raise node.refused(f"{key} has no settings: write {key} alone")
    with under(key_step(key)):
        return _DRAG, SceneDrag() if settings.value is None else class_reader(SceneDrag)(settings)


def _named(name: object, node: Node) -> str:
    if not isinstance(name, str):
        raise refusal(node, _ITEM_NEEDED)
    if name not in _KNOWN:
        raise _unknown(name, node)
    return name


def _unknown(name: str, node: Node) -> Refused:
    if name == KEPLER:
        return node.refused(f"{KEPLER} is the point mass alone: write it in the place of the list, or leave it out")
    near = nearest(name, _KNOWN)
    return node.refused(f"there is no force {shown_text(name)}; {f'did you mean {near}?' if near else _ITEM_NEEDED}")
