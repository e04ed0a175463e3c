"""Regions of `imm` are made when they are read, once for all containments, and are then plain
regions.
"""

import pickle

import numpy as np
import pytest
from attrs import evolve
from opir_trackers.forecast import regions as regions_module
from opir_trackers.forecast.deferred_regions import DeferredRegion, Outline, Outlines
from opir_trackers.forecast.regions import regions

from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_core.plugin import ImpactRegion

RING = np.array([[0.0, 0.0], [0.0, 0.1], [0.1, 0.0], [0.0, 0.0]])


@pytest.fixture
def made(monkeypatch):
    """Return a list that gets an entry whenever outlines are made."""
    calls = []
    make = regions_module._outlines_of

    def counted(*points, **how):
        calls.append(points)
        return make(*points, **how)

    monkeypatch.setattr(regions_module, "_outlines_of", counted)
    return calls


def some_regions():
    rng = np.random.default_rng(2)
    return regions(
        rng.normal(0.3, 0.002, (64, 2)), np.full(64, 1.0 / 64.0), probability=0.5, samples=64.0
    )


def test_figures_of_a_condition_make_no_outline(made):
    found = some_regions()
    assert [(one.containment, one.probability, one.effective_samples) for one in found] == [
        (share, 0.5, 64.0) for share in TRACK_CONTAINMENTS
    ]
    assert np.allclose(found[0].centre, 0.3, atol=0.001)
    assert made == []


def test_outlines_are_made_once_for_all_containments(made):
    found = some_regions()
    areas = [one.area_km2 for one in found]
    assert all(len(one.polygons) for one in found)
    assert areas == [one.area_km2 for one in found] == sorted(areas)
    assert len(made) == 1


def test_a_region_of_an_outline_is_a_plain_region():
    plain = ImpactRegion(0.9, 7.0, ((RING,),), (0.1, 0.2), "burn over", 0.4, 12.0)
    figures = {
        "containment": 0.9,
        "centre": (0.1, 0.2),
        "condition": "burn over",
        "probability": 0.4,
    }

    def deferred():
        outlines = Outlines(lambda: [Outline(7.0, ((RING,),))])
        return DeferredRegion.of(outlines, 0, effective_samples=12.0, **figures)

    assert deferred() == plain
    assert hash(deferred()) == hash(plain)
    assert repr(deferred()).partition("(")[2] == repr(plain).partition("(")[2]
    assert pickle.loads(pickle.dumps(deferred())) == plain
    assert evolve(deferred(), condition="relights") == evolve(plain, condition="relights")
    assert deferred().contains(0.02, 0.02)
    with pytest.raises(AttributeError, match="no attribute 'area_m2'"):
        _ = deferred().area_m2


def test_points_are_let_go_once_the_outline_is_made():
    points = np.ones(3)
    outlines = Outlines(lambda: [Outline(float(points.sum()), ())])
    region = DeferredRegion.of(outlines, 0, containment=0.5)
    assert region.area_km2 == 3.0
    assert outlines._make is None
