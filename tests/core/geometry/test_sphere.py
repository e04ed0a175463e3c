"""The round Earth against geographiclib on a sphere."""

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic
from hypothesis import example, given, strategies as st

from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.geometry import AzimuthalEquidistant, great_circle_m, unit_vectors

SPHERE = Geodesic(EARTH_EQUATORIAL_RADIUS_M, 0.0)
places = st.tuples(st.floats(-np.pi / 2, np.pi / 2), st.floats(-np.pi, np.pi))


@given(places, places)
@example((0.5, 0.3), (-0.49999999, 0.3 - np.pi))
@example((0.5, 0.3), (-0.5, 0.3 - np.pi))
@example((np.pi / 2 - 1e-3, 0.3), (np.pi / 2 - 1e-9, 2.0))
def test_directions_and_distances_are_those_of_geographiclib(
    centre: tuple[float, float], place: tuple[float, float]
) -> None:
    line = SPHERE.Inverse(*np.degrees([*centre, *place]).tolist())
    assert great_circle_m(np.array([centre]), np.array([place]))[0] == pytest.approx(
        line["s12"], abs=1e-6
    )
    chart = AzimuthalEquidistant.about(unit_vectors(np.array([centre]))[0])
    east, north = chart.points(np.array([place]))[0].tolist()
    assert np.hypot(east, north) == pytest.approx(line["s12"], abs=1e-6)
    if 1.0 < line["s12"] < 2.0e7 and abs(centre[0]) < 1.57:
        turn = np.arctan2(east, north) - np.radians(line["azi1"])
        assert (
            abs(np.remainder(turn + np.pi, 2.0 * np.pi) - np.pi) * line["s12"]
            < 0.5 + 1e-6 * line["s12"]
        )


@given(places, places)
@example((np.pi / 2, 0.0), (-np.pi / 2, 0.0))
@example((0.0, 0.0), (0.0, np.pi))
@example((np.pi / 2 - 1e-3, 0.3), (np.pi / 2 - 1e-9, 2.0))
def test_places_are_found_again(centre: tuple[float, float], place: tuple[float, float]) -> None:
    chart = AzimuthalEquidistant.about(unit_vectors(np.array([centre]))[0])
    restored = chart.places(chart.points(np.array([place])))
    assert great_circle_m(restored, np.array([place]))[0] < 1e-5
    assert great_circle_m(np.array([chart.centre]), np.array([centre]))[0] < 1e-6
