"""Sources: from lists, CSV files and random fields; fires, flares, glints and bolides; and what is wrong with a CSV."""

from pathlib import Path

import numpy as np
import opir_dsp.plugin
import pytest
from scipy import integrate, stats

from opir_core.errors import ModelError, SceneError
from opir_core.geometry import ecef_to_geodetic, geodetic_to_ecef, local_axes, sun_position_ecef_m
from opir_core.plugin.host import Host
from opir_core.protocols import Band
from opir_core.radiometry.glint import reflectance, slope_density, sunlight_w_m2
from opir_core.radiometry.lowtran import lowtran_atmosphere
from opir_core.radiometry.planck import band_radiance
from opir_core.radiometry.protocols import AtmosphereContext, SourceContext
from opir_core.radiometry.sky_configs import LowtranConfig
from opir_core.radiometry.source_configs import (
    BolideConfig,
    FieldConfig,
    FireConfig,
    FlareConfig,
    GlintConfig,
    RegionConfig,
)
from opir_core.radiometry.sources import bolide_sources, fire_sources, flare_sources, glint_sources
from opir_core.reading import scene_from_mapping, scene_mapping
from opir_core.scene import EMITTER_TYPES

SWIR, MWIR = Band("SWIR", 2.5, 3.0), Band("MWIR", 4.0, 5.0)
HOST = Host.of(opir_dsp.plugin)
HERE = ({"lat_deg": 10.0, "lon_deg": 20.0},)
NOON_US = 1_775_044_800_000_000  # 2026-04-01T12:00:00Z


def context(seed=1, duration_s=600.0, **changes):
    settings = {"bands": (SWIR, MWIR), "id": "fires", "path": "sources[0]", "epoch_us": NOON_US}
    return SourceContext(**settings, seed=seed, duration_s=duration_s, **changes)


def region(south=-10.0, north=20.0, west=30.0, east=60.0):
    return RegionConfig(south_deg=south, north_deg=north, west_deg=west, east_deg=east)


def field(per_million_km2=20.0, where=None, sigma=1.0):
    return FieldConfig(region=where or region(), per_million_km2=per_million_km2, area_log_sigma=sigma)


def intensity(sources, band=0, time_s=100.0, to_sensor=None, rows=None):
    rows = np.arange(len(sources.ids), dtype=np.int32) if rows is None else rows
    time = np.full(len(rows), time_s)
    place = sources.trajectories.position_ecef_m(rows, time)
    up = local_axes(place)[:, 2] if to_sensor is None else np.broadcast_to(to_sensor, place.shape)
    aspect = sources.signatures.aspect_rad(rows, time, up)
    height = ecef_to_geodetic(place).height_m
    since = time - sources.trajectories.ignition_s[rows]
    return sources.signatures.intensity_w_sr(band, rows, since, height, aspect)


def test_emitters_of_a_list_have_their_own_values_or_the_blocks():
    config = FireConfig(
        at=({"lat_deg": 1.0, "lon_deg": 2.0}, {"lat_deg": 3.0, "lon_deg": 4.0, "area_m2": 1.0}), area_m2=5.0
    )
    sources = fire_sources(config, context())
    assert sources.ids == ("fires-1", "fires-2")
    told = sources.trajectories.truth()
    assert [row["area_m2"] for row in told] == [5.0, 1.0]
    assert told[0]["type"] == "fire"
    assert sources.trajectories.type_code.tolist() == [EMITTER_TYPES.index("fire")] * 2
    where = ecef_to_geodetic(sources.trajectories.position_ecef_m(np.array([1], np.int32), np.zeros(1)))
    assert np.degrees([where.latitude_rad[0], where.longitude_rad[0]]) == pytest.approx([3.0, 4.0])


def test_a_fire_is_a_flat_grey_body():
    sources = fire_sources(FireConfig(at=HERE, temperature_k=900.0, emissivity=0.5, area_m2=200.0), context())
    up, (_, north, _) = (
        local_axes(sources.trajectories.start_ecef_m)[0, 2],
        local_axes(sources.trajectories.start_ecef_m)[0],
    )
    whole = 0.5 * 200.0 * band_radiance(900.0, 4.0, 5.0)
    assert intensity(sources, 1) == pytest.approx(whole, rel=1e-12)
    assert intensity(sources, 1, to_sensor=(up + north) / np.sqrt(2.0)) == pytest.approx(
        whole / np.sqrt(2.0), rel=1e-12
    )
    assert intensity(sources, 1, to_sensor=-up).tolist() == [0.0]


def test_a_flare_shines_to_all_sides():
    sources = flare_sources(FlareConfig(at=HERE), context())
    east = local_axes(sources.trajectories.start_ecef_m)[0, 0]
    assert intensity(sources, to_sensor=east).tolist() == intensity(sources).tolist()
    assert intensity(sources)[0] == pytest.approx(0.3 * 30.0 * band_radiance(1800.0, 2.5, 3.0), rel=1e-12)


def test_sources_shine_from_start_to_end():
    sources = flare_sources(FlareConfig(at=HERE, start_s=50.0, end_s=70.0), context())
    row, times = np.zeros(4, np.int32), np.array([49.9, 50.0, 70.0, 70.1])
    assert np.isfinite(sources.trajectories.position_ecef_m(row, times)[:, 0]).tolist() == [False, True, True, False]
    always = flare_sources(FlareConfig(at=HERE), context(duration_s=600.0)).trajectories
    assert always.ignition_s[0] < 0.0
    assert always.burnout_s[0] > 600.0


def test_a_bolide_flashes_on_its_way_down():
    config = BolideConfig(at=HERE, start_s=100.0, speed_m_s=18_000.0, descent_deg=30.0, heading_deg=90.0)
    sources = bolide_sources(config, context())
    times = np.array([100.0, 101.0, 102.0])
    place = ecef_to_geodetic(sources.trajectories.position_ecef_m(np.zeros(3, np.int32), times))
    assert place.height_m[1] == pytest.approx(80e3 - 9_000.0, abs=50.0)
    assert place.longitude_rad[1] > place.longitude_rad[0]
    assert np.degrees(place.latitude_rad[1]) == pytest.approx(10.0, abs=1e-3)
    shown = [float(intensity(sources, time_s=time)[0]) for time in times]
    assert shown[0] == pytest.approx(0.0, abs=1e-6 * shown[1])
    assert shown[1] == pytest.approx(100.0 * band_radiance(4500.0, 2.5, 3.0), rel=1e-12)
    assert shown[2] == pytest.approx(0.0, abs=1e-6 * shown[1])


class TestGlint:
    def sources(self, **settings):
        return glint_sources(GlintConfig(at=HERE, **settings), context())

    def mirror(self, sources):
        """Return the direction in which flat water mirrors the Sun, and the vertical."""
        place = sources.trajectories.start_ecef_m[0]
        up = local_axes(place)[2]
        sun = sun_position_ecef_m(np.datetime64(NOON_US, "us"), 100.0) - place
        sun /= np.linalg.norm(sun)
        return 2.0 * (up @ sun) * up - sun, up, sun

    def test_it_is_brightest_where_a_mirror_would_show_the_sun(self):
        sources = self.sources(wind_m_s=2.0)
        mirrored, up, _ = self.mirror(sources)
        peak = float(intensity(sources, to_sensor=mirrored)[0])
        aside = np.cross(mirrored, up) / np.linalg.norm(np.cross(mirrored, up))
        shown = [
            float(intensity(sources, to_sensor=np.cos(a) * mirrored + np.sin(a) * aside)[0]) for a in (0.1, 0.3, 0.6)
        ]
        assert peak > shown[0] > shown[1] > shown[2]
        assert self.tilt(sources, mirrored) == pytest.approx(0.0, abs=1e-7)

    def tilt(self, sources, to_sensor):
        return float(sources.signatures.aspect_rad(np.zeros(1, np.int32), np.array([100.0]), to_sensor[None])[0])

    def test_its_peak_is_cox_and_munks(self):
        sources = self.sources(wind_m_s=5.0, area_m2=1e4)
        mirrored, up, sun = self.mirror(sources)
        variance = 0.003 + 0.00512 * 5.0
        light = float(sunlight_w_m2(np.array(5772.0), SWIR))
        expected = 1e4 * light * reflectance(np.array(up @ sun), 1.33) / (4.0 * np.pi * variance)
        assert intensity(sources, to_sensor=mirrored) == pytest.approx(expected, rel=1e-9)

    def test_there_is_none_by_night(self):
        sources = glint_sources(GlintConfig(at=({"lat_deg": 10.0, "lon_deg": -170.0},)), context())
        assert intensity(sources).tolist() == [0.0]

    def test_sunlight_comes_down_through_the_scenes_air(self):
        bands = AtmosphereContext(bands=(SWIR, MWIR), path="atmosphere", seed=0)
        through = glint_sources(
            GlintConfig(at=HERE), context(make_atmosphere=lambda: lowtran_atmosphere(LowtranConfig(), bands))
        )
        shares = [float(intensity(through, band)[0] / intensity(self.sources(), band)[0]) for band in (0, 1)]
        assert 0.01 < shares[0] < 0.1
        assert 0.2 < shares[1] < 0.4

    @pytest.mark.parametrize("variance", [0.003, 0.03])
    def test_the_slopes_are_a_distribution(self, variance):
        """Facets of all tilts have the surface's own area between them: the density is one over the plane of slopes."""

        def ring(slope):
            tilt = np.arctan(slope)
            return 2.0 * np.pi * slope * float(slope_density(tilt, variance)) * np.cos(tilt) ** 4

        whole, _ = integrate.quad(ring, 0.0, 3.0)
        assert whole == pytest.approx(1.0, rel=1e-8)

    def test_mirrors_reflect_as_fresnel_says(self):
        assert reflectance(np.array(1.0), 1.33) == pytest.approx(((1.33 - 1.0) / (1.33 + 1.0)) ** 2)
        assert reflectance(np.array(0.0), 1.33) == pytest.approx(1.0)

    def test_the_suns_light_is_the_solar_constant(self):
        assert sunlight_w_m2(np.array(5772.0), Band("all", 0.01, 1e5)) == pytest.approx(1361.0, rel=1e-3)


class TestField:
    def test_places_are_uniform_over_the_region(self):
        sources = fire_sources(FireConfig(field=field(60.0)), context())
        where = ecef_to_geodetic(sources.trajectories.start_ecef_m)
        sines, longitudes = np.sin(where.latitude_rad), np.degrees(where.longitude_rad)
        low, high = np.sin(np.radians([-10.0, 20.0]))
        assert stats.kstest(sines, stats.uniform(low, high - low).cdf).pvalue > 1e-3
        assert stats.kstest(longitudes, stats.uniform(30.0, 30.0).cdf).pvalue > 1e-3

    def test_counts_are_poissons_with_the_stated_density(self):
        mean = 0.5 * 6.371007181**2 * np.radians(30.0) * (np.sin(np.radians(20.0)) + np.sin(np.radians(10.0)))
        counts = [len(fire_sources(FireConfig(field=field(0.5)), context(seed)).ids) for seed in range(400)]
        # 99.9 % of the mean of 400 counts, and of their variance over their mean.
        assert np.mean(counts) == pytest.approx(mean, abs=3.29 * np.sqrt(mean / 400))
        low, high = stats.chi2.ppf([0.0005, 0.9995], 399) / 399
        assert low < np.var(counts, ddof=1) / np.mean(counts) < high

    def test_areas_spread_as_stated(self):
        sources = flare_sources(FlareConfig(field=field(60.0, sigma=0.7)), context())
        logs = np.log([row["area_m2"] / 30.0 for row in sources.trajectories.truth()])
        assert stats.kstest(logs, stats.norm(0.0, 0.7).cdf).pvalue > 1e-3

    def test_brief_ones_begin_during_the_scene_at_the_rate_of_an_hour(self):
        sources = bolide_sources(BolideConfig(field=field(400.0)), context(duration_s=360.0))
        starts = sources.trajectories.ignition_s
        assert len(starts) == pytest.approx(0.1 * 400.0 * 11.04, abs=3.29 * np.sqrt(442.0))
        assert stats.kstest(starts, stats.uniform(0.0, 360.0).cdf).pvalue > 1e-3

    def test_a_region_may_cross_the_date_line(self):
        sources = fire_sources(FireConfig(field=field(20.0, region(-5.0, 5.0, 170.0, -170.0))), context())
        longitudes = np.array([row["lon_deg"] for row in sources.trajectories.truth()])
        assert len(longitudes) > 20
        assert (np.abs(longitudes) >= 170.0).all()
        assert (longitudes > 0.0).any()
        assert (longitudes < 0.0).any()

    def test_a_field_hangs_on_seed_and_id_alone(self):
        places = [
            fire_sources(FireConfig(field=field(1.0)), context(seed)).trajectories.start_ecef_m for seed in (1, 1, 2)
        ]
        assert places[0].tolist() == places[1].tolist()
        assert places[0].tolist() != places[2].tolist()

    def test_an_empty_field_is_empty(self):
        assert fire_sources(FireConfig(field=field(0.0)), context()).ids == ()

    def test_too_many_are_refused(self):
        with pytest.raises(ModelError, match=r"sources\[0\]: .* emitters are expected; a block has at most 20000"):
            fire_sources(FireConfig(field=field(1e6)), context())


class TestCsv:
    def read(self, tmp_path: Path, text: str, **settings):
        path = tmp_path / "fires.csv"
        path.write_text(text, encoding="utf-8")
        return fire_sources(FireConfig(csv=str(path), **settings), context())

    def test_columns_in_any_order_with_blanks_for_the_blocks_values(self, tmp_path):
        text = "# made up\narea_m2, lat_deg ,lon_deg\n10,1.5,-2\n\n,3,4e0\n"
        told = self.read(tmp_path, text, area_m2=7.0).trajectories.truth()
        assert [(row["lat_deg"], row["lon_deg"], row["area_m2"]) for row in told] == [
            (1.5, -2.0, 10.0),
            (3.0, 4.0, 7.0),
        ]

    def test_what_spreadsheets_write_is_read(self, tmp_path):
        """A mark of byte order before the header, and a comma after each line's last cell."""
        told = self.read(tmp_path, "\ufefflat_deg,lon_deg,\n1,2,\n").trajectories.truth()
        assert [(row["lat_deg"], row["lon_deg"]) for row in told] == [(1.0, 2.0)]

    @pytest.mark.parametrize(
        ("text", "complaint"),
        [
            ("", "line 1: a header with lat_deg and lon_deg is needed"),
            ("lat_deg,lon_deg\n1,2\n\n3,x\n", "line 4: lon_deg: 'x' is not a number"),
            ("lat_deg,lon_deg\n1,2,3\n", "line 2: 3 cells under a header of 2"),
            ("lat_deg,lon_deg\n91,2\n", "line 2: lat_deg: 91.0 is outside [-90, 90] deg"),
            ("lat_deg,lon_deg\n1,\n", "line 2: lon_deg is missing"),
            ("lat_deg,lon_deg,area_m2\n1,2,nan\n", "line 2: area_m2: nan is outside (0, 1000000000000] m2"),
            (
                "lat_deg,lon_deg,colour\n1,2,3\n",
                "line 1: in the header colour is not one of lat_deg, lon_deg, height_m, start_s, end_s, temperature_k,",
            ),
            ("lat_deg,lat_deg\n1,2\n", "line 1: a name stands twice in the header"),
            ("lat_deg,lon\n", "line 1: in the header lon: unknown; did you mean lon_deg?"),
            ("lat_deg,area_m2\n1,2\n", "line 1: in the header lon_deg is missing"),
            ("lat_deg;lon_deg\n1;2\n", "line 1: the header is one cell; commas separate cells"),
            ("lat_deg,lon_deg,area_m2\n1,2,1_000\n", "line 2: area_m2: '1_000' is not a number"),
            ("lat_deg,lon_deg,start_s,end_s\n1,2,50,10\n", "line 2: end_s 10 is not after start_s 50"),
            ("lat_deg,lon_deg,\n1,2,3\n", "line 2: '' is not one of lat_deg, lon_deg"),
        ],
    )
    def test_what_is_wrong_is_told_with_file_and_line(self, tmp_path, text, complaint):
        with pytest.raises(SceneError) as caught:
            self.read(tmp_path, text)
        (problem,) = caught.value.problems
        assert problem.path == "sources[0].csv"
        assert f"fires.csv, {complaint}" in problem.message
        assert "\n" not in problem.message

    def test_files_that_are_not_there_or_not_text(self, tmp_path):
        with pytest.raises(SceneError, match=r"sources\[0\].csv: .*none.csv cannot be read: No such file or directory"):
            fire_sources(FireConfig(csv=str(tmp_path / "none.csv")), context())
        path = tmp_path / "bytes.csv"
        path.write_bytes(b"lat_deg,lon_deg\n\xff\xfe,1\n")
        with pytest.raises(SceneError, match=r"bytes.csv cannot be read: 'utf-8' codec"):
            fire_sources(FireConfig(csv=str(path)), context())


def test_settings_that_do_not_go_together():
    with pytest.raises(ValueError, match="none of them is given; exactly one of at, csv and field is needed"):
        FireConfig()
    with pytest.raises(ValueError, match="at and csv are given"):
        FireConfig(at=HERE, csv="fires.csv")
    with pytest.raises(ValueError, match=r"at\[0\]: lon_deg is missing"):
        FireConfig(at=({"lat_deg": 1.0},))
    with pytest.raises(ValueError, match=r"at\[0\]: lat: unknown; did you mean lat_deg\?"):
        FireConfig(at=({"lat": 1.0, "lon_deg": 2.0},))
    with pytest.raises(ValueError, match=r"at\[1\]: end_s 5 is not after start_s 9"):
        FireConfig(at=({"lat_deg": 1.0, "lon_deg": 2.0}, {"lat_deg": 1.0, "lon_deg": 2.0, "end_s": 5.0}), start_s=9.0)
    with pytest.raises(ValueError, match="end_s 5 is not after start_s 9"):
        FireConfig(field=field(1.0), start_s=9.0, end_s=5.0)
    with pytest.raises(ValueError, match="south_deg 5 is not below north_deg 5"):
        region(5.0, 5.0)


def test_scenes_name_sources():
    scene = scene_from_mapping(
        {
            "scene": "hot",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": 60.0,
            "atmosphere": {"model": "lowtran", "cloud": {"cover": 0.3}, "bands": {"VIS": "SWIR"}},
            "background": "earth",
            "sensors": [{"model": "DSP", "id": "S", "orbital_slot_deg": 0.0}],
            "sources": [
                {"id": "a", "model": "fires", "at": [{"lat_deg": 1.0, "lon_deg": 2}]},
                {
                    "id": "b",
                    "model": "bolides",
                    "field": {
                        "region": {"south_deg": -1, "north_deg": 1, "west_deg": 0, "east_deg": 1},
                        "per_million_km2": 3,
                    },
                },
            ],
        },
        host=HOST,
    )
    assert [source.model.config.temperature_k for source in scene.sources] == [1000.0, 4500.0]
    assert scene_from_mapping(scene_mapping(scene), host=HOST) == scene


def test_a_geostationary_sensor_sees_a_fire_below_it():
    sources = fire_sources(FireConfig(at=HERE), context())
    place = sources.trajectories.start_ecef_m[0]
    away = geodetic_to_ecef(0.0, np.radians(20.0), 35_786e3) - place
    seen = intensity(sources, to_sensor=away / np.linalg.norm(away))
    assert 0.9 < seen[0] / intensity(sources)[0] < 1.0
