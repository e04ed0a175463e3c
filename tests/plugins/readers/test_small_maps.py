"""The map of `opir import`: marks where the flight is, north up, also across the 180th meridian and
at a pole.
"""

import numpy as np
import pytest
from opir_readers.small_map import map_lines

from opir_core.geometry import geodetic_to_ecef


def drawn(latitude_deg, longitude_deg):
    place = geodetic_to_ecef(
        *np.radians([latitude_deg, longitude_deg]), np.full(len(latitude_deg), 1e4)
    )
    return map_lines(place)


def places_of(lines, mark):
    return [(row, line.index(mark) - 1) for row, line in enumerate(lines[1:-2]) if mark in line]


def test_the_first_and_the_last_state_are_where_they_are():
    lines = drawn(np.linspace(10.0, 20.0, 50), np.linspace(30.0, 45.0, 50))
    assert len({len(line) for line in lines[:-1]}) == 1
    ((low, west),), ((high, east),) = places_of(lines, "o"), places_of(lines, "x")
    assert low > high
    assert west < east
    assert lines[-1].startswith("24.56° E to 50.44° E, 10.00° N to 20.00° N; o first")


def test_a_map_goes_on_across_the_180th_meridian():
    lines = drawn(
        np.zeros(40),
        np.concatenate([np.linspace(170.0, 179.9, 20), np.linspace(-179.9, -170.0, 20)]),
    )
    ((_, west),), ((_, east),) = places_of(lines, "o"), places_of(lines, "x")
    assert 0 <= west < 5
    assert east > 54
    assert lines[-1].startswith("170.00° E to 170.00° W")


@pytest.mark.parametrize("latitude", [[90.0, 90.0], [-90.0, -89.9], [0.0, 0.0]])
def test_points_and_poles_are_drawn(latitude):
    lines = drawn(np.array(latitude), np.array([0.0, 0.0]))
    assert len(places_of(lines, "o")) == 1


def test_states_are_in_the_rows_and_columns_of_their_places():
    """Twelve rows and 60 columns; a flight along the diagonal of a map that is as wide as the
    ground.
    """
    rows = np.arange(12)
    latitude = 10.0 + 0.5 * rows
    # As high as the map; in the middle of it, since it is narrower.
    lines = drawn(latitude, np.full(12, 30.0))
    marks = sorted((row, column) for mark in ".ox" for row, column in places_of(lines, mark))
    assert [row for row, _ in marks] == list(range(12))
    assert len({column for _, column in marks}) == 1
    assert places_of(lines, "o")[0][0] == 11
    assert places_of(lines, "x")[0][0] == 0
    columns = np.arange(60)
    lines = drawn(np.full(60, 0.0), 5.0 + 0.5 * columns)
    (middle,) = {row for row, line in enumerate(lines[1:-2]) if line.strip("|+- ")}
    assert lines[1 + middle] == f"|o{58 * '.'}x|"
    assert middle in (5, 6)
