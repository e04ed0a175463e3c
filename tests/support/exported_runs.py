"""Runs for the tests of exports: one in memory, the same one read back from its files, and what
opir export writes.
"""

from functools import cache

from opir_export.command import exporter_of
from repository import TEST_SCENES

import opir_core
from opir_core.plugin import Host

SCENE = TEST_SCENES / "pacific_test_range.yaml"


@cache
def short_run():
    """Return the first 90 s of the Pacific test range: an ICBM and an IRBM in their boosts, with
    tracks and regions.
    """
    return opir_core.simulate(opir_core.load_scene(SCENE, overrides=["duration_s=90"]))


def exported(run, name, path, *settings):
    """Return the files that an exporter writes of a run."""
    return list(exporter_of(Host.discover(), name, settings).write(run, path))
