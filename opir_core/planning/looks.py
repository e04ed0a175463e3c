"""From looks to exposures: which there are, when they are, and where sensor and target then stand."""

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces.records import Exposures
from opir_core.planning.plan import Plan
from opir_core.planning.sensor_states import SensorStates
from opir_core.planning.visibility import GridPlace, Pairs, Visibility, distance_m, visible_now

#: Rows handled at once.
BLOCK_ROWS = 16384

_NOTHING = np.empty(0)
_NO_VECTORS = np.empty((0, 3))


@frozen(eq=False)
class Looks:
    """A window's looks: those of each active pair in turn, by scan; `pair` and `scan` have one row a look."""

    active: IntArray
    first_scan: IntArray
    scans: IntArray
    pair: IntArray
    scan: IntArray

    @classmethod
    def between(cls, pairs: Pairs, start_ns: int, end_ns: int) -> "Looks":
        """Return the looks in [start, end) of scene time."""
        first = np.maximum(pairs.first_scan, -((pairs.phase_ns - start_ns) // pairs.period_ns))
        last = np.minimum(pairs.last_scan, (end_ns - 1 - pairs.phase_ns) // pairs.period_ns)
        active = np.flatnonzero(last >= first)
        first_scan, scans = first[active], (last - first)[active] + 1
        offset = np.cumsum(scans) - scans
        scan = np.arange(int(scans.sum())) + np.repeat(first_scan - offset, scans)
        return cls(active, first_scan, scans, np.repeat(active, scans), scan)


def blocks(rows: int) -> list[slice]:
    """Return slices that cut rows into blocks small enough for their columns to stay in the processor's cache."""
    return [slice(start, min(start + BLOCK_ROWS, rows)) for start in range(0, rows, BLOCK_ROWS)]


def pair_names(plan: Plan) -> list[tuple[str, str]]:
    """Return the sensor's and the target's id of each pair."""
    both = zip(plan.pairs.sensor.tolist(), plan.pairs.target.tolist(), strict=True)
    return [(plan.sensors[sensor].id, plan.targets.ids[target]) for sensor, target in both]


def scan_names(plan: Plan) -> list[tuple[str, str]]:
    """Return the names that each pair's scans go by: its ids, the sensor's with its generation where scans are anew."""
    if not any(plan.scan_generations):
        return pair_names(plan)
    pieces = zip(plan.sensors, plan.scan_generations, strict=True)
    names = [f"{sensor.id}@{generation}" if generation else sensor.id for sensor, generation in pieces]
    both = zip(plan.pairs.sensor.tolist(), plan.pairs.target.tolist(), strict=True)
    return [(names[sensor], plan.targets.ids[target]) for sensor, target in both]


def look_times_ns(pairs: Pairs, pair: IntArray, scan: IntArray) -> IntArray:
    """Return when pairs (n,) make their scans (n,), in ns of scene time."""
    times: IntArray = pairs.phase_ns[pair] + scan * pairs.period_ns[pair]
    return times


def look_times_s(pairs: Pairs, pair: IntArray, scan: IntArray) -> FloatArray:
    """Return when pairs (n,) make their scans (n,), in s of scene time."""
    return look_times_ns(pairs, pair, scan).astype(np.float64) * 1e-9


def exposures(
    plan: Plan, sites: SensorStates, pair: IntArray, scan: IntArray, *, geometry: bool, time_s: FloatArray | None = None
) -> Exposures:
    """Return the exposures of looks given by pair and scan (n,); without `geometry` its columns stay empty.

    `time_s` are the looks' times, where these are known.
    """
    time_s = look_times_s(plan.pairs, pair, scan) if time_s is None else time_s
    sensor, target = plan.pairs.sensor[pair], plan.pairs.target[pair]
    place = plan.sightlines.place(pair, time_s)
    emission_s = _emission_s(plan, place, pair, time_s)
    if not geometry:
        return Exposures(time_s, emission_s, scan, sensor, target, _NOTHING, _NOTHING, _NO_VECTORS, _NO_VECTORS)
    sensor_m, target_m = sites.positions(sensor, time_s), plan.targets.position_ecef_m(target, emission_s)
    elevation_sine = place.interpolated(plan.sightlines.elevation_sine)
    return Exposures(
        time_s, emission_s, scan, sensor, target, distance_m(sensor_m, target_m), elevation_sine, target_m, sensor_m
    )


def seen(plan: Plan, sites: SensorStates, pair: IntArray, scan: IntArray) -> BoolArray:
    """Return which looks of pairs that are not certain see their target; only those in doubt are computed."""
    place = plan.sightlines.place(pair, look_times_s(plan.pairs, pair, scan))
    sight = plan.sightlines.sight[place.point]
    result: BoolArray = sight == Visibility.ALWAYS
    doubtful = np.flatnonzero(sight == Visibility.PERHAPS)
    exposed = exposures(plan, sites, pair[doubtful], scan[doubtful], geometry=True)
    for number in np.unique(exposed.sensor):
        rows = np.flatnonzero(exposed.sensor == number)
        sensor_m, target_m = exposed.sensor_ecef_m[rows], exposed.target_ecef_m[rows]
        result[doubtful[rows]] = visible_now(plan.sensors[number], sensor_m, target_m)
    return result


def _emission_s(plan: Plan, place: GridPlace, pair: IntArray, time_s: FloatArray) -> FloatArray:
    """Return when the light of looks left their targets: within what is watched, whatever rounding says."""
    left_s = time_s - place.interpolated(plan.sightlines.travel_s) if plan.scene.light_time else time_s
    return np.clip(left_s, plan.targets.ignition_s[plan.pairs.target[pair]], plan.pairs.until_s[pair])
