"""The ellipse of an estimated point against an eigensolver and against chance."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from opir_core.estimation import CONTAINMENT, containment_ellipse
from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_core.output.events.estimates import OTHER_CONTAINMENTS

CHI_SQUARE_95_TWO_DEGREES = (
    5.991464547107979  # Abramowitz and Stegun, table 26.8, more digits from -2 ln 0.05
)
SIGMA = st.floats(0.1, 1e6)


def covariance(sigma_along: float, sigma_across: float, bearing_rad: float) -> np.ndarray:
    along = np.array([np.sin(bearing_rad), np.cos(bearing_rad)])
    across = np.array([along[1], -along[0]])
    return sigma_along**2 * np.outer(along, along) + sigma_across**2 * np.outer(across, across)


@given(SIGMA, SIGMA, st.floats(-10.0, 10.0))
def test_axes_are_the_eigenvectors(first: float, second: float, bearing_rad: float) -> None:
    matrix = covariance(first, second, bearing_rad)
    major, minor, bearing = (float(axis[0]) for axis in containment_ellipse(matrix[np.newaxis]))
    small, large = np.sqrt(CHI_SQUARE_95_TWO_DEGREES * np.abs(np.linalg.eigvalsh(matrix)))
    assert major == pytest.approx(large, rel=1e-12)
    # An eigenvalue is known to rounding of the largest one.
    assert minor == pytest.approx(small, abs=large * 1e-7)
    assert 0.0 <= bearing < np.pi
    axis = np.array([np.sin(bearing), np.cos(bearing)])
    assert axis @ matrix @ axis * CHI_SQUARE_95_TWO_DEGREES == pytest.approx(large**2, rel=1e-9)


@pytest.mark.parametrize(
    ("bearing_deg", "expected_deg"), [(0.0, 0.0), (90.0, 90.0), (30.0, 30.0), (200.0, 20.0)]
)
def test_bearing_is_clockwise_from_north(bearing_deg: float, expected_deg: float) -> None:
    ellipse = containment_ellipse(covariance(2.0, 1.0, np.radians(bearing_deg))[np.newaxis])
    assert np.degrees(ellipse.bearing_rad[0]) % 180.0 == pytest.approx(expected_deg, abs=1e-9)


@pytest.mark.parametrize("share", [CONTAINMENT, *OTHER_CONTAINMENTS])
def test_the_ellipse_holds_its_share_of_points(share: float) -> None:
    matrix = covariance(3000.0, 400.0, 0.7)
    draws = np.random.default_rng(5).multivariate_normal([0.0, 0.0], matrix, size=200_000)
    major, minor, bearing = (
        float(axis[0]) for axis in containment_ellipse(matrix[np.newaxis], share)
    )
    along = draws @ [np.sin(bearing), np.cos(bearing)]
    across = draws @ [np.cos(bearing), -np.sin(bearing)]
    held = np.mean((along / major) ** 2 + (across / minor) ** 2 <= 1.0)
    assert held == pytest.approx(share, abs=4 * np.sqrt(share * (1.0 - share) / 200_000))


def test_radii_that_a_tracker_tells_are_those_of_the_ellipse() -> None:
    matrix = np.tile(covariance(2.0, 1.0, 0.3), (3, 1, 1))
    reported = np.array([[0.7, 1.6, 2.9], [np.nan] * 3, [np.inf] * 3])
    for column, share in enumerate(TRACK_CONTAINMENTS):
        usual = containment_ellipse(matrix, share)
        ellipse = containment_ellipse(matrix, share, reported)
        assert ellipse.semi_major_m == pytest.approx(
            [2.0 * reported[0, column], *usual.semi_major_m[1:]]
        )
        assert ellipse.semi_minor_m == pytest.approx([reported[0, column], *usual.semi_minor_m[1:]])
        assert ellipse.bearing_rad == pytest.approx(usual.bearing_rad)


@pytest.mark.parametrize(
    "unlawful",
    [
        [[np.nan, 0.0], [0.0, 1.0]],
        [[np.inf, 0.0], [0.0, 1.0]],
        [[-1.0, 0.0], [0.0, 1.0]],
        [[1.0, 2.0], [2.0, 1.0]],
        [[1e300, 0.0], [0.0, 1e300]],
    ],
)
def test_what_is_no_covariance_has_no_ellipse(unlawful: list[list[float]]) -> None:
    ellipse = containment_ellipse(np.array([unlawful, np.eye(2)]))
    assert np.isnan([axis[0] for axis in ellipse]).all()
    assert np.isfinite([axis[1] for axis in ellipse]).all()


def test_a_point_known_for_certain_has_an_ellipse_without_extent() -> None:
    ellipse = containment_ellipse(np.zeros((1, 2, 2)))
    assert (ellipse.semi_major_m[0], ellipse.semi_minor_m[0]) == (0.0, 0.0)
    assert 0.0 <= ellipse.bearing_rad[0] < np.pi


def test_a_point_known_along_a_line_has_a_flat_ellipse() -> None:
    ellipse = containment_ellipse(np.array([[[1.0, 1.0], [1.0, 1.0]]]))
    assert ellipse.semi_minor_m[0] == 0.0
    assert np.degrees(ellipse.bearing_rad[0]) == pytest.approx(45.0)
