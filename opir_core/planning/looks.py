"""Looks of a window and their geometry: which there are, when, and where sensor and target are."""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.host.boundary import still_at_work
from opir_core.interfaces.records import Exposures
from opir_core.planning.sensor_states import SensorStates
from opir_core.planning.sightlines import Pairs, Sightlines, Visibility, distance_m
from opir_core.planning.solar_exclusion import SolarExclusion
from opir_core.planning.targets import Targets
from opir_core.planning.visibility import visible_now

#: Rows processed at once.
BLOCK_ROWS = 16384

_NOTHING = np.empty(0)
_NO_VECTORS = np.empty((0, 3))


@frozen(eq=False)
class Looks:
    """A window's looks: those of each active pair in turn, by scan; `pair` and `scan` have one row
    per look.
    """

    active: IntArray
    first_scan: IntArray
    scans: IntArray
    pair: IntArray
    scan: IntArray

    @classmethod
    def between(cls, pairs: Pairs, start_ns: int, end_ns: int, idle: Sequence[int] = ()) -> "Looks":
        """Return the looks in [start, end) of scene time, without those of `idle` sensors."""
        start_scan = np.maximum(pairs.first_scan, -((pairs.phase_ns - start_ns) // pairs.period_ns))
        last_scan = np.minimum(pairs.last_scan, (end_ns - 1 - pairs.phase_ns) // pairs.period_ns)
        is_active = last_scan >= start_scan
        if idle:
            is_active &= ~np.isin(pairs.sensor, idle)
        active = np.flatnonzero(is_active)
        first_scan = start_scan[active]
        scans = last_scan[active] - first_scan + 1
        offset = np.cumsum(scans) - scans
        scan = np.arange(int(scans.sum())) + np.repeat(first_scan - offset, scans)
        return cls(active, first_scan, scans, np.repeat(active, scans), scan)


@frozen(eq=False, kw_only=True, repr=False)
class LookGeometry:
    """Geometry of looks, given by pairs (n,) and scans (n,).

    `exclusions` are the sensors' solar exclusions, or nothing if none of them has any.
    """

    states: SensorStates
    targets: Targets
    pairs: Pairs
    sightlines: Sightlines
    light_time: bool
    exclusions: tuple[SolarExclusion | None, ...] = ()

    def exposures(
        self,
        pair: IntArray,
        scan: IntArray,
        *,
        with_geometry: bool = True,
        time_s: FloatArray | None = None,
    ) -> Exposures:
        """Return the exposures of looks; `time_s` (n,) are their times, if known."""
        still_at_work()  # windows are computed in blocks of looks: however many, each is a sign of life
        time_s = look_times_s(self.pairs, pair, scan) if time_s is None else time_s
        sensor = self.pairs.sensor[pair]
        target = self.pairs.target[pair]
        place = self.sightlines.place(pair, time_s)
        # The emission times of the observed light, limited to the observed time of the target.
        left_s = (
            time_s - place.interpolated(self.sightlines.travel_s) if self.light_time else time_s
        )
        emission_s = np.clip(left_s, self.targets.ignition_s[target], self.pairs.until_s[pair])
        if not with_geometry:
            return Exposures(
                time_s,
                emission_s,
                scan,
                sensor,
                target,
                _NOTHING,
                _NOTHING,
                _NO_VECTORS,
                _NO_VECTORS,
            )
        sensor_m = self.states.positions(sensor, time_s)
        target_m = self.targets.position_ecef_m(target, emission_s)
        elevation_sine = place.interpolated(self.sightlines.elevation_sine)
        return Exposures(
            time_s,
            emission_s,
            scan,
            sensor,
            target,
            distance_m(sensor_m, target_m),
            elevation_sine,
            target_m,
            sensor_m,
        )

    def visible(self, pair: IntArray, scan: IntArray) -> BoolArray:
        """Return which looks see their target; only looks in uncertain cells are computed."""
        place = self.sightlines.place(pair, look_times_s(self.pairs, pair, scan))
        sight = self.sightlines.sight[place.point]
        result: BoolArray = sight == Visibility.ALWAYS
        uncertain = np.flatnonzero(sight == Visibility.UNCERTAIN)
        exposed = self.exposures(pair[uncertain], scan[uncertain])
        for number in np.unique(exposed.sensor):
            rows = np.flatnonzero(exposed.sensor == number)
            sensor_m = exposed.sensor_ecef_m[rows]
            target_m = exposed.target_ecef_m[rows]
            is_seen = visible_now(self.states.sensors[number], sensor_m, target_m)
            exclusion = self.exclusions[number] if self.exclusions else None
            if exclusion is not None:
                is_seen &= exclusion.is_clear(sensor_m, target_m, exposed.time_s[rows])
            if not self.states.sensors[number].follows_bodies:
                is_seen &= ~self.targets.is_dark(
                    exposed.target[rows], exposed.emission_time_s[rows]
                )
            result[uncertain[rows]] = is_seen
        return result


def blocks(rows: int) -> list[slice]:
    """Return slices that cut rows into blocks small enough for their columns to stay in the
    processor's cache.
    """
    return [slice(start, min(start + BLOCK_ROWS, rows)) for start in range(0, rows, BLOCK_ROWS)]


def look_times_ns(pairs: Pairs, pair: IntArray, scan: IntArray) -> IntArray:
    """Return the scene times of scans (n,) of pairs (n,), ns."""
    return pairs.phase_ns[pair] + scan * pairs.period_ns[pair]


def look_times_s(pairs: Pairs, pair: IntArray, scan: IntArray) -> FloatArray:
    """Return the scene times of scans (n,) of pairs (n,), s."""
    return look_times_ns(pairs, pair, scan).astype(np.float64) * 1e-9
