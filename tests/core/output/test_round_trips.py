"""What is written is what is read back: regions of any size and place, and tracks."""

import math

import numpy as np
import pytest
from attrs import fields
from hypothesis import assume, example, given, settings, strategies as st
from opir_testing import stub_estimates
from opir_testing.doubles import stub_hypotheses

from opir_core import ImpactRegion
from opir_core.arrays import FloatArray
from opir_core.geometry import AzimuthalEquidistant, unit_vectors
from opir_core.output import TracksFile, read_tracks
from opir_core.output.geojson import region_document, region_from_document
from opir_core.output.region_outlines import ring_radii_m
from opir_core.plugin import Tracks
from opir_core.scene import core_hypotheses

HYPOTHESES = tuple(each.name for each in core_hypotheses())
#: Half the way around the Earth, m.
_HALF_M = math.pi * 6_378_137.0
#: The grid of the file is 0.1 m: nearer to an edge than this a point may be on either side, m.
_NEAR_M = 1.0
latitudes = st.one_of(st.floats(-90.0, 90.0), st.sampled_from([-90.0, 90.0, 0.0, 89.9999]))
longitudes = st.one_of(st.floats(-180.0, 180.0), st.sampled_from([-180.0, 180.0, 179.9999, 0.0]))


def ring_about(
    chart: AzimuthalEquidistant, east_m: float, north_m: float, radii_m: FloatArray
) -> FloatArray:
    """Return a closed ring whose corners lie at distances around a point of a map."""
    turn = np.linspace(0.0, 2.0 * np.pi, len(radii_m), endpoint=False)
    plane = np.stack([east_m + radii_m * np.cos(turn), north_m + radii_m * np.sin(turn)], axis=1)
    ring = chart.places(plane)
    return np.concatenate([ring, ring[:1]])


@st.composite
def regions(draw: st.DrawFn) -> ImpactRegion:
    """Draw a region about a centre: a star of up to 0.97 of the way to the antipode, a hole, a
    second polygon.
    """
    centre = tuple(np.radians([draw(latitudes), draw(longitudes)]).tolist())
    chart = AzimuthalEquidistant.about(unit_vectors(np.array([centre]))[0])
    size_m = draw(st.one_of(st.floats(1e3, 5e6), st.floats(5e6, 0.97 * _HALF_M)))
    shares = draw(st.lists(st.floats(0.5, 1.0), min_size=3, max_size=24))
    polygon = [ring_about(chart, 0.0, 0.0, size_m * np.array(shares))]
    if draw(st.booleans()):
        polygon.append(ring_about(chart, 0.05 * size_m, 0.0, 0.1 * size_m * np.ones(5)))
    polygons = [tuple(polygon)]
    if size_m < 0.3 * _HALF_M and draw(st.booleans()):
        polygons.append((ring_about(chart, 2.0 * size_m, size_m, 0.3 * size_m * np.ones(7)),))
    area_km2 = 2e-6 * math.pi * 6_371_008.8**2 * (1.0 - math.cos(0.75 * size_m / 6_378_137.0))
    is_given = size_m > 4e6 or draw(st.booleans())
    region = ImpactRegion(
        containment=draw(st.floats(0.01, 0.99)),
        area_km2=area_km2,
        polygons=tuple(polygons),
        centre=centre if is_given else None,
        condition=draw(st.sampled_from(["comes down", "burn over", "relights"])),
        probability=draw(st.floats(0.0, 1.0)),
        effective_samples=draw(st.one_of(st.floats(1.0, 1e6), st.just(math.nan))),
    )
    # Through a pole, to the grid of the file, an edge has no sense of turning.
    assume(
        not any(
            is_at_an_edge(region, np.array([pole, 0.0])) for pole in (-0.5 * np.pi, 0.5 * np.pi)
        )
    )
    return region


def points_about(region: ImpactRegion, seed: int, count: int) -> FloatArray:
    """Return places (n, 2), rad: half of them over the Earth, half about the corners of a
    region.
    """
    rng = np.random.default_rng(seed)
    anywhere = np.stack(
        [np.arcsin(rng.uniform(-1.0, 1.0, count)), rng.uniform(-np.pi, np.pi, count)], axis=1
    )
    corners = np.concatenate([ring for polygon in region.polygons for ring in polygon])
    neighbours = corners[rng.integers(len(corners), size=count)] + rng.normal(0.0, 0.02, (count, 2))
    # A region that is cut at the 180th meridian may have a corner at a pole: the very pole may be
    # on either side.
    maximum = 0.5 * np.pi - _NEAR_M / 6_371_008.8
    neighbours[:, 0] = np.clip(neighbours[:, 0], -maximum, maximum)
    return np.concatenate([anywhere, neighbours])


def is_at_an_edge(region: ImpactRegion, place: FloatArray, near_m: float = _NEAR_M) -> bool:
    """Return whether places round this one, in eight directions, get more than one answer."""
    longitude = place[1]
    up = unit_vectors(place[np.newaxis])[0]
    east = np.array([-math.sin(longitude), math.cos(longitude), 0.0])
    turn = np.linspace(0.0, 2.0 * np.pi, 9)[:, np.newaxis]
    x, y, z = (
        up + near_m / 6_371_008.8 * (np.cos(turn) * east + np.sin(turn) * np.cross(up, east))
    ).T
    around = np.stack([np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)], axis=1)
    return len({region.contains(*point) for point in (place, *around)}) > 1


def requires_same_answers(
    region: ImpactRegion, back: ImpactRegion, seed: int, count: int = 20, near_m: float = _NEAR_M
) -> None:
    wrong = [
        place.tolist()
        for place in points_about(region, seed, count)
        if region.contains(*place) != back.contains(*place)
        and not is_at_an_edge(region, place, near_m)
    ]
    assert not wrong, np.degrees(wrong)


#: Around the south pole, with a hole across the 180th meridian.
ANNULUS = ImpactRegion(
    containment=0.5,
    area_km2=61_510_674.0,
    polygons=(
        tuple(
            np.radians(ring)
            for ring in (
                [[-30.1, -117.4], [-8.0, 148.8], [-59.7, 46.4], [-30.1, -117.4]],
                [
                    [-58.1, -171.5],
                    [-53.6, -179.6],
                    [-55.8, 170.0],
                    [-62.1, 169.4],
                    [-63.8, -177.0],
                    [-58.1, -171.5],
                ],
            )
        ),
    ),
    centre=(math.radians(-59.0), math.radians(173.0)),
)


@settings(deadline=None)
@example(region=ANNULUS, seed=0)
@given(region=regions(), seed=st.integers(0, 2**32))
def test_a_region_read_back_contains_what_it_contained(region: ImpactRegion, seed: int) -> None:
    back = region_from_document(region_document(region))
    for name in ("containment", "area_km2", "condition", "probability"):
        assert getattr(back, name) == getattr(region, name)
    assert repr(back.effective_samples) == repr(region.effective_samples)
    assert back.centre == pytest.approx(region.chart().centre, abs=1e-12)
    requires_same_answers(region, back, seed)
    requires_same_answers(region, region_from_document(region_document(back)), seed)


class Figures:
    """Draws columns of tracks (count,) in which each row of figures is known or unknown."""

    def __init__(self, draw: st.DrawFn, count: int) -> None:
        self.draw = draw
        self.rng = np.random.default_rng(draw(st.integers(0, 2**32)))
        self.count = count

    def column(self, *shape: int, scale: float = 1.0) -> FloatArray:
        column = self.rng.normal(size=(self.count, *shape)) * scale
        column[[not self.draw(st.booleans()) for _ in range(self.count)]] = np.nan
        return column

    def shares(self, *shape: int) -> FloatArray:
        return np.abs(np.tanh(self.column(*shape)))

    def covariance(self, size: int, of: FloatArray | None = None) -> FloatArray:
        """Return covariances (count, size, size), unknown where the figures `of` them are."""
        root = self.column(size, size)
        covariance = root @ root.transpose(0, 2, 1)
        return covariance if of is None else np.where(np.isnan(of[:, :1, None]), np.nan, covariance)

    def points(self) -> FloatArray:
        column = self.column(3)
        drawn = [[self.draw(latitudes), self.draw(longitudes)] for _ in range(self.count)]
        column[:, :2] = np.where(np.isnan(column[:, 1:2]), np.nan, np.radians(drawn))
        return column


@st.composite
def tracks(draw: st.DrawFn, count: int = 3) -> Tracks:
    """Draw tracks in which each block of figures is known or unknown."""
    figures = Figures(draw, count)
    rng = figures.rng
    launch = figures.points()
    impact = figures.points()
    burnout = figures.column(7)
    weighed = np.tile(stub_hypotheses(ICBM=0.5, SLV=0.25), (count, 1))
    return stub_estimates(
        count,
        track=rng.permutation(count),
        tick_s=61.0,
        available_s=61.0 + rng.uniform(0.0, 3.0, count),
        state=np.concatenate([figures.column(3, scale=1e7), figures.column(3, scale=1e3)], axis=1),
        state_covariance=figures.covariance(6),
        state_sigmas=np.abs(figures.column(3)),
        launch=launch,
        launch_covariance=figures.covariance(3, launch),
        impact=impact,
        impact_covariance=figures.covariance(3, impact),
        impact_sigmas=np.where(np.isnan(impact[:, :1]), np.nan, np.abs(figures.column(3))),
        type_probability=figures.shares(4),
        hypothesis_probability=np.where(rng.random((count, 1)) < 0.5, np.nan, weighed),
        burnout=burnout,
        burnout_covariance=figures.covariance(7, burnout),
        impact_regions=[tuple(draw(st.lists(regions(), max_size=2))) for _ in range(count)],
        probability_burning=figures.shares(),
        probability_relights=figures.shares(),
        end=rng.integers(0, 4, count),
        seen_s=np.abs(figures.column()),
        is_brief=rng.random(count) < 0.5,
    )


def requires_same_tracks(before: Tracks, changed: Tracks) -> None:
    for attribute in fields(Tracks):
        was, current = (getattr(tracks, attribute.name) for tracks in (before, changed))
        if attribute.name == "impact_regions":
            continue
        if current.shape[1:] == (0,):  # where no track is weighed there are no hypotheses
            assert np.isnan(was).all()
            continue
        if attribute.name in ("launch", "impact"):  # degrees, between -180 and 180
            turns = (current[:, 1] - was[:, 1]) / (2.0 * np.pi)
            was = was.copy()
            was[:, 1] += 2.0 * np.pi * np.where(np.isnan(turns), 0.0, np.round(turns))
        np.testing.assert_allclose(current, was, rtol=1e-15, atol=1e-15, err_msg=attribute.name)


@settings(deadline=None)
@given(before=tracks(), seed=st.integers(0, 2**32))
def test_tracks_read_back_are_those_that_were_written(
    before: Tracks, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("tracks") / "t.jsonl"
    with TracksFile(path, HYPOTHESES) as file:
        file.write(before)
    read_back = read_tracks(path, HYPOTHESES)
    before = before.take(np.argsort(before.track))
    requires_same_tracks(before, read_back)
    for was, current in zip(
        before.impact_regions.tolist(), read_back.impact_regions.tolist(), strict=True
    ):
        for region, back in zip(was, current, strict=True):
            # A file of tracks has positions to 0.1 % and edges to 0.2 % of a region's radius.
            near_m = max(_NEAR_M, 0.003 * float(ring_radii_m(region).max(initial=0.0)))
            requires_same_answers(region, back, seed, 5, near_m)
