"""Glints: the slopes of wind, the reflectance of water, and the Sun in its mirror."""

import numpy as np
import pytest
from infrared_sources import HERE, MWIR, NOON_US, SWIR, context, intensity
from opir_photons.radiometry import solar_irradiance
from opir_photons.radiometry.configs import EarthConfig, LowtranConfig
from opir_photons.radiometry.earth import earth_background
from opir_photons.radiometry.lowtran import lowtran_atmosphere
from opir_photons.radiometry.sea_surface import SeaGlint, reflectance, slope_density, slope_variance
from opir_photons.radiometry.source_configs import GlintConfig
from opir_photons.radiometry.sources import glint_sources
from opir_photons.radiometry.viewing import views
from scipy import integrate

from opir_core.geometry import geodetic_to_ecef, local_axes, sun_position_ecef_m
from opir_core.plugin import AtmosphereContext, BackgroundContext, Band, Paths, Transmittance, Views


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
            float(intensity(sources, to_sensor=np.cos(a) * mirrored + np.sin(a) * aside)[0])
            for a in (0.1, 0.3, 0.6)
        ]
        assert peak > shown[0] > shown[1] > shown[2]
        assert self.tilt(sources, mirrored) == pytest.approx(0.0, abs=1e-7)

    def tilt(self, sources, to_sensor):
        return float(
            sources.signatures.aspect_rad(
                np.zeros(1, np.int32), np.array([100.0]), to_sensor[None]
            )[0]
        )

    def test_its_peak_is_cox_and_munks(self):
        sources = self.sources(wind_m_s=5.0, area_m2=1e4)
        mirrored, up, sun = self.mirror(sources)
        variance = 0.003 + 0.00512 * 5.0
        light = float(solar_irradiance(SWIR.lower_um, SWIR.upper_um))
        expected = 1e4 * light * reflectance(np.array(up @ sun), 1.33) / (4.0 * np.pi * variance)
        assert intensity(sources, to_sensor=mirrored) == pytest.approx(expected, rel=1e-9)

    @pytest.mark.parametrize("wind_m_s", [-0.1, 30.1])
    def test_winds_are_none_to_a_storm(self, wind_m_s):
        with pytest.raises(ValueError, match=rf"{wind_m_s} is outside \[0, 30\] m/s"):
            GlintConfig(at=HERE, wind_m_s=wind_m_s)
        assert [GlintConfig(at=HERE, wind_m_s=end).wind_m_s for end in (0.0, 30.0)] == [0.0, 30.0]

    def test_there_is_none_by_night(self):
        sources = glint_sources(GlintConfig(at=({"lat_deg": 10.0, "lon_deg": -170.0},)), context())
        assert intensity(sources).tolist() == [0.0]

    def test_sunlight_comes_down_through_the_scenes_air(self):
        bands = AtmosphereContext(bands=(SWIR, MWIR), path="atmosphere", seed=0)
        through = glint_sources(
            GlintConfig(at=HERE),
            context(make_atmosphere=lambda: lowtran_atmosphere(LowtranConfig(), bands)),
        )
        shares = [
            float(intensity(through, band)[0] / intensity(self.sources(), band)[0])
            for band in (0, 1)
        ]
        assert 0.01 < shares[0] < 0.1
        assert 0.2 < shares[1] < 0.4

    @pytest.mark.parametrize("variance", [0.003, 0.03])
    def test_the_slopes_are_a_distribution(self, variance):
        """Facets of all tilts have the surface's own area between them: the density is one over the
        plane of slopes.
        """

        def ring(slope):
            tilt = np.arctan(slope)
            return 2.0 * np.pi * slope * float(slope_density(tilt, variance)) * np.cos(tilt) ** 4

        total, _ = integrate.quad(ring, 0.0, 3.0)
        assert total == pytest.approx(1.0, rel=1e-8)

    def test_mirrors_reflect_as_fresnel_says(self):
        assert reflectance(np.array(1.0), 1.33) == pytest.approx(((1.33 - 1.0) / (1.33 + 1.0)) ** 2)
        assert reflectance(np.array(0.0), 1.33) == pytest.approx(1.0)

    def test_the_suns_light_is_the_solar_constant(self):
        assert solar_irradiance(0.01, 1e5) == pytest.approx(1361.0, rel=1e-3)


EPOCH = np.datetime64(NOON_US, "us")
WINDOW = Band("MWIRW_3.5_4.0", 3.5, 4.0)


class ClearSky(Transmittance):
    """An atmosphere without air."""

    def transmittance(self, band, path):
        return np.ones(len(path))

    def cloud_top_m(self, point_ecef_m):
        return np.full(len(point_ecef_m), -np.inf)


def glint_of(wind_m_s=5.0, bands=(WINDOW,), sky=None):
    return SeaGlint.of(bands, wind_m_s, sky or ClearSky(), NOON_US)


def seen(latitude_deg, longitude_deg, to_sensor):
    """Views of points on the Earth from unit vectors (n, 3), at noon."""
    point = geodetic_to_ecef(
        np.radians(latitude_deg), np.radians(longitude_deg), np.zeros(len(to_sensor))
    )
    up = local_axes(point)[:, 2]
    sun = sun_position_ecef_m(EPOCH, np.zeros(len(to_sensor))) - point
    sun /= np.linalg.norm(sun, axis=1)[:, None]
    sines = np.sum(up * to_sensor, axis=1), np.sum(up * sun, axis=1)
    return (
        Views(np.zeros(len(to_sensor)), *sines, point, np.zeros(len(to_sensor)), -to_sensor),
        up,
        sun,
    )


class TestSeaGlint:
    def mirrored(self, longitude_deg=20.0):
        _, up, sun = seen(np.array([10.0]), np.array([longitude_deg]), np.array([[1.0, 0.0, 0.0]]))
        return 2.0 * np.sum(up * sun) * up - sun, up, sun

    def test_in_the_mirror_direction_it_is_that_of_a_glint_source(self):
        """Radiance times area as the sensor sees it is the intensity of the same water as a
        source.
        """
        mirror, up, _ = self.mirrored()
        view, _, _ = seen(np.array([10.0]), np.array([20.0]), mirror)
        sources = glint_sources(GlintConfig(at=HERE, wind_m_s=5.0, area_m2=1e4), context())
        expected = intensity(sources, 0, 0.0, mirror[0])
        result = (
            glint_of(bands=(SWIR,)).radiances_w_m2_sr((0,), view)[0] * 1e4 * np.sum(up * mirror)
        )
        assert result == pytest.approx(expected, rel=1e-6)

    @pytest.mark.slow
    @pytest.mark.parametrize("away", [0.0, 0.15, 0.4])
    def test_it_is_what_random_facets_mirror(self, away):
        """Monte Carlo: facets of normal slopes, the light each mirrors, counted in a cone about the
        sensor.
        """
        mirror, up, sun = (column[0] for column in self.mirrored())
        side = np.cross(mirror, up) / np.linalg.norm(np.cross(mirror, up))
        to_sensor = np.cos(away) * mirror + np.sin(away) * side
        rng = np.random.default_rng(3)
        count = 2_000_000
        variance = 0.003 + 0.00512 * 5.0
        cone = 0.03
        slopes = rng.normal(size=(count, 2)) * np.sqrt(variance / 2.0)
        east, north, _ = local_axes(geodetic_to_ecef(np.radians(10.0), np.radians(20.0), 0.0))
        facet = up - slopes[:, :1] * east - slopes[:, 1:] * north
        # A facet's own area over its area on the map is its length here; the light on it goes by
        # its tilt to the Sun.
        met = facet @ sun
        normal = facet / np.linalg.norm(facet, axis=1)[:, None]
        cosine = normal @ sun
        out = 2.0 * cosine[:, None] * normal - sun
        hit = (out @ to_sensor > np.cos(cone)) & (cosine > 0.0)
        weight = met[hit] * fresnel(cosine[hit])
        solid_angle = 2.0 * np.pi * (1.0 - np.cos(cone))
        expected = weight.sum() / count / solid_angle / (up @ to_sensor)
        sigma = np.sqrt(np.square(weight).sum()) / count / solid_angle / (up @ to_sensor)
        view, _, _ = seen(np.array([10.0]), np.array([20.0]), to_sensor[None])
        light = float(solar_irradiance(WINDOW.lower_um, WINDOW.upper_um))
        result = float(glint_of().radiances_w_m2_sr((0,), view)[0, 0]) / light
        # The cone averages over its width: the density bends by less than 2 % over it.
        assert result == pytest.approx(expected, abs=4.0 * sigma + 0.02 * expected)

    def test_no_glint_is_brighter_than_the_suns_mirror_image(self):
        rng = np.random.default_rng(5)
        to_sensor = rng.normal(size=(5000, 3))
        to_sensor /= np.linalg.norm(to_sensor, axis=1)[:, None]
        view, _, _ = seen(rng.uniform(-80, 80, 5000), rng.uniform(-180, 180, 5000), to_sensor)
        result = glint_of(0.0).radiances_w_m2_sr((0,), view)[0]
        image = float(solar_irradiance(3.5, 4.0)) / (np.pi * (6.957e8 / 149597870700.0) ** 2)
        assert np.all((result >= 0.0) & (result <= image))
        assert np.count_nonzero(result) > 500

    def test_there_is_none_by_night_nor_below_the_horizon(self):
        view, _, _ = seen(
            np.array([10.0, 10.0]), np.array([-170.0, 20.0]), np.array([[-1.0, 0.0, 0.0]] * 2)
        )
        assert view.sun_elevation_sine[0] < 0.0 < view.sun_elevation_sine[1]
        assert view.elevation_sine[1] < 0.0 < view.elevation_sine[0]
        assert glint_of().radiances_w_m2_sr((0,), view).tolist() == [[0.0, 0.0]]

    def test_light_passes_the_air_twice(self):
        mirror, _, _ = self.mirrored()
        view, _, _ = seen(np.array([10.0]), np.array([20.0]), mirror)
        bands = AtmosphereContext(bands=(WINDOW, SWIR), path="atmosphere", seed=0)
        sky = lowtran_atmosphere(LowtranConfig(), bands)
        ways = [
            Paths(
                np.zeros(1), sine, view.point_ecef_m, view.point_ecef_m + 1e8 * mirror, np.zeros(1)
            )
            for sine in (view.sun_elevation_sine, view.elevation_sine)
        ]
        for band, least, most in ((0, 0.3, 0.9), (1, 1e-5, 0.1)):
            plain = glint_of(bands=(WINDOW, SWIR)).radiances_w_m2_sr((band,), view)
            share = float(
                (glint_of(bands=(WINDOW, SWIR), sky=sky).radiances_w_m2_sr((band,), view) / plain)[
                    0, 0
                ]
            )
            assert share == pytest.approx(
                float(np.prod([sky.transmittance(band, way) for way in ways])), rel=1e-9
            )
            assert least < share < most

    def test_wind_spreads_it(self):
        mirror, up, _ = self.mirrored()
        side = np.cross(mirror, up) / np.linalg.norm(np.cross(mirror, up))
        both = np.concatenate([mirror, np.cos(0.5) * mirror + np.sin(0.5) * side])
        view, _, _ = seen(np.full(2, 10.0), np.full(2, 20.0), both)
        calm, rough = (glint_of(wind).radiances_w_m2_sr((0,), view)[0] for wind in (1.0, 10.0))
        assert calm[0] > rough[0] > rough[1] > calm[1]
        assert slope_variance(10.0) == pytest.approx(0.0542)


def fresnel(cosine, index=1.33):
    """Reflectance of unpolarised light, by the angles of Snell's law."""
    one = np.arccos(cosine)
    other = np.arcsin(np.sin(one) / index)
    across = np.sin(one - other) / np.sin(one + other)
    along = np.tan(one - other) / np.tan(one + other)
    return 0.5 * (across**2 + along**2)


def test_sea_glint_adds_to_clear_sky_only():
    context_ = BackgroundContext(
        bands=(WINDOW,), path="background", epoch_us=NOON_US, make_atmosphere=ClearSky
    )
    dry, wet = (earth_background(EarthConfig(sea_wind_m_s=wind), context_) for wind in (None, 5.0))
    sensor = geodetic_to_ecef(np.zeros(400), np.zeros(400), np.full(400, 35_786e3))
    rng = np.random.default_rng(7)
    aim = geodetic_to_ecef(rng.uniform(-1.3, 1.3, 400), rng.uniform(-1.3, 1.3, 400), np.zeros(400))
    view = views(sensor, aim - sensor, rng.uniform(0.0, 86400.0, 400), NOON_US)
    added = wet.radiance_w_m2_sr(0, view) - dry.radiance_w_m2_sr(0, view)
    assert added == pytest.approx(glint_of().radiances_w_m2_sr((0,), view)[0], rel=1e-9, abs=1e-12)
    assert np.count_nonzero(added > 0.1) > 5
    with pytest.raises(ValueError, match="sea_wind_m_s goes with sky: clear alone"):
        EarthConfig(sea_wind_m_s=5.0, sky="std_cirrus")
