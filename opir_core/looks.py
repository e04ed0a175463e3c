"""From looks to what is seen in them: times, positions, lines of sight, measured angles. Columns in, columns out."""

import numpy as np
from attrs import frozen

from opir_core.geometry import east_north_up_axes, ecef_to_geodetic, elevation_rad
from opir_core.plan import Plan
from opir_core.randomness import normal_pairs
from opir_core.records import BoolArray, Exposures, FloatArray, IndexArray, IntArray
from opir_core.sightlines import Pairs, Sight, visible_now

#: Rows handled at once.
BLOCK_ROWS = 16384

_NOTHING = np.empty(0)
_NO_VECTORS = np.empty((0, 3))


@frozen(eq=False)
class Sites:
    """What stays the same of the sensors, one row each: position and axes (nan for those that move), sigma."""

    position_ecef_m: FloatArray
    axes: FloatArray
    is_moving: BoolArray
    sigma_rad: FloatArray

    @classmethod
    def of(cls, plan: Plan) -> "Sites":
        """Return the sites of a plan's sensors."""
        moving = np.array([not sensor.orbit.is_stationary for sensor in plan.sensors], dtype=np.bool_)
        position = np.full((len(plan.sensors), 3), np.nan)
        for number in np.flatnonzero(~moving):
            position[number] = plan.sensors[number].orbit.position_ecef_m(np.zeros(1))[0]
        sigma_rad = np.array([sensor.line_of_sight_sigma_rad for sensor in plan.sensors], dtype=np.float64)
        return cls(position, _axes(position), moving, sigma_rad)


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


def look_times_ns(pairs: Pairs, pair: IntArray, scan: IntArray) -> IntArray:
    """Return when pairs (n,) make their scans (n,), in ns of scene time."""
    times: IntArray = pairs.phase_ns[pair] + scan * pairs.period_ns[pair]
    return times


def look_times_s(pairs: Pairs, pair: IntArray, scan: IntArray) -> FloatArray:
    """Return when pairs (n,) make their scans (n,), in s of scene time."""
    return look_times_ns(pairs, pair, scan).astype(np.float64) * 1e-9


def exposures(plan: Plan, sites: Sites, pair: IntArray, scan: IntArray, *, geometry: bool) -> Exposures:
    """Return the exposures of looks given by pair and scan (n,); without `geometry` its columns stay empty."""
    time_s = look_times_s(plan.pairs, pair, scan)
    sensor, target = plan.pairs.sensor[pair], plan.pairs.target[pair]
    emission_s = _emission_s(plan, pair, target, time_s)
    if not geometry:
        return Exposures(time_s, emission_s, scan, sensor, target, _NOTHING, _NOTHING, _NO_VECTORS, _NO_VECTORS)
    sensor_m = _sensor_positions(plan, sites, sensor, time_s)
    target_m = plan.targets.position_ecef_m(target, emission_s)
    x, y, z = (target_m[:, axis] - sensor_m[:, axis] for axis in range(3))
    range_m: FloatArray = np.sqrt(x * x + y * y + z * z)
    return Exposures(
        time_s, emission_s, scan, sensor, target, range_m, elevation_rad(target_m, sensor_m), target_m, sensor_m
    )


def seen(plan: Plan, sites: Sites, pair: IntArray, scan: IntArray) -> BoolArray:
    """Return which looks of pairs that are not certain see their target; only those in doubt are computed."""
    time_s = look_times_s(plan.pairs, pair, scan)
    sight = plan.sightlines.sight_at(pair, time_s)
    result: BoolArray = sight == Sight.ALWAYS
    doubtful = np.flatnonzero(sight == Sight.PERHAPS)
    exposed = exposures(plan, sites, pair[doubtful], scan[doubtful], geometry=True)
    for number in np.unique(exposed.sensor):
        rows = np.flatnonzero(exposed.sensor == number)
        sensor_m, target_m = exposed.sensor_ecef_m[rows], exposed.target_ecef_m[rows]
        result[doubtful[rows]] = visible_now(plan.sensors[number], sensor_m, target_m)
    return result


@frozen(eq=False)
class MeasuredDirections:
    """Lines of sight as measured: unit vectors (n, 3) in ECEF; azimuth and elevation in the sensor's local frame."""

    line_of_sight_ecef: FloatArray
    azimuth_rad: FloatArray
    elevation_rad: FloatArray


def measured_directions(sites: Sites, seen_as: Exposures, uniforms: FloatArray) -> MeasuredDirections:
    """Return directions with the sensors' line-of-sight errors: two normal errors across the line of sight."""
    sigma_rad = sites.sigma_rad[seen_as.sensor]
    across, along = normal_pairs(uniforms)
    x, y, z = ((seen_as.target_ecef_m[:, axis] - seen_as.sensor_ecef_m[:, axis]) / seen_as.range_m for axis in range(3))
    x, y, z = _tilted(x, y, z, across * sigma_rad, along * sigma_rad)
    east, north, up = _local(sites, seen_as, x, y, z)
    azimuth = np.arctan2(east, north)
    azimuth = np.where(azimuth < 0.0, azimuth + 2.0 * np.pi, azimuth)
    elevation = np.arctan2(up, np.sqrt(east * east + north * north))
    return MeasuredDirections(np.stack((x, y, z), axis=1), azimuth, elevation)


def _tilted(
    x: FloatArray, y: FloatArray, z: FloatArray, first_rad: FloatArray, second_rad: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return unit vectors moved by small angles along two directions across them.

    The two directions are Duff et al.'s branchless orthonormal basis ("Building an orthonormal basis, revisited",
    JCGT 6, 2017).
    """
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    tilted_x = x + first_rad * (1.0 + sign * x * x * a) + second_rad * b
    tilted_y = y + first_rad * (sign * b) + second_rad * (sign + y * y * a)
    tilted_z = z - first_rad * (sign * x) - second_rad * y
    length = np.sqrt(tilted_x * tilted_x + tilted_y * tilted_y + tilted_z * tilted_z)
    return tilted_x / length, tilted_y / length, tilted_z / length


def _local(sites: Sites, seen_as: Exposures, x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[FloatArray, ...]:
    """Return east, north and up components of vectors at their sensors."""
    axes = sites.axes[seen_as.sensor]
    rows = np.flatnonzero(sites.is_moving[seen_as.sensor])
    if len(rows):
        axes[rows] = _axes(seen_as.sensor_ecef_m[rows])
    return tuple(axes[:, axis, 0] * x + axes[:, axis, 1] * y + axes[:, axis, 2] * z for axis in range(3))


def _axes(position_ecef_m: FloatArray) -> FloatArray:
    where = ecef_to_geodetic(position_ecef_m)
    return east_north_up_axes(where.latitude_rad, where.longitude_rad)


def _emission_s(plan: Plan, pair: IntArray, target: IndexArray, time_s: FloatArray) -> FloatArray:
    """Return when the light of looks left their targets: within the burn, whatever rounding says."""
    travel_s = plan.sightlines.light_time_s(pair, time_s) if plan.scene.light_time else 0.0
    return np.clip(time_s - travel_s, plan.targets.ignition_s[target], plan.targets.burnout_s[target])


def _sensor_positions(plan: Plan, sites: Sites, sensor: IndexArray, time_s: FloatArray) -> FloatArray:
    positions: FloatArray = sites.position_ecef_m[sensor]
    for number in np.flatnonzero(sites.is_moving):
        rows = np.flatnonzero(sensor == number)
        positions[rows] = plan.sensors[number].orbit.position_ecef_m(time_s[rows])
    return positions
