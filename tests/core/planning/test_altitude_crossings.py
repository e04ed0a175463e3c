"""When targets rise through altitudes: against closed forms, and against dense scans of their
heights.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from attrs import frozen
from numpy.typing import NDArray
from opir_photons.environment import Ascents, ascents

import opir_core as opir
from opir_core.geometry import ecef_to_geodetic
from opir_core.planning import Targets

Array = NDArray[np.float64]

#: Parts of a burn between samples of height; errors of crossings, as shares of such a part: in the
#: first and in others.
STEPS = 48
FIRST_STEP = 0.075
LATER_STEPS = 1e-3

#: Times of a dense scan of one burn.
DENSE = 100_001

LAUNCHES = [
    ("ICBM", -50.0, -110.0),
    ("IRBM", -28.0, -170.0),
    ("MRBM", -7.0, -155.0),
    ("SRBM", 3.0, -148.0),
]


@frozen(eq=False)
class Climbs:
    """Trajectories straight up from the equator: heights are functions of the time since
    ignition.
    """

    height_m: tuple[Callable[[Array], Array], ...]
    ignition_s: Array

    def position_ecef_m(self, target: Any, time_s: Array) -> Array:
        position = np.zeros((len(target), 3))
        for row, height_m in enumerate(self.height_m):
            is_target = target == row
            position[is_target, 0] = 6378137.0 + height_m(time_s[is_target] - self.ignition_s[row])
        return position


def climbing(burn_s: list[float], *heights_m: Callable[[Array], Array]) -> Ascents:
    """Return the ascents of targets that climb as given, the k-th of which ignites at 10 k + 1
    s.
    """
    count = len(heights_m)
    ignition_s = 10.0 * np.arange(len(heights_m)) + 1.0
    burnout_s = ignition_s + np.array(burn_s)
    numbers = np.arange(count, dtype=np.int32)
    nothing = np.zeros(count, dtype=np.int32)
    ids = tuple(map(str, range(count)))
    courses = (Climbs(heights_m, ignition_s),)
    code = np.zeros(count, dtype=np.uint8)
    return ascents(Targets(ids, code, ignition_s, burnout_s, burnout_s, courses, nothing, numbers))


def test_crossings_of_constant_accelerations_are_square_roots() -> None:
    burn_s = [90.0, 170.0]
    accelerations = np.array([2e-3, 25.0])
    rising = climbing(burn_s, lambda t: 1e-3 * t * t, lambda t: 12.5 * t * t)
    rng = np.random.default_rng(4)
    share = rng.uniform(0.0, 1.0, (2, 400))
    exact_s = share * np.array(burn_s)[:, None]
    since_s = rising.times_s(0.5 * accelerations[:, None] * exact_s**2) - np.array([[1.0], [11.0]])
    off = np.abs(since_s - exact_s) / np.array(burn_s)[:, None] * STEPS
    assert np.all(off <= np.where(share < 1.0 / STEPS, FIRST_STEP, LATER_STEPS))


def test_constant_climbs_cross_levels_in_their_range_only() -> None:
    rising = climbing([48.0, 96.0], lambda t: 1000.0 + 250.0 * t, lambda t: 500.0 * t)
    times_s = rising.times_s(
        np.array([[999.9, 1000.5, 6789.0, 13_000.0, 13_000.5], [-1.0, 1.0, 250.0, 47_999.0, 1e6]])
    )
    exact_s = [
        [np.nan, 1.002, 1.0 + 5789.0 / 250.0, 49.0, np.nan],
        [np.nan, 11.002, 11.5, 11.0 + 47_999.0 / 500.0, np.nan],
    ]
    assert np.allclose(times_s, exact_s, rtol=0.0, atol=1e-6, equal_nan=True)


def test_a_start_at_a_level_is_no_crossing() -> None:
    rising = climbing([48.0, 96.0], lambda t: 1000.0 + 250.0 * t, lambda t: 500.0 * t)
    assert np.isnan(rising.times_s(rising.height_m[:, :1])).all()


def test_the_first_rise_counts_and_falls_do_not() -> None:
    # Heights from 20 km: down, up through the level at three quarters of each period, down again.
    rising = climbing([60.0], lambda t: 20e3 - 5e3 * np.sin(2.0 * np.pi * t / 30.0))
    times_s = rising.times_s(np.array([[20e3 + 1.0, 22.5e3, 17.5e3]]))
    sine = np.arcsin(np.array([1.0 / 5e3, 0.5, -0.5]))
    assert times_s[0] - 1.0 == pytest.approx(15.0 + sine * 30.0 / (2.0 * np.pi), abs=1e-3)


@pytest.fixture(scope="module")
def launched() -> Targets:
    targets = [
        {
            "id": name,
            "type": name,
            "launch": {"lat_deg": 5.0, "lon_deg": -150.0, "time_s": 2.0 + number},
            "aim": {"lat_deg": latitude, "lon_deg": longitude},
        }
        for number, (name, latitude, longitude) in enumerate(LAUNCHES)
    ]
    sensor = {"model": "generic-scanner", "id": "S", "orbital_slot_deg": -140.0}
    scene = {"scene": "rise", "epoch": "2026-04-01T12:00:00Z", "duration_s": 400.0, "outputs": []}
    return opir.compile_plan(
        opir.scene_from_mapping({**scene, "sensors": [sensor], "targets": targets})
    ).targets


def dense_heights_m(targets: Targets, row: int) -> tuple[Array, Array]:
    """Return times of a burn and the heights then, by the geodesy that tests check against PROJ and
    ERFA.
    """
    time_s = np.linspace(targets.ignition_s[row], targets.burnout_s[row], DENSE)
    position = targets.position_ecef_m(np.full(DENSE, row, dtype=np.int32), time_s)
    return time_s, ecef_to_geodetic(position).height_m


@pytest.mark.slow
def test_crossings_of_class_flights_are_those_of_dense_scans(launched: Targets) -> None:
    rising = ascents(launched)
    rng = np.random.default_rng(5)
    levels_m = np.exp(rng.uniform(np.log(1.0), np.log(4e5), (len(LAUNCHES), 300)))
    times_s = rising.times_s(levels_m)
    for row in range(len(LAUNCHES)):
        dense_s, height_m = dense_heights_m(launched, row)
        rises = (height_m[:-1, None] < levels_m[row]) & (height_m[1:, None] >= levels_m[row])
        exact_s = np.where(rises.any(axis=0), dense_s[rises.argmax(axis=0)], np.nan)
        burn_s = launched.burnout_s[row] - launched.ignition_s[row]
        is_first = exact_s - launched.ignition_s[row] < burn_s / STEPS
        allowed_s = np.where(is_first, FIRST_STEP, LATER_STEPS) * burn_s / STEPS + burn_s / (
            DENSE - 1
        )
        assert np.array_equal(np.isnan(times_s[row]), np.isnan(exact_s))
        assert np.isfinite(exact_s).sum() > 200
        assert np.nanmax(np.abs(times_s[row] - exact_s) / allowed_s) <= 1.0


def test_some_of_the_targets_cross_as_all_of_them_do(launched: Targets) -> None:
    rising = ascents(launched)
    rows = np.array([2, 0])
    levels_m = np.array([[100.0, 20e3], [5e3, 60e3], [7e3, 1e3], [9e3, 30e3]])
    assert np.array_equal(rising.take(rows).times_s(levels_m[rows]), rising.times_s(levels_m)[rows])
