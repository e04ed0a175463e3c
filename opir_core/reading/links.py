"""The block `links` of a scene, read with the ids of its sensors."""

from collections.abc import Iterator, Sequence
from typing import Any

from opir_core.reading.nodes import InvalidNode, Node, index_step, key_step, under
from opir_core.reading.structuring import block_of, class_reader, items_of, nearest
from opir_core.scene.links import ANY, Links


def read_links(node: Node, sensors: Sequence[str]) -> Links:
    """Return the links of a node; raises `InvalidNode` with its place for a name of no node."""
    links: Links = class_reader(Links)(node)
    block = block_of(node)
    satellites = [*sensors, *(relay.id for relay in links.relays)]
    nodes = [*satellites, *(station.id for station in links.stations)]
    twice = next((name for name in satellites if nodes.count(name) > 1), None)
    if twice is not None:
        raise node.refused(f"{twice!r} names two nodes")
    for steps, name, known in _names(block, sensors, satellites, nodes):
        if name.value not in known:
            with under(*steps):
                raise _unknown(name, known)
    return links


def _names(
    block: dict[str, Node], sensors: Sequence[str], satellites: Sequence[str], nodes: Sequence[str]
) -> Iterator[tuple[tuple[str, ...], Node, Sequence[str]]]:
    """Yield each name in the block, with its steps and the names that may stand there."""
    for steps, outage in _items(block, "outages"):
        yield (*steps, key_step("node")), block_of(outage)["node"], nodes
    for steps, downlink in _items(block, "downlinks"):
        for place, name in _items(block_of(downlink), "sensors"):
            yield (*steps, *place), name, sensors
        for place, path in _items(block_of(downlink), "paths"):
            for hop, name in enumerate(items_of(path)[:-1]):
                yield (*steps, *place, index_step(hop)), name, [*satellites, ANY]


def _items(block: dict[str, Node], key: str) -> Iterator[tuple[tuple[str, str], Node]]:
    """Yield the items of a list in a block with their steps; nothing without it."""
    for index, item in enumerate(items_of(block[key]) if key in block else ()):
        yield (key_step(key), index_step(index)), item


def _unknown(name: Node, known: Sequence[str]) -> InvalidNode:
    similar: Any = nearest(str(name.value), known)
    hint = f"did you mean {similar}?" if similar else f"known here: {', '.join(known)}"
    return name.refused(f"there is no {name.value!r}; {hint}")
