"""The atmospheres: monotone and bounded everywhere, nothing evaluated above 100 km, bands, clouds,
and their cover.
"""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from opir_photons.radiometry.clouds import CloudField, FullDeck, is_hidden
from opir_photons.radiometry.configs import CloudConfig, LowtranConfig
from opir_photons.radiometry.lowtran import (
    LowtranAtmosphere,
    composition_of,
    lowtran_atmosphere,
    shell_air_mass,
)

from opir_core import Host
from opir_core.errors import ModelError
from opir_core.geometry import elevation_rad, geodetic_to_ecef, grazing_height_m
from opir_core.plugin import AtmosphereContext, Band, NoConfig, Paths

SWIR = Band("SWIR", 2.5, 3.0)
MWIR = Band("MWIR", 4.0, 5.0)
CONTEXT = AtmosphereContext(bands=(SWIR, MWIR), path="atmosphere", seed=5)
MODEL = lowtran_atmosphere(LowtranConfig(), CONTEXT)
SENSOR_M = geodetic_to_ecef(0.0, 0.0, 35_786e3)


def paths(height_m, elevation_sine):
    height, sine = np.broadcast_arrays(
        np.asarray(height_m, float), np.asarray(elevation_sine, float)
    )
    nowhere = np.zeros((height.size, 3))
    return Paths(height.ravel(), sine.ravel(), nowhere, nowhere, np.zeros(height.size))


def real_paths(latitude_deg, longitude_deg, height_m):
    """Return paths to a geostationary sensor at longitude 0."""
    columns = np.broadcast_arrays(
        np.radians(latitude_deg), np.radians(longitude_deg), np.asarray(height_m, float)
    )
    latitude, longitude, height = (column.ravel() for column in columns)
    target = geodetic_to_ecef(latitude, longitude, height)
    sensor = np.broadcast_to(SENSOR_M, target.shape)
    return Paths(
        height, np.sin(elevation_rad(target, sensor)), target, sensor, np.zeros(len(height))
    )


@given(
    st.integers(0, 1),
    st.floats(-500.0, 1e6),
    st.floats(-1.0, 1.0),
    st.floats(0.0, 1e5),
    st.floats(0.0, 1.0),
)
def test_transmittance_rises_with_height_and_elevation(band, height, sine, more, steeper):
    here, higher, up = MODEL.transmittance(
        band, paths([height, height + more, height], [sine, sine, min(sine + steeper, 1.0)])
    )
    assert 0.0 <= here <= higher <= 1.0
    assert here <= up <= 1.0
    if height >= 100e3 and sine >= 0.0:
        assert here == 1.0


def test_nothing_is_evaluated_above_100_km(monkeypatch):
    looked_up = []
    inner = LowtranAtmosphere._looked_up

    def counting(self, band, height_m, elevation_sine):
        looked_up.append(len(height_m))
        return inner(self, band, height_m, elevation_sine)

    monkeypatch.setattr(LowtranAtmosphere, "_looked_up", counting)
    assert (MODEL.transmittance(0, paths(np.linspace(100e3, 1e6, 50), 0.5)) == 1.0).all()
    assert looked_up == []
    MODEL.transmittance(0, paths([50e3, 99_999.0, 100e3, 3e5], 0.5))
    assert looked_up == [2]
    cloudy = lowtran_atmosphere(LowtranConfig(cloud=CloudConfig()), CONTEXT)
    monkeypatch.setattr(
        "opir_photons.radiometry.lowtran.is_hidden",
        lambda deck, path: pytest.fail("asked for clouds"),
    )
    cloudy.transmittance(0, paths([1e5, 2e5], 0.5))


@pytest.mark.parametrize("lowest_m", [500.0, 5e3, 12e3, 30e3, 60e3, 99e3])
@pytest.mark.parametrize("band", [0, 1])
def test_lines_beyond_the_air_share_a_transmittance(band, lowest_m):
    radius_m = 6_371_000.0
    height_m = np.array([99_999.9, 100_000.1, 150e3, 400e3, 1000e3])
    sine = -np.sqrt(1.0 - np.square((radius_m + lowest_m) / (radius_m + height_m)))
    result = MODEL.transmittance(band, paths(height_m, sine))
    np.testing.assert_allclose(result, result[0], atol=1e-4)
    assert lowest_m > 5e3 or (result < 0.01).all()
    assert lowest_m < 60e3 or (result > 0.9).all()


def test_the_horizon_is_crossed_without_a_step():
    sines = np.linspace(-0.1, 0.2, 3001)
    for height in (8e3, 20e3, 40e3):
        steps = np.diff(MODEL.transmittance(1, paths(height, sines)))
        assert steps.max() < 0.01


def test_the_earth_is_opaque():
    assert MODEL.transmittance(0, paths([10e3, 50e3], [-0.1, -0.15])).tolist() == [0.0, 0.0]


def test_rows_do_not_depend_on_their_company():
    rng = np.random.default_rng(3)
    some = real_paths(
        rng.uniform(-60, 60, 400), rng.uniform(-60, 60, 400), rng.uniform(0, 120e3, 400)
    )
    model = lowtran_atmosphere(LowtranConfig(cloud=CloudConfig(cover=0.5)), CONTEXT)
    together = model.transmittance(1, some)
    alone = [float(model.transmittance(1, some.take(slice(row, row + 1)))[0]) for row in range(400)]
    assert together.tolist() == alone


def test_air_mass_of_a_shell():
    """The way out of a shell of even air 8 km thick, by the intersection of a line with its outer
    sphere.
    """
    for zenith_deg in (0.0, 60.0, 85.0, 89.0, 90.0):
        sine = np.cos(np.radians(zenith_deg))
        way_km = np.sqrt(6_379.0**2 - 6_371.0**2 * (1.0 - sine**2)) - 6_371.0 * sine
        assert float(shell_air_mass(sine)) == pytest.approx(way_km / 8.0, rel=1e-9)


def test_bands_are_found_by_their_edges_or_made_of_parts():
    table = [Band("A", 1.0, 2.0), Band("A_N", 1.0, 1.5), Band("B", 2.0, 2.4), Band("C", 3.0, 4.0)]
    for stand_ins, lower_um, upper_um, parts in (
        ({}, 1.0, 2.0, "A"),
        ({}, 1.0, 2.4, "AB"),
        ({"W": "C"}, 7.0, 8.0, "C"),
    ):
        composition = composition_of(Band("W", lower_um, upper_um), stand_ins, table, "air", "T")
        assert [band.name for band in composition] == list(parts)
    for lower_um, upper_um in ((1.0, 3.0), (1.2, 2.0)):
        with pytest.raises(ModelError, match="nor made of them side by side"):
            composition_of(Band("W", lower_um, upper_um), {}, table, "air", "T")


def test_a_band_of_parts_is_their_mean_by_width():
    wide = Band("WIDE", 3.5, 5.0)
    parts = (Band("a", 3.5, 4.0), Band("b", 4.0, 5.0))
    context = AtmosphereContext(bands=(wide, *parts), path="atmosphere", seed=0)
    model = lowtran_atmosphere(LowtranConfig(), context)
    some = paths([0.0, 5e3, 20e3], [1.0, 0.3, 0.1])
    total, first, second = (model.transmittance(number, some) for number in range(3))
    np.testing.assert_allclose(total, (0.5 * first + second) / 1.5, rtol=1e-12)


def test_other_bands_are_refused_in_words():
    context = AtmosphereContext(bands=(Band("VIS", 0.4, 0.7),), path="atmosphere", seed=0)
    with pytest.raises(
        ModelError, match=r"atmosphere: the band VIS, 0.4 to 0.7 um, is not one of LOWTRAN's table"
    ):
        lowtran_atmosphere(LowtranConfig(), context)
    assert lowtran_atmosphere(LowtranConfig(bands={"VIS": "STG_2.0_2.4"}), context) is not None
    with pytest.raises(
        ModelError,
        match=r"atmosphere.bands: no sensor of the scene has a band VSI, .*; they have VIS",
    ):
        lowtran_atmosphere(LowtranConfig(bands={"VIS": "SWIR", "VSI": "SWIR"}), context)
    with pytest.raises(
        ValueError, match="aerosol: none goes with the climate us1976 alone, not with tropical"
    ):
        LowtranConfig(climate="tropical", aerosol="none")
    with pytest.raises(ValueError, match="'XIR' is not one of SWIR"):
        LowtranConfig(bands={"VIS": "XIR"})


def test_a_deck_hides_what_is_below_its_top_and_nothing_else():
    clear, cloudy = (
        lowtran_atmosphere(LowtranConfig(cloud=cloud), CONTEXT) for cloud in (None, CloudConfig())
    )
    heights = np.array([0.0, 9_999.0, 10_001.0, 50e3])
    some = real_paths(30.0, 20.0, heights)
    assert (cloudy.transmittance(1, some)[:2] == 0.0).all()
    assert cloudy.transmittance(1, some)[2:].tolist() == clear.transmittance(1, some)[2:].tolist()
    assert cloudy.cloud_top_m(some.target_ecef_m).tolist() == [10e3] * 4
    assert clear.cloud_top_m(some.target_ecef_m).tolist() == [-np.inf] * 4


def test_a_deck_hides_what_is_seen_across_the_limb_below_its_top():
    """Targets beyond the limb, whose light first descends: hidden where the line comes below the
    deck.
    """
    longitudes = np.linspace(81.5, 89.0, 200)
    some = real_paths(0.0, longitudes, 60e3)
    lowest = grazing_height_m(some.sensor_ecef_m, some.target_ecef_m)
    hidden = is_hidden(FullDeck(12e3), some)
    assert hidden.any()
    assert not hidden.all()
    clear_cut = np.abs(lowest - 12e3) > 50.0
    assert (hidden == (lowest < 12e3))[clear_cut].all()


def test_light_leaves_through_the_cell_above_its_way():
    """One cloudy cell hides a low target whose line of sight passes through the deck there, not one
    straight below.
    """
    field = CloudField.drawn(10e3, 0.0, 100e3, 1)
    towards = real_paths(0.0, 79.0, 0.0)
    steps = np.linspace(0.0, 400e3, 4001)[:, None]
    direction = (towards.sensor_ecef_m - towards.target_ecef_m) / np.linalg.norm(
        towards.sensor_ecef_m - towards.target_ecef_m
    )
    way = towards.target_ecef_m + steps * direction
    crossing = way[np.argmin(np.abs(np.linalg.norm(way, axis=1) - (6_378_137.0 + 10e3)))][None]
    # A field whose covers are the numbers of its cells tells a place's cell.
    cells = CloudField(field.top_m, field.row_start, np.arange(len(field.cloudy)))
    for place, expected in ((crossing, True), (towards.target_ecef_m, False)):
        cloudy = np.arange(len(field.cloudy)) == cells.is_cloudy(place)[0]
        assert is_hidden(CloudField(field.top_m, field.row_start, cloudy), towards).tolist() == [
            expected
        ]


@pytest.mark.parametrize("cover", [0.1, 0.5, 0.9])
def test_a_field_covers_its_share(cover):
    field = CloudField.drawn(8e3, cover, 100e3, 11)
    count = len(field.cloudy)
    assert count == pytest.approx(4.0 * np.pi * 6_371.0**2 / 100.0**2, rel=0.02)
    # 99.9 % of a binomial share.
    assert field.cloudy.mean() == pytest.approx(
        cover, abs=3.29 * np.sqrt(cover * (1.0 - cover) / count)
    )
    rng = np.random.default_rng(4)
    points = rng.normal(size=(20_000, 3))
    points *= 6.4e6 / np.linalg.norm(points, axis=1)[:, None]
    spread = np.sqrt(cover * (1.0 - cover) * (1.0 / 20_000 + 1.0 / count))
    assert field.is_cloudy(points).mean() == pytest.approx(cover, abs=3.29 * spread)


def test_a_field_depends_on_its_seed():
    one, repeated, other = (CloudField.drawn(8e3, 0.5, 200e3, seed) for seed in (1, 1, 2))
    assert (one.cloudy == repeated.cloudy).all()
    assert (one.cloudy != other.cloudy).any()


def test_poles_and_the_date_line_belong_to_cells():
    field = CloudField.drawn(8e3, 1.0, 100e3, 1)
    places = [(90.0, 0.0), (-90.0, 0.0), (0.0, 180.0), (0.0, -180.0), (12.0, -1e-14)]
    points = np.array(
        [geodetic_to_ecef(np.radians(lat), np.radians(lon), 0.0) for lat, lon in places]
    )
    assert field.is_cloudy(points).all()


def test_the_clear_sky_lets_everything_through():
    clear = Host.of().component("opir_atmosphere_models", "clear").build(NoConfig(), CONTEXT)
    assert clear.transmittance(0, paths([0.0, 1e6], 0.1)).tolist() == [1.0, 1.0]
    assert clear.cloud_top_m(np.zeros((2, 3))).tolist() == [-np.inf, -np.inf]
