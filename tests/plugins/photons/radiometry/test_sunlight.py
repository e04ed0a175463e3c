"""Sunlight: the solar constant, and the phase law of a diffuse sphere against facets that are
summed one by one.
"""

import numpy as np
import pytest
from opir_photons.radiometry import (
    lambert_phase,
    lambert_sphere_intensity,
    planck_radiance,
    solar_irradiance,
)
from scipy import integrate


def test_the_solar_constant_is_that_of_the_iau():
    """IAU 2015 resolution B3: 1361 W/m², with the nominal temperature and radius of the Sun."""
    assert float(solar_irradiance(0.01, 1e5)) == pytest.approx(1361.0, abs=0.5)


@pytest.mark.parametrize(("lower_um", "upper_um"), [(2.5, 3.0), (4.0, 5.0), (8.0, 12.0)])
def test_sunlight_is_radiance_times_solid_angle(lower_um, upper_um):
    radiance = integrate.quad(lambda at: float(planck_radiance(5772.0, at)), lower_um, upper_um)[0]
    solid_angle = 2.0 * np.pi * (1.0 - np.sqrt(1.0 - (6.957e8 / 149597870700.0) ** 2))
    assert float(solar_irradiance(lower_um, upper_um)) == pytest.approx(
        radiance * solid_angle, rel=2e-5
    )


def test_the_phase_law_at_full_half_and_new():
    assert lambert_phase([0.0, np.pi / 2.0, np.pi]) == pytest.approx(
        [1.0, 1.0 / np.pi, 0.0], abs=1e-15
    )


def test_spheres_reflect_albedo_times_their_light():
    intensity = integrate.quad(
        lambda phase: (
            2.0 * np.pi * np.sin(phase) * float(lambert_sphere_intensity(3.0, 0.4 * 5.0, phase))
        ),
        0.0,
        np.pi,
    )[0]
    assert intensity == pytest.approx(3.0 * 0.4 * 5.0, rel=1e-9)


@pytest.mark.parametrize("phase", [0.0, 0.4, np.pi / 2.0, 2.2, 3.0])
def test_a_sphere_of_facets_reflects_as_much(phase):
    """Each facet reflects albedo/π times the light that falls on it, as wide as the sensor sees
    it.
    """
    cosine, turn = np.meshgrid(
        (np.arange(1200) + 0.5) / 600.0 - 1.0,
        (np.arange(1200) + 0.5) / 1200.0 * 2.0 * np.pi,
        indexing="ij",
    )
    sine = np.sqrt(1.0 - cosine**2)
    normal = np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=-1)
    sun = np.array([0.0, 0.0, 1.0])
    sensor = np.array([np.sin(phase), 0.0, np.cos(phase)])
    facets = np.maximum(normal @ sun, 0.0) * np.maximum(normal @ sensor, 0.0)
    radius = 1.7
    albedo = 0.3
    light = 22.0
    summed = albedo / np.pi * light * radius**2 * facets.mean() * 4.0 * np.pi
    result = float(lambert_sphere_intensity(light, albedo * np.pi * radius**2, phase))
    assert result == pytest.approx(summed, rel=2e-5, abs=1e-6 * light)
