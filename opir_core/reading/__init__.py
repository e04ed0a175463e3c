"""Reading scenes: YAML or a mapping to a checked `Scene`, strictly, with every problem and its place in one error."""

from opir_core.reading.canonical import scene_hash, scene_mapping
from opir_core.reading.loading import load_scene, scene_from_mapping

__all__ = ["load_scene", "scene_from_mapping", "scene_hash", "scene_mapping"]
