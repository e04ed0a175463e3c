"""The table of hypotheses of a track, from groups and target classes."""

import numpy as np
import pytest
from opir_trackers.onset.composition import Composition

from opir_core.scene import core_hypotheses

HYPOTHESES = core_hypotheses()
NAMES = [one.name for one in HYPOTHESES]
COMPOSITION = Composition.of(HYPOTHESES)


def row(**given):
    return np.array([[given.get(name.replace(" ", "_"), 0.0) for name in NAMES]])


def test_a_launch_shares_its_probability_and_none_has_two_sources():
    groups = np.array([[0.1, 0.2, 0.05, 0.6, 0.05]])
    found = COMPOSITION.probabilities(groups, row(SRBM=0.7, SLV=0.2, none_of_these=0.1))[0]
    assert found.sum() == pytest.approx(1.0)
    expected = {
        "noise": 0.1,
        "ground source": 0.2,
        "bolide": 0.05,
        "SRBM": 0.42,
        "SLV": 0.12,
        "none of these": 0.11,
    }
    for name, chance in expected.items():
        assert found[NAMES.index(name)] == pytest.approx(chance)
