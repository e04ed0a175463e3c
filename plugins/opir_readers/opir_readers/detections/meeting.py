"""Do the lines of sight of two sensors meet? As given, and under the usual slips.

Two sensors that see one source at one time have lines of sight that pass each other within their errors. Where lines of
a pair of sensors hardly ever do so as given, and mostly under one slip, that slip was made. Sensors that see different
sources meet under no slip.
"""

from collections.abc import Callable, Iterator, Mapping
from itertools import combinations

import numpy as np
from attrs import evolve, frozen

from opir_core import Plan
from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_ROTATION_RAD_S
from opir_core.geometry import dot
from opir_core.plugin import Detections
from opir_readers.celestial_frames import turned
from opir_readers.detections.columns_of_run import RunColumns
from opir_readers.frames import along_axes, axes_at, axes_of, lengths

#: Lines at most this far apart in time, s, are simultaneous; the gate grows by what a target of this
#: speed, m/s, moves in between.
TOGETHER_S = 0.5
SPEED_M_S = 8000.0

#: Gate: lines meet if their miss distance is within so many standard deviations of noise and this
#: bias, rad, which those of sensors are below.
SIGMAS = 5.0
BIAS_RAD = 150e-6

#: Sources are no deeper than this, m, and no farther from the Earth's centre.
DEEPEST_M = 30_000.0
FARTHEST_M = 8.5e6

#: A slip is reported if, of at least so many simultaneous lines, at most this share meets as given
#: and at least this share meets once the slip is undone.
MIN_LINES = 8
MAX_SHARE_AS_GIVEN = 0.1
MIN_SHARE_MENDED = 0.5

#: The gate allows for biases, so lines of a slow source meet with a wrong clock too. A slip is then
#: reported if, once it is undone, at least so many simultaneous lines have a median miss distance of
#: at most so many standard deviations of noise, without bias, and so many times below that as given.
MIN_SHARP_LINES = 20
MAX_SHARP_SIGMAS = 1.5
MIN_IMPROVEMENT = 4.0

#: Sensors with a baseline below so many times the width of the gate at the Earth's centre do not
#: triangulate.
MIN_BASE = 2.0

#: Every slip is named whose median miss distance is at most so many times the least: two
#: geostationary sensors see mirror images of a source under several.
MAX_RATIO_NAMED = 2.0

#: The most lines of a pair that are compared.
MOST_LINES = 500

#: Leap seconds between UTC, GPS and TAI, and whole hours of zones: clocks that differ, s.
CLOCKS_S = (18.0, 19.0, 37.0, 3600.0)


@frozen
class Lines:
    """Lines of sight (n,) of one sensor, by time, s.

    They have origins and directions (n, 3) in ECEF, and standard deviations, rad.
    """

    time_s: FloatArray
    origin_m: FloatArray
    direction: FloatArray
    sigma_rad: FloatArray

    @classmethod
    def of(cls, detections: Detections, sensor: int) -> "Lines":
        """Return the lines of one sensor."""
        rows = np.flatnonzero(detections.sensor == sensor)
        rows = rows[np.argsort(detections.time_ns[rows], kind="stable")]
        return cls(
            detections.time_s[rows],
            detections.sensor_ecef_m[rows],
            detections.line_of_sight_ecef[rows],
            detections.line_of_sight_sigma_rad[rows],
        )

    def take(self, rows: IntArray) -> "Lines":
        """Return some lines."""
        return Lines(
            self.time_s[rows], self.origin_m[rows], self.direction[rows], self.sigma_rad[rows]
        )

    def at(self, range_m: FloatArray) -> FloatArray:
        """Return the places (n, 3) at ranges (n,), m."""
        return self.origin_m + range_m[:, None] * self.direction

    @property
    def error_rad(self) -> FloatArray:
        """Return the angles (n,) within which lines lead to their sources."""
        return SIGMAS * self.sigma_rad + BIAS_RAD


@frozen
class Meeting:
    """Miss distances (n,) of simultaneous lines, m, which of them meet within the gate, and the
    standard deviations of the distances by noise, m.
    """

    distance_m: FloatArray
    meets: BoolArray
    sigma_m: FloatArray

    @property
    def share(self) -> float:
        """Return the share of lines that meet."""
        return float(np.count_nonzero(self.meets)) / max(len(self.meets), 1)

    @property
    def typical_m(self) -> float:
        """Return the median miss distance, m."""
        return float(np.median(self.distance_m))

    @property
    def is_sharp(self) -> bool:
        """Return whether the median miss distance is explained by noise alone, without bias."""
        return self.typical_m <= MAX_SHARP_SIGMAS * float(np.median(self.sigma_m))


Pair = tuple[Lines, Lines]


def slips_of_lines(columns: RunColumns, plan: Plan) -> Iterator[str]:
    """Yield the slips that explain why lines of two sensors do not meet, for each pair with one."""
    detections = columns.detections
    mends = dict(MENDS)
    if any("right_ascension_deg" in row and "reference_frame" not in row for row in columns.rows):
        mends["with right ascensions of date"] = (
            lambda pair: _of_date(pair, plan.scene.epoch_us),
            "--columns right_ascension_of_date_deg=NAME,declination_of_date_deg=NAME",
        )
    for first, second in combinations(np.unique(detections.sensor).tolist(), 2):
        pair = Lines.of(detections, first), Lines.of(detections, second)
        names = plan.sensors[first].id, plan.sensors[second].id
        yield from slips_of_pair(pair, names, mends)


def slips_of_pair(
    pair: Pair, names: tuple[str, str], mends: "Mends | None" = None
) -> Iterator[str]:
    """Yield a warning that names the slips of `mends` (default `MENDS`) which explain the miss
    distances of two sensors with these names.
    """
    mends = mends or MENDS
    given = meeting(pair)
    if _at_one_place(pair):
        return
    slips = {slip: lines for slip, lines in _mended(pair, mends) if lines.share >= MIN_SHARE_MENDED}
    if len(given.meets) < MIN_LINES or given.share > MAX_SHARE_AS_GIVEN:
        slips = _sharp(given, slips)
    if slips:
        nearest_m = min(lines.typical_m for lines in slips.values())
        ways = [
            f"{slip} ({mends[slip][1].format(*names)})"
            for slip, lines in slips.items()
            if lines.typical_m <= MAX_RATIO_NAMED * nearest_m
        ]
        yield (
            f"lines of {names[0]} and {names[1]} within {TOGETHER_S} s {_passing(given)}, and at"
            f" {nearest_m * 1e-3:.2g} km {' or '.join(ways)}"
        )


def _sharp(given: Meeting, slips: Mapping[str, Meeting]) -> dict[str, Meeting]:
    """Return the slips that, once undone, bring miss distances down to noise: where lines meet as
    given within their biases, or are simultaneous only without the slip.
    """
    far_m = given.typical_m if len(given.meets) else np.inf
    return {
        slip: lines
        for slip, lines in slips.items()
        if lines.is_sharp
        and len(lines.meets) >= MIN_SHARP_LINES
        and MIN_IMPROVEMENT * lines.typical_m < far_m
    }


def _passing(given: Meeting) -> str:
    """Return how simultaneous lines pass each other as given."""
    if not len(given.meets):
        return "of each other there are none"
    return f"pass each other at {given.typical_m * 1e-3:.3g} km"


def _at_one_place(pair: Pair) -> bool:
    """Return whether the baseline of two sensors is too short, in the median, to triangulate."""
    line, other = pair
    base_m = lengths(_next_places(line, other) - line.origin_m)
    return bool(np.median(base_m / (line.error_rad * lengths(line.origin_m))) < MIN_BASE)


def _mended(pair: Pair, mends: "Mends") -> Iterator[tuple[str, Meeting]]:
    """Yield the slips and how lines pass without each, where enough are simultaneous."""
    for slip, (mend, _) in mends.items():
        lines = meeting(mend(pair))
        if len(lines.meets) >= MIN_LINES:
            yield slip, lines


def meeting(pair: Pair) -> Meeting:
    """Return how each line of one sensor passes the nearest simultaneous line of the other."""
    line, other = pair
    line = line.take(np.arange(0, len(line.time_s), len(line.time_s) // MOST_LINES + 1))
    rows, other_rows = _simultaneous(line.time_s, other.time_s)
    if not len(rows):
        return Meeting(np.empty(0), np.empty(0, dtype=np.bool_), np.empty(0))
    passes = _passes(line.take(rows), other.take(other_rows))
    starts = np.flatnonzero(np.diff(rows, prepend=-1))
    return Meeting(
        np.minimum.reduceat(passes.distance_m, starts),
        np.logical_or.reduceat(passes.meets, starts),
        passes.sigma_m[starts],
    )


def _simultaneous(time_s: FloatArray, other_s: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the rows of all pairs of times within `TOGETHER_S`; both are sorted."""
    start = np.searchsorted(other_s, time_s - TOGETHER_S)
    count = np.searchsorted(other_s, time_s + TOGETHER_S) - start
    rows = np.repeat(np.arange(len(count)), count)
    places = np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count)
    return rows, places + np.repeat(start, count)


def _passes(line: Lines, other: Lines) -> Meeting:
    """Return how pairs of lines (n,) pass each other, and which meet at a source."""
    between = other.origin_m - line.origin_m
    cosine = dot(line.direction, other.direction)
    along = dot(between, line.direction)
    other_along = dot(between, other.direction)
    sine_square = np.maximum(1.0 - cosine * cosine, 1e-12)
    range_m = (along - cosine * other_along) / sine_square
    other_range_m = (cosine * along - other_along) / sine_square
    place_m = line.at(range_m)
    other_place_m = other.at(other_range_m)
    distance_m = lengths(other_place_m - place_m)
    radius_m = lengths(0.5 * (place_m + other_place_m))
    blur_m = line.error_rad * range_m + other.error_rad * other_range_m
    motion_m = SPEED_M_S * np.abs(line.time_s - other.time_s)
    is_ahead = (range_m > 0.0) & (other_range_m > 0.0)
    is_source = (radius_m > EARTH_EQUATORIAL_RADIUS_M - DEEPEST_M) & (radius_m < FARTHEST_M)
    meets = is_ahead & is_source & (distance_m < blur_m + motion_m)
    return Meeting(
        distance_m, meets, np.hypot(line.sigma_rad * range_m, other.sigma_rad * other_range_m)
    )


def _both(change: Callable[[FloatArray], FloatArray]) -> Callable[[Pair], Pair]:
    """Return the mend that changes directions towards east, north and up (n, 3) of both sensors."""

    def mended(pair: Pair) -> Pair:
        one, other = (_turned(lines, change) for lines in pair)
        return one, other

    return mended


def _turned(lines: Lines, change: Callable[[FloatArray], FloatArray]) -> Lines:
    local = dot(axes_at(lines.origin_m), lines.direction[:, None])
    return _along_local(lines, change(local), lines.origin_m)


def _along_local(lines: Lines, local: FloatArray, origin_m: FloatArray) -> Lines:
    """Return lines from places (n, 3) in directions towards east, north and up there."""
    return evolve(lines, origin_m=origin_m, direction=along_axes(local, axes_at(origin_m)))


def _of_date(pair: Pair, epoch_us: int) -> Pair:
    """Return lines whose right ascensions and declinations are of date, not of J2000."""
    one, other = (_to_date(lines, epoch_us) for lines in pair)
    return one, other


def _to_date(lines: Lines, epoch_us: int) -> Lines:
    first_s = float(lines.time_s[0])
    equinox, date = (axes_of(frame, epoch_us, first_s) for frame in ("EME2000", "TOD"))
    turn_rad = EARTH_ROTATION_RAD_S * (lines.time_s - first_s)
    at_first = turned(lines.direction, [("z", -turn_rad)])
    celestial = dot(equinox, at_first[:, None])
    return evolve(lines, direction=turned(along_axes(celestial, date), [("z", turn_rad)]))


def _exchanged(pair: Pair) -> Pair:
    """Return each sensor's angles at the other's place, that nearest in time."""
    one, other = pair
    return _seen_from(one, other), _seen_from(other, one)


def _seen_from(lines: Lines, other: Lines) -> Lines:
    local = dot(axes_at(lines.origin_m), lines.direction[:, None])
    return _along_local(lines, local, _next_places(lines, other))


def _next_places(lines: Lines, other: Lines) -> FloatArray:
    """Return the places (n, 3) of another sensor at its next lines after lines (n,)."""
    rows = np.searchsorted(other.time_s, lines.time_s)
    return other.origin_m[np.minimum(rows, len(other.time_s) - 1)]


def _later(clock_s: float) -> Callable[[Pair], Pair]:
    return lambda pair: (pair[0], evolve(pair[1], time_s=pair[1].time_s + clock_s))


def _clock_text(clock_s: float) -> str:
    return f"with the second's times {abs(clock_s):g} s {'later' if clock_s > 0.0 else 'earlier'}"


_CLOCKS = {
    _clock_text(clock): (_later(clock), "mend the clock of {1}")
    for size in CLOCKS_S
    for clock in (size, -size)
}

#: By slip: what mends a pair, and the words that say how to mend a file.
Mends = Mapping[str, tuple[Callable[[Pair], Pair], str]]

#: What mends a pair by each slip, and what mends the file; {0} and {1} are the sensors' ids.
MENDS: Mends = {
    "with azimuths from south": (
        _both(lambda enu: enu * (-1.0, -1.0, 1.0)),
        "--columns azimuth_from_south_deg=NAME",
    ),
    "with azimuths counted to the west": (
        _both(lambda enu: enu * (-1.0, 1.0, 1.0)),
        "change the sign of azimuths",
    ),
    "with azimuths from east, counted to the north": (
        _both(lambda enu: enu[:, [1, 0, 2]]),
        "give 90° less them",
    ),
    "with elevations counted downwards": (
        _both(lambda enu: enu * (1.0, 1.0, -1.0)),
        "change the sign of elevations",
    ),
    "with the sensors' ids exchanged": (_exchanged, "--rename {0}={1} --rename {1}={0}"),
    **_CLOCKS,
}
