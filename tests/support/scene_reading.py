"""Scenes of fake components, read with changes, and the problems that reading them tells."""

from types import ModuleType

import pytest
from fake_components import fake_host, good_mapping

from opir_core.errors import SceneError
from opir_core.plugin import TrackerModel, hookimpl
from opir_core.reading import scene_from_mapping

HOST = fake_host()
PAGE = """
scene: range                         # a comment
epoch: 2026-04-01T12:00:00Z          # needs no quotes
duration_s: 1e3
sensors:
  - constellation: FLEET
    rows: 3
  - {model: SCANNER, id: S1, orbital_slot_deg: 5, preset: slow, rows: 2}
targets:
  - id: T1
    type: ICBM
    launch: {lat_deg: 34.73, lon_deg: -120.57, time_s: 10}
    aim: {lat_deg: .5, lon_deg: +167.7}
light_time: off
outputs:
  - "null"
  - jsonl:
"""


def read(*overrides, host=HOST, **changes):
    return scene_from_mapping({**good_mapping(), **changes}, overrides=overrides, host=host)


def problems(*overrides, **changes):
    with pytest.raises(SceneError) as caught:
        read(*overrides, **changes)
    return [str(problem) for problem in caught.value.problems]


def plugin_of(**hooks):
    module = ModuleType("other")
    for name, function in hooks.items():
        setattr(module, name, hookimpl(function))
    return module


def host_with_tracker(config):
    tracker = TrackerModel(name="other", summary="another", config=config, build=print)
    return fake_host(plugin_of(opir_trackers=lambda: [tracker]))
