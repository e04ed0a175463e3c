"""Radiometry against the reference cases (tests/data/reference_cases.json)."""

import json

import numpy as np
import pytest
from imager_pixels import intensities_w_sr, pixel_k
from opir_photons.radiometry.aperture import minimum_detectable_intensity
from opir_photons.radiometry.planck import (
    FIRST_RADIATION_W_UM4_M2_SR,
    SECOND_RADIATION_UM_K,
    band_radiance,
)
from opir_photons.radiometry.propellants import propellants
from repository import DATA

CASES = json.loads((DATA / "reference_cases.json").read_text(encoding="utf-8"))["cases"]


def case(name):
    return next(result for result in CASES if result["id"] == name)


def test_planck_band_radiance():
    planck = case("planck_band_radiance")
    assert planck["inputs"]["c1L_W_um4_m2_sr"] == pytest.approx(
        FIRST_RADIATION_W_UM4_M2_SR, rel=1e-14
    )
    assert planck["inputs"]["c2_um_K"] == pytest.approx(SECOND_RADIATION_UM_K, rel=1e-14)
    rows = planck["expected"]["rows"]
    assert len(rows) > 20
    result = band_radiance(
        *(np.array([row[key] for row in rows]) for key in ("T_K", "lo_um", "hi_um"))
    )
    np.testing.assert_allclose(result, [row["L_W_m2_sr"] for row in rows], rtol=planck["tol"])


def test_the_papers_minimum_detectable_intensity_in_both_units():
    inputs = case("seed_imin")["inputs"]
    expected = case("seed_imin")["expected"]
    rest = (inputs["R_km"] * 1e3, inputs["tau"], inputs["snr"])
    converted = minimum_detectable_intensity(1e4 * inputs["NEI_W_cm2"], *rest)
    assert converted == pytest.approx(expected["I_min_W_sr"], rel=1e-12)
    taken_as_w_m2 = minimum_detectable_intensity(inputs["NEI_W_cm2"], *rest)
    assert taken_as_w_m2 == pytest.approx(expected["I_min_if_cm2_not_converted"], rel=1e-12)


#: EchoStar 23 at 3.9 µm, 38 s after launch, 16 March 2017: what GOES-16 saw at most, over ground of
#: 278 to 293 K (CIMSS Satellite Blog, archives 23468), and what that means at the source, with what
#: a pixel may catch of the light.
SEEN_K = 306.8
GROUND_K = (278.0, 293.0)
AT_SOURCE_W_SR = (3.3e5, 13e5)
LOOKS = json.loads((DATA / "goes_sightings.json").read_text(encoding="utf-8"))["looks"]


def test_a_kerosene_launcher_in_the_window_is_as_bright_as_goes_16_saw_it():
    """The level follows from afterburning heat and soot, not from this observation; it is stated to
    a factor of 3.
    """
    spread = propellants()["kerosene"].spread
    bright = intensities_w_sr(LOOKS[0])["B07"]
    assert AT_SOURCE_W_SR[0] / spread <= bright <= AT_SOURCE_W_SR[1] * spread
    assert spread <= 3.0
    # In kelvins, with half of the light in the brightest pixel, over the middle of the ground's
    # temperatures.
    middle = sum(GROUND_K) / 2.0
    low, high = (
        pixel_k(LOOKS[0], "B07", 0.5, factor, middle)[1] for factor in (1.0 / spread, spread)
    )
    assert low <= SEEN_K <= high
    assert high - low < 60.0  # the interval says something: ground to fire is 300 K and more


def test_the_plume_of_before_was_outside_of_it():
    """The gases alone, which had all of the window: 13 to 54 times too dim, beyond any spread of
    theirs.
    """
    bright = intensities_w_sr({**LOOKS[0], "propellant": "storable"})["B07"]
    assert AT_SOURCE_W_SR[0] / bright > 3.0
