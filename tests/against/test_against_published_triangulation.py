"""The triangulation bound of the reference cases, and meeting points that reach it."""

import json

import numpy as np
import pytest
from opir_estimation import triangulated
from opir_estimation.triangulation import information
from repository import DATA

CASES = [
    case
    for case in json.loads((DATA / "reference_cases.json").read_text())["cases"]
    if case["topic"] == "triangulation_crlb"
]


def sensors_m(inputs):
    angle = np.radians(inputs["sat_lon_deg"])
    return inputs["sat_radius_m"] * np.stack(
        [np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1
    )


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["id"])
def test_the_bound(case):
    target = np.array(case["expected"]["target_ecef_m"])
    separation = target - sensors_m(case["inputs"])
    range_m = np.linalg.norm(separation, axis=1)
    sigma = np.array(case["inputs"]["sigma_rad_per_axis"])
    bound = np.linalg.inv(information(separation / range_m[:, None], range_m, sigma).sum(axis=0))
    expected = np.array(case["expected"]["cov_ecef_m2"])
    assert np.allclose(bound, expected, rtol=case["tol"], atol=case["tol"] * np.abs(expected).max())


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["id"])
def test_meeting_points_reach_the_bound(case):
    """The mean squared error of 4000 fixes is the bound's within 5 standard errors of a sum of
    squares.
    """
    rng = np.random.default_rng(7)
    runs = 4000
    origin = sensors_m(case["inputs"])
    target = np.array(case["expected"]["target_ecef_m"])
    sigma = np.array(case["inputs"]["sigma_rad_per_axis"])
    separation = target - origin
    truth = separation / np.linalg.norm(separation, axis=1)[:, None]
    error = rng.normal(size=(runs, *truth.shape)) * sigma[:, None]
    error -= np.sum(error * truth, axis=2)[:, :, None] * truth
    measured = truth + error
    measured /= np.linalg.norm(measured, axis=2)[:, :, None]
    group = np.repeat(np.arange(runs), len(origin))
    fix = triangulated(
        group, runs, np.tile(origin, (runs, 1)), measured.reshape(-1, 3), np.tile(sigma, runs)
    )
    rss = np.sqrt(np.mean(np.sum((fix.position_m - target) ** 2, axis=1)))
    assert rss == pytest.approx(case["expected"]["rss_m"], rel=5.0 / np.sqrt(2.0 * runs))
    assert fix.misfit.mean() == pytest.approx(2 * len(origin) - 3, rel=0.15)
