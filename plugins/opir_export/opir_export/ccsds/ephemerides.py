"""Sampled states of targets and sensors in the Earth-fixed frame, in smooth stretches."""

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from attrs import frozen

from opir_core import Plan
from opir_core.arrays import FloatArray, IntArray
from opir_core.planning import Targets, whole_flights
from opir_export.scenery.map_features import LONGEST_FLIGHT_S

#: Half the time between the positions that velocities are differences of, s.
_DIFFERENCE_S = 0.01
#: Fewest states of a stretch, so that the interpolation has enough.
_FEWEST = 9
_US_PER_S = 1_000_000

#: Returns positions (n, 3), ECEF, m, at scene times (n,).
Path = Callable[[FloatArray], FloatArray]


@frozen(eq=False)
class SampledStates:
    """States of an object: times (n,), µs from the epoch; positions, velocities (n, 3), ECEF."""

    name: str
    is_sensor: bool
    since_us: IntArray
    position_m: FloatArray
    velocity_m_s: FloatArray

    @property
    def file_name(self) -> str:
        """Return a file name without its ending; a sensor and a target may have the same id."""
        return f"{'sensor' if self.is_sensor else 'target'}-{self.name}"


def sensor_ephemerides(plan: Plan, step_s: float) -> Iterator[SampledStates]:
    """Yield the states of each sensor from the start of the scene to its end."""
    for sensor in plan.sensors:
        yield _ephemeris(
            sensor.id, sensor.orbit.position_ecef_m, (0.0, plan.scene.duration_s), step_s, True
        )


def target_ephemerides(plan: Plan, step_s: float, burn_step_s: float) -> Iterator[SampledStates]:
    """Yield the states of each launch from ignition to impact, one stretch per burn or free flight.

    Acceleration jumps at the end of a stretch, and an interpolation must not cross it. A stretch
    begins with the last state of the one before. An orbit ends two hours after burnout.
    """
    targets = whole_flights(plan)
    for row, name in enumerate(targets.ids):
        for stretch, is_burning in _stretches(targets, row):
            yield _ephemeris(
                name, _path(targets, row), stretch, burn_step_s if is_burning else step_s, False
            )


def _path(targets: Targets, row: int) -> Path:
    def position_ecef_m(time_s: FloatArray) -> FloatArray:
        return targets.position_ecef_m(np.full(len(time_s), row, dtype=np.int32), time_s)

    return position_ecef_m


def _stretches(targets: Targets, row: int) -> Iterator[tuple[tuple[float, float], bool]]:
    """Yield start and end, s, of each burn and free flight in turn, and whether it is a burn."""
    burns_s = targets.burns_s[row][np.isfinite(targets.burns_s[row]).all(axis=1)]
    end_s = min(float(targets.end_s[row]), float(targets.burnout_s[row]) + LONGEST_FLIGHT_S)
    edges_s = [*burns_s.reshape(-1).tolist(), max(end_s, float(burns_s.max()))]
    for number, (start_s, stop_s) in enumerate(pairwise(edges_s)):
        if stop_s - start_s > _DIFFERENCE_S:
            yield (start_s, stop_s), number % 2 == 0


def _ephemeris(
    name: str, path: Path, stretch: tuple[float, float], step_s: float, is_sensor: bool
) -> SampledStates:
    # Stretches meet at the same microsecond; the states are those within the stretch, at most half
    # of one away.
    start_us, stop_us = (round(edge_s * _US_PER_S) for edge_s in stretch)
    count = max(int(np.ceil((stop_us - start_us) / (step_s * _US_PER_S))) + 1, _FEWEST)
    since_us = np.unique(np.rint(np.linspace(start_us, stop_us, count)).astype(np.int64))
    time_s = np.clip(since_us / _US_PER_S, *stretch)
    return SampledStates(
        name, is_sensor, since_us, path(time_s), _velocities_m_s(path, time_s, stretch)
    )


def _velocities_m_s(path: Path, time_s: FloatArray, stretch: tuple[float, float]) -> FloatArray:
    """Return velocities (n, 3), m/s: the slopes of parabolas through three positions each.

    At an end of the stretch the slope is taken beside the middle of the three.
    """
    half_s = min(_DIFFERENCE_S, 0.25 * (stretch[1] - stretch[0]))
    middle_s = np.clip(time_s, stretch[0] + half_s, stretch[1] - half_s)
    earlier, middle, later = (path(middle_s + shift_s) for shift_s in (-half_s, 0.0, half_s))
    offset_s = (time_s - middle_s)[:, np.newaxis]
    curvature = (later - 2.0 * middle + earlier) / half_s**2
    return (later - earlier) / (2.0 * half_s) + offset_s * curvature
