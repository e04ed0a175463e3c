"""Views and backgrounds: the table's points, sun, cloud, limb and space, clutter, and bands of
other edges.
"""

import numpy as np
import pytest
from attrs import evolve
from hypothesis import given, strategies as st
from opir_photons.radiometry import band_radiance, band_transmittance
from opir_photons.radiometry.configs import (
    CLIMATES,
    CloudConfig,
    EarthConfig,
    LimbStructureConfig,
    LowtranConfig,
    StructureConfig,
    StructuresConfig,
)
from opir_photons.radiometry.earth import (
    LOOK_SINES,
    earth_background,
    limb_tables,
    sky_tables,
    table_rows,
)
from opir_photons.radiometry.lowtran import lowtran_atmosphere
from opir_photons.radiometry.viewing import views

from opir_core import Host
from opir_core.errors import ModelError
from opir_core.geometry import (
    geodetic_to_ecef,
    grazing_height_m,
    local_axes,
    sun_ecef_m,
    sun_position_ecef_m,
)
from opir_core.interfaces import Structure
from opir_core.plugin import AtmosphereContext, BackgroundContext, Band, NoConfig, Views

BANDS = tuple(table.band for table in sky_tables("us1976", "clear"))
NAMES = [band.name for band in BANDS]
LOWTRAN_BANDS = tuple(table.band for table in sky_tables("us1976", "std_cirrus"))
EPOCH_US = 1_775_044_800_000_000
SENSOR_M = geodetic_to_ecef(0.0, 0.0, 35_786e3)


def sky(cloud=None, bands=BANDS):
    return lowtran_atmosphere(
        LowtranConfig(cloud=cloud), AtmosphereContext(bands=bands, path="atmosphere", seed=0)
    )


def background(cloud=None, bands=BANDS, **settings):
    context = BackgroundContext(
        bands=bands, path="background", epoch_us=EPOCH_US, make_atmosphere=lambda: sky(cloud, BANDS)
    )
    return earth_background(EarthConfig(**settings), context)


CLEAR = background()
CLOUDY = background(CloudConfig(top_km=10.0))


def looks(elevation_sine, sun_elevation_sine, height_m=0.0):
    columns = np.broadcast_arrays(
        *(np.asarray(one, float) for one in (height_m, elevation_sine, sun_elevation_sine))
    )
    height, elevation, sun = (np.ravel(column) for column in columns)
    point = np.broadcast_to(geodetic_to_ecef(0.3, 0.1, 0.0), (len(height), 3))
    return Views(height, elevation, sun, point, np.zeros(len(height)))


@pytest.mark.slow
@pytest.mark.parametrize("climate", CLIMATES)
@pytest.mark.parametrize(
    "name", ["clear", "std_cirrus", "cumulus_top2.7km", "altostratus_top3.0km"]
)
def test_every_point_of_the_table_is_met(climate, name):
    # The imagers' bands have clear skies alone; of these and of none other is a row below what
    # LOWTRAN itself gives: where its surface emits less by day than by night (8 to 12 µm), opir
    # keeps that of the night.
    bands = BANDS if name == "clear" else LOWTRAN_BANDS
    model = background(climate=climate, sky=name, bands=bands)
    rows = [row for row in table_rows() if (row["atmosphere"], row["sky"]) == (climate, name)]
    assert len(rows) == 11 * len(bands)
    dark = {
        (row["look_deg"], row["band"]): float(row["L_W_m2_sr"])
        for row in rows
        if row["day_night"] == "night"
    }
    for row in rows:
        sun = np.cos(np.radians(float(row["sza_deg"]))) if row["sza_deg"] else -0.2
        view = looks(LOOK_SINES[float(row["look_deg"])], sun)
        result = model.radiance_w_m2_sr(NAMES.index(row["band"]), view)
        least = dark[row["look_deg"], row["band"]]
        assert result == pytest.approx(max(float(row["L_W_m2_sr"]), least), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("albedo", "top_km"), [("0.1", 6.0), ("0.3", 6.0), ("0.3", 10.0), ("0.1", 12.0), ("0.3", 15.0)]
)
def test_every_opaque_cloud_of_the_table_is_met(albedo, top_km):
    model = background(CloudConfig(top_km=top_km), cloud_albedo=float(albedo))
    name = f"ANALYTIC_opaque_cloud_top{top_km:g}km"
    rows = [row for row in table_rows() if row["sky"] == name and row["albedo"] == albedo]
    assert len(rows) == 4 * len(BANDS)
    for row in rows:
        sun = np.cos(np.radians(float(row["sza_deg"]))) if row["sza_deg"] else -0.2
        result = model.radiance_w_m2_sr(NAMES.index(row["band"]), looks(0.9, sun))
        assert result == pytest.approx(float(row["L_W_m2_sr"]), rel=1e-9)


def test_sunlit_cloud_outshines_the_clear_night_in_swir():
    swir = NAMES.index("SWIR")
    cloud = float(CLOUDY.radiance_w_m2_sr(swir, looks(1.0, 0.5))[0])
    night = float(CLEAR.radiance_w_m2_sr(swir, looks(1.0, -0.5))[0])
    assert 0.3 < cloud < 1.0
    assert night == pytest.approx(0.001571)


@given(
    st.integers(0, len(BANDS) - 1), st.floats(0.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.0, 1.0)
)
def test_radiance_is_positive_and_rises_with_the_sun(band, look, sun, more):
    for model in (CLEAR, CLOUDY):
        low, high = model.radiance_w_m2_sr(band, looks([look, look], [sun, min(sun + more, 1.0)]))
        assert 0.0 < low < 100.0
        if NAMES[band] in {"SWIR", "STG_2.0_2.4"}:
            assert high >= low


def test_there_is_no_step_at_the_table_s_points():
    sines = np.linspace(0.0, 1.0, 2001)
    for band in range(len(BANDS)):
        for view in (looks(sines, 0.4), looks(0.7, 2.0 * sines - 1.0)):
            radiance = CLEAR.radiance_w_m2_sr(band, view)
            assert np.abs(np.diff(radiance)).max() < 0.01 * radiance.max()


@pytest.mark.parametrize("climate", CLIMATES)
def test_the_air_beyond_the_limb_radiates_what_it_absorbs(climate):
    """Between black bodies of the coldest and the warmest air, by what the path from the tangent
    lets pass both ways.
    """
    edges = (8.0, 12.0)
    (table,) = [table for table in limb_tables(climate) if table.band.name == "LWIR"]
    for tangent_m in (6e3, 10e3, 20e3, 30e3, 40e3):
        passed = float(band_transmittance(*edges, tangent_m, 0.0, climate=climate)) ** 2
        absorbed = 1.0 - passed
        radiance = float(table.at(np.array([tangent_m]))[0])
        assert 0.8 * absorbed * band_radiance(195.0, *edges) < radiance
        assert radiance < 1.2 * absorbed * band_radiance(285.0, *edges)


def test_the_limb_darkens_with_height_above_50_km():
    view = looks(0.0, 0.5, np.linspace(5e4, 1e5, 51))
    for band in range(len(BANDS)):
        radiance = CLEAR.radiance_w_m2_sr(band, view)
        assert np.all(np.diff(radiance) < 0.0)
        assert radiance[-1] == 0.0


def test_space_is_cold():
    beyond = looks(0.0, 0.5, [1e-3, 1e5, 1e9, np.inf])
    for model in (CLEAR, CLOUDY):
        assert model.radiance_w_m2_sr(0, beyond)[1:].tolist() == [0.0] * 3
        assert model.clutter_w_m2_sr(0, beyond)[1:].tolist() == [0.0] * 3


def test_clutter_is_the_stated_share():
    view = looks([0.2, 0.9], [0.3, -0.3])
    result = background(clutter_residual=0.02).clutter_w_m2_sr(0, view)
    np.testing.assert_allclose(result, 0.02 * CLEAR.radiance_w_m2_sr(0, view), rtol=1e-12)


def test_bands_side_by_side_add_up_and_stand_ins_count_by_width():
    wide = Band("WIDE", 3.5, 5.0)
    odd = Band("ODD", 4.0, 4.5)
    context = BackgroundContext(
        bands=(wide, odd), path="background", epoch_us=0, make_atmosphere=sky
    )
    model = earth_background(EarthConfig(bands={"ODD": "MWIR"}), context)
    view = looks(0.8, 0.5)
    parts = [CLEAR.radiance_w_m2_sr(NAMES.index(name), view) for name in ("MWIRW_3.5_4.0", "MWIR")]
    assert model.radiance_w_m2_sr(0, view) == pytest.approx(sum(parts), rel=1e-12)
    assert model.radiance_w_m2_sr(1, view) == pytest.approx(0.5 * parts[1], rel=1e-12)
    with pytest.raises(
        ModelError, match=r"background: the band ODD, 4 to 4.5 um, is not one of the table's"
    ):
        earth_background(EarthConfig(), context)


def test_rows_do_not_depend_on_their_company():
    rng = np.random.default_rng(1)
    view = looks(rng.uniform(0, 1, 100), rng.uniform(-1, 1, 100), rng.choice([0.0, 5e4], 100))
    together = CLOUDY.radiance_w_m2_sr(2, view)
    assert together.tolist() == [
        float(CLOUDY.radiance_w_m2_sr(2, view.take(slice(row, row + 1)))[0]) for row in range(100)
    ]


def sight(latitude_deg, longitude_deg, height_m):
    target = geodetic_to_ecef(np.radians(latitude_deg), np.radians(longitude_deg), height_m)
    sensor = np.broadcast_to(SENSOR_M, target.shape)
    return sensor, target - sensor


def test_a_view_ends_where_the_line_meets_the_earth():
    sensor, direction = sight(
        np.array([0.0, 40.0, -60.0]), np.array([0.0, 30.0, -20.0]), np.zeros(3)
    )
    result = views(sensor, direction, np.zeros(3), EPOCH_US)
    np.testing.assert_allclose(result.point_ecef_m, sensor + direction, atol=1e-6)
    assert result.height_m.tolist() == [0.0] * 3
    assert result.elevation_sine[0] == pytest.approx(1.0)
    # Noon UTC on the first of April: the Sun is 4.6 degrees north of the point below the sensor.
    assert np.degrees(np.arccos(result.sun_elevation_sine[0])) == pytest.approx(4.7, abs=0.5)


def test_each_view_has_the_sun_of_its_own_place():
    """At six in the evening one sensor sees day in the west, night in the east, and no step at the
    terminator.
    """
    longitude = np.linspace(-70.0, 70.0, 281)
    sensor, direction = sight(np.zeros(281), longitude, np.zeros(281))
    evening_s = np.full(281, 6.0 * 3600.0)
    view = views(sensor, direction, evening_s, EPOCH_US)
    sun = sun_position_ecef_m(np.datetime64(EPOCH_US, "us"), evening_s) - view.point_ecef_m
    up = local_axes(view.point_ecef_m)[:, 2]
    sines = np.sum(up * sun, axis=1) / np.linalg.norm(sun, axis=1)
    np.testing.assert_allclose(view.sun_elevation_sine, sines, atol=1e-6)
    swir = CLEAR.radiance_w_m2_sr(NAMES.index("SWIR"), view)
    night = CLEAR.radiance_w_m2_sr(
        NAMES.index("SWIR"), evolve(view, sun_elevation_sine=np.full(281, -0.5))
    )
    assert np.array_equal(swir > night, sines > 0.0)
    assert 100 < np.count_nonzero(sines > 0.0) < 181
    assert np.abs(np.diff(swir)).max() < 0.05 * swir.max()


def test_a_view_beyond_the_limb_has_its_lowest_height():
    longitude = np.full(40, 89.0)
    sensor, direction = sight(np.linspace(-50.0, 50.0, 40), longitude, np.full(40, 300e3))
    lowest = grazing_height_m(sensor, sensor + 2.0 * direction)
    result = views(sensor, direction, np.zeros(40), EPOCH_US)
    beyond = result.height_m > 0.0
    assert beyond.sum() > 10
    np.testing.assert_allclose(result.height_m[beyond], lowest[beyond], atol=40.0)
    assert (result.elevation_sine[beyond] == 0.0).all()


def test_a_line_away_from_the_earth_ends_in_space():
    result = views(SENSOR_M[None], SENSOR_M[None], np.zeros(1), EPOCH_US)
    assert result.height_m[0] == np.inf
    assert CLEAR.radiance_w_m2_sr(0, result).tolist() == [0.0]


def test_no_background_is_dark():
    context = BackgroundContext(bands=BANDS, path="background", epoch_us=0, make_atmosphere=sky)
    dark = Host.of().component("opir_background_models", "none").build(NoConfig(), context)
    view = looks([0.1, 0.9], 0.5)
    assert (
        dark.radiance_w_m2_sr(0, view).tolist()
        == dark.clutter_w_m2_sr(0, view).tolist()
        == [0.0, 0.0]
    )


def test_the_sun_is_where_geometry_has_it():
    time_s = np.random.default_rng(2).uniform(-1e4, 2e6, 2000)
    computed = sun_ecef_m(time_s, EPOCH_US)
    reference = sun_position_ecef_m(np.datetime64(EPOCH_US, "us"), time_s)
    assert (
        np.linalg.norm(computed - reference, axis=1) / np.linalg.norm(reference, axis=1)
    ).max() < 1e-7
    assert sun_ecef_m(time_s[7:8], EPOCH_US).tolist() == computed[7:8].tolist()
    assert sun_ecef_m(np.empty(0), EPOCH_US).shape == (0, 3)


def test_views_do_not_depend_on_their_company():
    rng = np.random.default_rng(5)
    target = geodetic_to_ecef(
        rng.uniform(-1.5, 1.5, 200), rng.uniform(-2.0, 2.0, 200), rng.uniform(0.0, 1e6, 200)
    )
    sensor = np.broadcast_to(SENSOR_M, target.shape)
    time_s = rng.uniform(0.0, 9e3, 200)
    together = views(sensor, target - sensor, time_s, EPOCH_US)
    for row in range(0, 200, 13):
        one = slice(row, row + 1)
        alone = views(sensor[one], (target - sensor)[one], time_s[one], EPOCH_US)
        for name in ("height_m", "elevation_sine", "sun_elevation_sine", "point_ecef_m"):
            assert getattr(alone, name).tolist() == getattr(together, name)[one].tolist()


def test_structure_is_shares_of_emission_and_of_sunlight():
    part = {"thermal_rms": 0.2, "solar_rms": 0.5, "scale_km": 12.0, "exponent": 2.8}
    settings = StructuresConfig(
        terrain=StructureConfig(**part), cloud=StructureConfig(thermal_rms=0.0, solar_rms=0.4)
    )
    swir = NAMES.index("SWIR")
    view = looks([0.4, 0.9], [0.6, 0.6])
    night = looks([0.4, 0.9], [-0.3, -0.3])
    clear, cloudy = (
        background(cloud, structure=settings) for cloud in (None, CloudConfig(top_km=10.0))
    )
    radiance, rms, number = clear.structured_radiances_w_m2_sr([swir], view)
    emitted = clear.radiance_w_m2_sr(swir, night)
    np.testing.assert_allclose(radiance[0], clear.radiance_w_m2_sr(swir, view), rtol=1e-14)
    np.testing.assert_allclose(
        rms[0], np.hypot(0.2 * emitted, 0.5 * (radiance[0] - emitted)), rtol=1e-12
    )
    assert [clear.structures[one] for one in number] == [Structure(12e3, 2.8)] * 2
    radiance, rms, number = cloudy.structured_radiances_w_m2_sr([swir], view)
    np.testing.assert_allclose(
        rms[0], 0.4 * (radiance[0] - cloudy.radiance_w_m2_sr(swir, night)), rtol=1e-12
    )
    assert number.tolist() == [0, 0]
    assert cloudy.structured_radiances_w_m2_sr([swir], night)[1].tolist() == [[0.0, 0.0]]


def test_limb_structure_falls_with_height():
    limb = LimbStructureConfig(thermal_rms=0.1, solar_rms=0.0, height_km=10.0)
    model = background(structure=StructuresConfig(limb=limb))
    view = looks(0.0, -0.5, [0.0, 1.0, 10e3, 20e3, np.inf])
    radiance, rms, number = model.structured_radiances_w_m2_sr([0, 2], view)
    horizon = np.array(
        [float(model.radiance_w_m2_sr(band, looks(0.0, -0.5))[0]) for band in (0, 2)]
    )
    np.testing.assert_allclose(
        rms[:, 1:4], 0.1 * horizon[:, None] * np.exp([-1e-4, -1.0, -2.0]), rtol=1e-12
    )
    beyond = [model.radiance_w_m2_sr(band, view)[1:] for band in (0, 2)]
    assert radiance[:, 1:].tolist() == np.array(beyond).tolist()
    assert radiance[:, 4].tolist() == [0.0, 0.0]
    assert rms[:, 4].tolist() == [0.0, 0.0]
    assert number.tolist() == [1, 2, 2, 2, 2]


def test_sea_and_cloudy_skies_have_structures_of_their_own():
    sea = background(structure=StructuresConfig(surface="sea"))
    cumulus = background(sky="cumulus_top2.7km", bands=LOWTRAN_BANDS)
    view = looks([0.4], [0.6])
    numbers = [model.structured_radiances_w_m2_sr([0], view)[2][0] for model in (sea, cumulus)]
    of_sea = sea.structures[numbers[0]]
    of_cloud = cumulus.structures[numbers[1]]
    assert of_sea == Structure(
        1e3 * StructuresConfig().sea.scale_km, StructuresConfig().sea.exponent
    )
    assert of_cloud == Structure(
        1e3 * StructuresConfig().cloud.scale_km, StructuresConfig().cloud.exponent
    )
