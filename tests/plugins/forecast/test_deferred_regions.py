"""Regions of `imm` are made when they are read, once for all containments, and are then plain
regions.
"""

import pickle

import numpy as np
import pytest
from attrs import evolve
from opir_forecast import regions as regions_module

from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_core.plugin import ImpactRegion

RING = np.array([[0.0, 0.0], [0.0, 0.1], [0.1, 0.0], [0.0, 0.0]])


@pytest.fixture
def calls(monkeypatch):
    """Return a list that gets an entry whenever outlines are made."""
    entries = []
    make = regions_module._outlines_of

    def counted(*points, **settings):
        entries.append(points)
        return make(*points, **settings)

    monkeypatch.setattr(regions_module, "_outlines_of", counted)
    return entries


def drawn_regions():
    points = np.random.default_rng(2).normal(0.3, 0.002, (64, 2))
    weight = np.full(64, 1.0 / 64.0)
    return regions_module.regions(points, weight, probability=0.5, samples=64.0)


def test_figures_of_a_condition_make_no_outline(calls):
    regions = drawn_regions()
    assert [region.containment for region in regions] == list(TRACK_CONTAINMENTS)
    assert {(region.probability, region.effective_samples) for region in regions} == {(0.5, 64.0)}
    assert np.allclose(regions[0].centre, 0.3, atol=0.001)
    assert calls == []


def test_outlines_are_made_once_for_all_containments(calls):
    regions = drawn_regions()
    areas = [region.area_km2 for region in regions]
    assert all(len(region.polygons) for region in regions)
    assert areas == [region.area_km2 for region in regions] == sorted(areas)
    assert len(calls) == 1


def deferred(make, **figures):
    """Return the first region of outlines."""
    return regions_module.DeferredRegion.of(regions_module.Outlines(make), 0, **figures)


def test_a_region_of_an_outline_is_a_plain_region():
    plain = ImpactRegion(0.9, 7.0, ((RING,),), (0.1, 0.2), "burn over", 0.4, 12.0)

    def region():
        return deferred(
            lambda: [regions_module.Outline(7.0, ((RING,),))],
            containment=0.9,
            centre=(0.1, 0.2),
            condition="burn over",
            probability=0.4,
            effective_samples=12.0,
        )

    assert region() == plain
    assert hash(region()) == hash(plain)
    assert repr(region()).partition("(")[2] == repr(plain).partition("(")[2]
    assert pickle.loads(pickle.dumps(region())) == plain
    assert evolve(region(), condition="relights") == evolve(plain, condition="relights")
    assert region().contains(0.02, 0.02)
    with pytest.raises(AttributeError, match="no attribute 'area_m2'"):
        _ = region().area_m2


def test_points_are_let_go_once_the_outline_is_made():
    points = np.ones(3)
    region = deferred(lambda: [regions_module.Outline(float(points.sum()), ())])
    assert region.area_km2 == 3.0
    assert region._outlines._make is None
