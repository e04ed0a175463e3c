"""The map of `opir import`: marks where the flight is, north up, also across the 180th meridian and
at a pole.
"""

from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def drawn(imported):
    """Return a function that returns the map of places, deg, 10 s from one to the next."""

    def lines(latitude_deg, longitude_deg):
        places = zip(latitude_deg, longitude_deg, strict=True)
        rows = [f"{10 * row},{lat!r},{lon!r},1e4" for row, (lat, lon) in enumerate(places)]
        Path("flight.csv").write_text("\n".join(["time_s,lat_deg,lon_deg,height_m", *rows]))
        answer = [line.removeprefix("  ") for line in imported("flight.csv").splitlines()]
        start = next(row for row, line in enumerate(answer) if line.startswith("+-"))
        return answer[start : start + 15]

    return lines


def places_of(lines, mark):
    return [(row, line.index(mark) - 1) for row, line in enumerate(lines[1:-2]) if mark in line]


def test_the_first_and_the_last_state_are_where_they_are(drawn):
    lines = drawn(np.linspace(10.0, 20.0, 50).tolist(), np.linspace(30.0, 45.0, 50).tolist())
    assert len({len(line) for line in lines[:-1]}) == 1
    ((low, west),), ((high, east),) = places_of(lines, "o"), places_of(lines, "x")
    assert low > high
    assert west < east
    assert lines[-1].startswith("24.56° E to 50.44° E, 10.00° N to 20.00° N; o first")


def test_a_map_goes_on_across_the_180th_meridian(drawn):
    east = np.linspace(170.0, 179.9, 20).tolist()
    lines = drawn([0.0] * 40, [*east, *(-angle for angle in reversed(east))])
    ((_, west),), ((_, east),) = places_of(lines, "o"), places_of(lines, "x")
    assert 0 <= west < 5
    assert east > 54
    assert lines[-1].startswith("170.00° E to 170.00° W")


@pytest.mark.parametrize("latitude", [[90.0, 90.0], [-90.0, -89.9], [0.0, 0.0]])
def test_points_and_poles_are_drawn(drawn, latitude):
    lines = drawn(latitude, [0.0, 0.0])
    assert len(places_of(lines, "o")) == 1


def test_states_are_in_the_rows_and_columns_of_their_places(drawn):
    """Twelve rows and 60 columns; a flight along the diagonal of a map that is as wide as the
    ground.
    """
    rows = np.arange(12)
    latitude = 10.0 + 0.5 * rows
    # As high as the map; in the middle of it, since it is narrower.
    lines = drawn(latitude.tolist(), [30.0] * 12)
    marks = sorted((row, column) for mark in ".ox" for row, column in places_of(lines, mark))
    assert [row for row, _ in marks] == list(range(12))
    assert len({column for _, column in marks}) == 1
    assert places_of(lines, "o")[0][0] == 11
    assert places_of(lines, "x")[0][0] == 0
    columns = np.arange(60)
    lines = drawn([0.0] * 60, (5.0 + 0.5 * columns).tolist())
    (middle,) = {row for row, line in enumerate(lines[1:-2]) if line.strip("|+- ")}
    assert lines[1 + middle] == f"|o{58 * '.'}x|"
    assert middle in (5, 6)
