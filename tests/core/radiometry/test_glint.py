"""Glints: the slopes of wind, the reflectance of water, and the Sun in its mirror."""

import numpy as np
import pytest
from infrared_sources import HERE, MWIR, NOON_US, SWIR, context, intensity
from scipy import integrate

from opir_core.geometry import local_axes, sun_position_ecef_m
from opir_core.interfaces.radiometric_models import AtmosphereContext
from opir_core.radiometry.configs import LowtranConfig
from opir_core.radiometry.lowtran import lowtran_atmosphere
from opir_core.radiometry.source_configs import GlintConfig
from opir_core.radiometry.sources import glint_sources, reflectance, slope_density
from opir_core.radiometry.sunlight import solar_irradiance


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
        light = float(solar_irradiance(SWIR.lower_um, SWIR.upper_um))
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
        assert solar_irradiance(0.01, 1e5) == pytest.approx(1361.0, rel=1e-3)
