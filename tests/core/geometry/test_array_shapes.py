"""Arrays in, arrays out: shapes, scalars, slices that change nothing, and nan instead of
warnings.
"""

from functools import partial

import numpy as np
import pytest
from lone_rows import assert_rows_independent

import opir_core.geometry as geometry
from opir_core.geometry import (
    ecef_to_eci,
    ecef_to_geodetic,
    gmst_rad,
    is_occluded,
    is_sunlit,
    julian_date,
    sun_position_ecef_m,
)

EPOCH = np.datetime64("2026-04-01T12:00:00")

#: The trailing shape of each argument of functions of arrays, by name; `None` is the epoch.
ARGUMENTS = {
    "azimuth_elevation_range": [(3,), (3,)],
    "azimuth_elevation_range_in_axes": [(3,), (3, 3)],
    "east_north_up_axes": [(), ()],
    "ecef_to_eci": [(3,), ()],
    "ecef_to_eci_state": [(3,), (3,), ()],
    "ecef_to_geodetic": [(3,)],
    "eci_to_ecef": [(3,), ()],
    "eci_to_ecef_state": [(3,), (3,), ()],
    "elevation_rad": [(3,), (3,)],
    "geodetic_to_ecef": [(), (), ()],
    "gmst_rad": [None, ()],
    "grazing_height_m": [(3,), (3,)],
    "intersection_with_ellipsoid": [(3,), (3,), ()],
    "is_occluded": [(3,), (3,), ()],
    "is_sunlit": [(3,), (3,)],
    "julian_date": [None, ()],
    "limb_angle_rad": [(3,), (3,)],
    "line_of_sight": [(3,), (), ()],
    "local_axes": [(3,)],
    "nadir_angle_rad": [(3,), (3,)],
    "sun_position_ecef_m": [None, ()],
    "sun_position_eci_m": [None, ()],
    "sun_position_of_date_m": [()],
    "sunlit_fraction": [(3,), (3,)],
}


def of_arrays(name):
    """Return a function of arrays alone, and the trailing shapes of its arguments."""
    function = getattr(geometry, name)
    if ARGUMENTS[name][0] is None:
        return partial(function, EPOCH), ARGUMENTS[name][1:]
    return function, ARGUMENTS[name]


every_function = pytest.mark.parametrize(
    ("function", "trailing"), [of_arrays(name) for name in ARGUMENTS], ids=list(ARGUMENTS)
)


def columns(result):
    return result if isinstance(result, tuple) else (result,)


def arguments(leading, trailing, seed=1):
    rng = np.random.default_rng(seed)
    scales = np.array([7e6, 9e6, 4e7, 3e8])
    return [
        rng.normal(size=(*leading, *shape)) * (rng.choice(scales) if shape == (3,) else 1.0)
        for shape in trailing
    ]


def test_every_public_function_is_tried_here():
    elsewhere = {"geodesic_direct", "geodesic_inverse", "great_circle_m", "unit_vectors"}
    # Of components, of crossings, and with a time as a number: their own tests try them.
    elsewhere |= {"angle_between_rad", "components", "dot", "length", "vector", "zero_crossings"}
    elsewhere |= {"shadow_margins_rad", "sun_ecef_m"}
    public = {name for name in geometry.__all__ if name[0].islower()}
    assert public == set(ARGUMENTS) | elsewhere


def test_public_names_are_sorted():
    assert geometry.__all__ == sorted(geometry.__all__)


@every_function
def test_any_slice_gives_the_same_bytes(function, trailing):
    """Lengths and offsets on both sides of every vector width, strided and reversed columns, single
    elements.
    """
    cuts = [
        slice(start, start + count)
        for start in (0, 1, 3, 8)
        for count in (1, 2, 3, 4, 7, 8, 9, 16, 33)
    ]
    rows = [*cuts, slice(None, None, 3), slice(None, None, -1), 0, 57, 202]
    assert_rows_independent(
        lambda *a: columns(function(*a)), *arguments((203,), trailing), rows=rows
    )


@every_function
def test_leading_axes_broadcast(function, trailing):
    values = [a[:, None] if number % 2 else a for number, a in enumerate(arguments((4,), trailing))]
    outer = columns(function(*values))
    spread = [np.broadcast_to(a, (4, 4, *shape)) for a, shape in zip(values, trailing, strict=True)]
    for result, full in zip(outer, columns(function(*spread)), strict=True):
        if len(trailing) > 1:
            assert result.shape == full.shape
        assert np.broadcast_to(result, full.shape).tobytes() == full.tobytes()


@every_function
def test_scalars_and_lists_serve_as_arrays(function, trailing):
    values = arguments((), trailing)
    for result, listed in zip(
        columns(function(*values)),
        columns(function(*(a.tolist() for a in map(np.asarray, values)))),
        strict=True,
    ):
        assert np.asarray(listed).tobytes() == np.asarray(result).tobytes()
        assert isinstance(result, np.generic) or result.ndim > 0


@every_function
def test_no_elements_give_no_elements(function, trailing):
    for result in columns(function(*arguments((0,), trailing))):
        assert result.shape[0] == 0


@every_function
@pytest.mark.parametrize("faulty", [np.nan, np.inf, -np.inf, 1e200, -1e308])
def test_what_is_not_finite_or_too_large_never_warns(function, trailing, faulty):
    """Warnings are errors in this suite. Each component of each argument in turn; the neighbour is
    unmoved.
    """
    clean = arguments((2,), trailing)
    results = columns(function(*clean))
    for number, shape in enumerate(trailing):
        for place in np.ndindex(*shape):
            spoilt = [a.copy() for a in clean]
            spoilt[number][(0, *place)] = faulty
            for result, unspoilt in zip(columns(function(*spoilt)), results, strict=True):
                assert result[1:].tobytes() == unspoilt[1:].tobytes()
                # Azimuth does not ask the upward axis, nor elevation which of the level ones is
                # north.
                if (
                    np.isnan(faulty)
                    and result.dtype == np.float64
                    and result.ndim == 1
                    and shape != (3, 3)
                ):
                    assert np.isnan(result[0])


@pytest.mark.parametrize("faulty", [np.nan, np.inf, -np.inf])
def test_booleans_of_what_is_not_finite_are_the_dark_ones(faulty):
    point = np.array([faulty, 7e6, 0.0])
    sun = np.array([1.5e11, 0.0, 0.0])
    assert is_occluded(point, [7e6, 0.0, 0.0])
    assert is_occluded([7e6, 0.0, 0.0], point)
    assert not is_sunlit([7e6, faulty, 0.0], sun)
    assert not is_sunlit([7e6, 0.0, 0.0], [1.5e11, faulty, 0.0])


def test_a_wrong_last_axis_is_refused_by_name():
    with pytest.raises(ValueError, match=r"last axis of 3 .*got shape \(2,\)"):
        ecef_to_geodetic([1.0, 2.0])
    with pytest.raises(ValueError, match="last axis of 3"):
        ecef_to_geodetic(6.4e6)


def test_not_a_time_has_no_angle():
    assert np.isnan(gmst_rad(np.datetime64("NaT", "s")))
    assert np.isnan(julian_date(np.datetime64("NaT", "s")))
    assert np.all(np.isnan(sun_position_ecef_m(np.datetime64("NaT", "s"))))


def test_epochs_broadcast_with_seconds():
    epochs = np.array(["2026-04-01", "1970-01-01", "2099-12-31"], dtype="datetime64[ns]")
    assert sun_position_ecef_m(epochs[:, None], [0.0, 1.0]).shape == (3, 2, 3)
    assert gmst_rad("2026-04-01T12:00:00", 0.0) == gmst_rad(EPOCH)
    later = gmst_rad("2026-04-01", 43200.0)
    assert later == gmst_rad(EPOCH)


def test_a_nanosecond_turns_the_earth():
    assert np.diff(gmst_rad(EPOCH, [0.0, 1e-9]))[0] == pytest.approx(7.3e-14, rel=0.02)
    moved = ecef_to_eci([6378137.0, 0.0, 0.0], [0.0, 1e-9])
    assert moved[1, 1] - moved[0, 1] == pytest.approx(4.651e-7, rel=1e-3)
