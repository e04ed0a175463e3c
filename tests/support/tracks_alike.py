"""Tracks of two runs that differ in nothing but numbers, times or longitudes."""

import numpy as np
from attrs import evolve, fields

from opir_core.plugin import Tracks

#: Columns of places: longitude_rad is the second number, the scene time the third.
POINTS = ("launch", "impact")

RADIUS_M = 6371e3


#: Columns of the forecast that follow from a few hundred draws of the state, whose axes are
#: inertial.
DRAWN = (
    "impact",
    "impact_covariance",
    "impact_sigmas",
    "impact_regions",
    "type_probability",
    "hypothesis_probability",
    "probability_missile",
    "probability_orbit",
    "probability_relights",
)

#: Differences by other draws of the same distribution, of which some 50 count: of means, in
#: standard deviations, of probabilities, in the mean of all rows, and number of rows in which one
#: has no impact.
DRAWN_SIGMAS = 3.0
DRAWN_SHARE = 0.15
FEW_ROWS = 10


def assert_alike(tracks, other, rtol=1e-9, apart=()):
    """Fail unless both have the same rows, whatever the numbers of their tracks.

    A number may differ by a share of the largest one of its column; the columns `apart` are not
    compared.
    """
    assert len(tracks) == len(other) > 0
    rows = renumbered_rows(tracks, other)
    for item in fields(Tracks):
        if item.name not in ("track", "impact_regions", *apart):
            close(getattr(other, item.name)[rows], getattr(tracks, item.name), rtol, item.name)
    for regions, reference_regions in zip(
        tracks.impact_regions, other.impact_regions[rows], strict=True
    ):
        if "impact_regions" not in apart:
            assert_same_regions(regions, reference_regions, rtol)


def assert_drawn_alike(tracks, other):
    """Fail unless forecasts (`DRAWN`) agree to within what other draws make of the same states."""
    other = other.take(renumbered_rows(tracks, other))
    one_known, other_known = (np.isfinite(run.impact).all(axis=1) for run in (tracks, other))
    rows = one_known & other_known
    assert np.count_nonzero(rows) > 10
    assert np.count_nonzero(one_known != other_known) <= FEW_ROWS
    separation = east_north_time(tracks.impact[rows], other.impact[rows])
    covariance = tracks.impact_covariance[rows] + other.impact_covariance[rows]
    assert mahalanobis(separation, covariance).max() < DRAWN_SIGMAS
    for name in DRAWN[4:]:
        off = np.abs(getattr(other, name) - getattr(tracks, name))
        assert off.mean() < DRAWN_SHARE, name


def assert_states_alike(tracks, other, sigmas):
    """Fail unless states differ by less than some standard deviations, and covariances by as large
    a share.
    """
    other = other.take(renumbered_rows(tracks, other))
    assert mahalanobis(other.state - tracks.state, tracks.state_covariance).max() < sigmas
    spread = [np.linalg.slogdet(run.state_covariance)[1] for run in (tracks, other)]
    assert np.abs(spread[1] - spread[0]).max() < sigmas


def east_north_time(points, others):
    """Return how far east and north, m, and later, s, other latitudes, longitudes and times (n, 3)
    are.
    """
    off = others - points
    turn = np.remainder(off[:, 1] + np.pi, 2.0 * np.pi) - np.pi
    return np.stack(
        [RADIUS_M * turn * np.cos(points[:, 0]), RADIUS_M * off[:, 0], off[:, 2]], axis=1
    )


def mahalanobis(error, covariance):
    """Return the lengths (n,) of errors (n, d) in standard deviations of covariances (n, d, d)."""
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    scaled = error / sigma
    correlation = covariance / sigma[:, :, None] / sigma[:, None]
    return np.sqrt(
        np.sum(scaled * np.linalg.solve(correlation, scaled[:, :, None])[:, :, 0], axis=1)
    )


def renumbered_rows(tracks, other):
    """Return the rows of the other tracks in the order of these: tracks are the same if they begin
    alike.
    """
    number = {}
    for track in np.unique(other.track).tolist():
        row = np.flatnonzero(other.track == track)[0]
        rows = np.flatnonzero(np.abs(tracks.tick_s - other.tick_s[row]) < 1e-6)
        separation = np.linalg.norm(tracks.state[rows, :3] - other.state[row, :3], axis=1)
        number[track] = int(tracks.track[rows[separation.argmin()]])
    assert len(set(number.values())) == len(number)
    return np.lexsort(([number[track] for track in other.track.tolist()], other.tick_s))


def assert_same_regions(regions, others, rtol):
    """Fail unless two tuples of regions have the same figures and corners."""
    assert len(regions) == len(others)
    for region, reference in zip(regions, others, strict=True):
        assert (region.condition, region.containment) == (
            reference.condition,
            reference.containment,
        )
        for name in ("area_km2", "probability", "effective_samples"):
            close(np.array(getattr(reference, name)), np.array(getattr(region, name)), rtol, name)
        for polygon, other_polygon in zip(region.polygons, reference.polygons, strict=True):
            for ring, other_ring in zip(polygon, other_polygon, strict=True):
                close(on_sphere(other_ring), on_sphere(ring), rtol, "polygons")


def on_sphere(ring):
    """Return unit vectors (n, 3) of latitudes and longitudes (n, 2), rad."""
    latitude, longitude = ring.T
    flat = np.cos(latitude)
    return np.stack([flat * np.cos(longitude), flat * np.sin(longitude), np.sin(latitude)], axis=1)


def close(value, expected, rtol, name):
    """Fail unless numbers are the same to a share of the largest one, and unknown where the others
    are.
    """
    value = np.asarray(value, dtype=np.float64)
    expected = np.asarray(expected, dtype=np.float64)
    scale = np.abs(expected[np.isfinite(expected)]).max(initial=0.0)
    np.testing.assert_allclose(value, expected, rtol=0.0, atol=rtol * scale, err_msg=name)


def moved(tracks, *, turn_rad=0.0, later_s=0.0):
    """Return tracks turned eastwards about the Earth's axis, and later in scene time."""
    cosine = np.cos(turn_rad)
    sine = np.sin(turn_rad)
    axis = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    state = np.kron(np.eye(2), axis)
    burnout = np.zeros((7, 7))
    burnout[:6, :6] = state
    burnout[6, 6] = 1.0
    columns = {name: moved_points(getattr(tracks, name), turn_rad, later_s) for name in POINTS}
    return evolve(
        tracks,
        tick_s=tracks.tick_s + later_s,
        available_s=tracks.available_s + later_s,
        state=tracks.state @ state.T,
        state_covariance=state @ tracks.state_covariance @ state.T,
        burnout=tracks.burnout @ burnout.T + np.array([0.0] * 6 + [later_s]),
        burnout_covariance=burnout @ tracks.burnout_covariance @ burnout.T,
        impact_regions=turned_regions(tracks.impact_regions, turn_rad),
        **columns,
    )


def moved_points(points, turn_rad, later_s):
    """Return latitudes, longitudes and times (n, 3), turned and later."""
    shifted = points + np.array([0.0, turn_rad, later_s])
    shifted[:, 1] = np.remainder(shifted[:, 1] + np.pi, 2.0 * np.pi) - np.pi
    return shifted


def turned_regions(column, turn_rad):
    """Return tuples of regions (n,) with their corners turned."""
    turned = np.empty(len(column), dtype=np.object_)
    shift = np.array([0.0, turn_rad])
    for row, regions in enumerate(column):
        turned[row] = tuple(
            evolve(
                region,
                polygons=tuple(
                    tuple(ring + shift for ring in polygon) for polygon in region.polygons
                ),
            )
            for region in regions
        )
    return turned
