"""Radiometry against the reference cases (tests/data/reference_cases.json)."""

import json

import numpy as np
import pytest
from opir_photons.radiometry.aperture import W_M2_PER_W_CM2, minimum_detectable_intensity
from opir_photons.radiometry.planck import FIRST_RADIATION_W_UM4_M2_SR, SECOND_RADIATION_UM_K, band_radiance
from repository import DATA

CASES = json.loads((DATA / "reference_cases.json").read_text(encoding="utf-8"))["cases"]


def case(name):
    return next(found for found in CASES if found["id"] == name)


def test_planck_band_radiance():
    planck = case("planck_band_radiance")
    assert planck["inputs"]["c1L_W_um4_m2_sr"] == pytest.approx(FIRST_RADIATION_W_UM4_M2_SR, rel=1e-14)
    assert planck["inputs"]["c2_um_K"] == pytest.approx(SECOND_RADIATION_UM_K, rel=1e-14)
    rows = planck["expected"]["rows"]
    assert len(rows) > 20
    ours = band_radiance(*(np.array([row[key] for row in rows]) for key in ("T_K", "lo_um", "hi_um")))
    np.testing.assert_allclose(ours, [row["L_W_m2_sr"] for row in rows], rtol=planck["tol"])


def test_the_papers_minimum_detectable_intensity_in_both_units():
    given, expected = case("seed_imin")["inputs"], case("seed_imin")["expected"]
    rest = (given["R_km"] * 1e3, given["tau"], given["snr"])
    converted = minimum_detectable_intensity(given["NEI_W_cm2"] * W_M2_PER_W_CM2, *rest)
    assert converted == pytest.approx(expected["I_min_W_sr"], rel=1e-12)
    taken_as_w_m2 = minimum_detectable_intensity(given["NEI_W_cm2"], *rest)
    assert taken_as_w_m2 == pytest.approx(expected["I_min_if_cm2_not_converted"], rel=1e-12)
