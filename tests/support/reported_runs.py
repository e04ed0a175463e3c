"""Runs that reports and plots are tested with, made once for all tests of a process."""

from functools import cache

from repository import EXAMPLES
from scored_scene import SCENE

import opir_core as opir


@cache
def scored_run():
    """Return 300 s of one ICBM, seen by two sensors and followed to a predicted impact."""
    tracker = {"model": "imm", "regions_every_s": 15.0}
    return opir.simulate(
        opir.scene_from_mapping({**SCENE, "duration_s": 300.0, "tracker": tracker})
    )


@cache
def example_run(name, **settings):
    """Return a run of an example with some of its values replaced."""
    overrides = [f"{key}={value}" for key, value in settings.items()]
    return opir.simulate(opir.load_scene(EXAMPLES / f"{name}.yaml", overrides=overrides))


@cache
def empty_run():
    """Return a run without targets: nothing is launched, detected, tracked or predicted."""
    return opir.simulate(opir.scene_from_mapping({**SCENE, "scene": "empty", "targets": []}))
