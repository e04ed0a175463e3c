"""The plausibility of a table in its scene: times, speeds, accelerations, heights, and velocities
against positions.

An impossible table is refused, an unlikely one gives a warning. Each finding has its line, its
figure, the likely cause and the way out.
"""

from collections.abc import Callable, Iterator

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray
from opir_core.constants import (
    EARTH_ECCENTRICITY_SQUARED,
    EARTH_EQUATORIAL_RADIUS_M,
    EARTH_MU_M3_S2,
    EARTH_ROTATION_RAD_S,
)
from opir_core.geometry import dot, ecef_to_geodetic
from opir_core.plugin import StateTable
from opir_readers.frames import lengths
from opir_readers.free_fall import misreading_of
from opir_readers.interpolation import interpolant, runs
from opir_readers.states import TELEMETRY
from opir_readers.velocity_checks import VelocitySlip, velocity_slip


@frozen
class PlausibleLimits:
    """The bounds of a flight; beyond them a table is refused, or reported."""

    #: Velocities that differ systematically from positions by this, m/s, are refused; by less,
    #: reported.
    refused_m_s: float = 5.0
    #: No launch leaves the Earth faster than it takes to leave it for good, m/s,
    fastest_m_s: float = 11_200.0
    #: and no meteoroid of the solar system comes in faster than this, m/s.
    fastest_entry_m_s: float = 72_000.0
    #: A target that never moves faster than this over the ground, m/s,
    slowest_m_s: float = 5.0
    #: and comes nearer to the Earth's centre than this, m, was not launched; a geosynchronous
    #: satellite stands as still.
    still_above_m: float = 3e7
    #: Accelerations above this, m/s², are more than twice those of any launch vehicle at burnout;
    acceleration_m_s2: float = 250.0
    #: bends of a path below this, m, are the rounding of positions,
    least_bend_m: float = 20.0
    #: and where their median is below this, m, all are noise that are not so many times the median:
    #: 20 m of noise leave 100 m in the median, and 13 times as much in the first and the last step.
    noisy_bend_m: float = 125.0
    isolated: float = 30.0
    #: Of long tables so many states before and after the hardest bend are looked at.
    bent_states: int = 5000
    #: A step that goes farther around the Earth than this, rad, cannot be interpolated: there, the
    #: polynomials of states with velocities are some 60 m off a low orbit,
    step_rad: float = 1.0
    #: those of positions alone some 500 m, and ten times more at 1.3 times.
    step_without_velocities_rad: float = 0.5
    #: In steps longer than this, s, a path may go around the Earth-fixed axes unseen; only
    long_step_s: float = 21_600.0
    #: what moves less than this, rad, in such a step, a geostationary satellite, can be interpolated.
    long_step_rad: float = 0.1
    #: Heights below this, m, are below the ground everywhere: the Dead Sea's shore is at -430 m.
    least_height_m: float = -1000.0
    #: Two places of one time are nearer than this, m, where motion is not smooth there;
    jump_m: float = 1.0
    #: farther at so many times and at this share of all, times are rounded. Segments of an ephemeris
    #: meet at fewer.
    jumps: int = 3
    jump_share: float = 0.05
    #: States that repeat the one before them, at this share of all, are copies: a path is not smooth
    #: at fewer.
    repeated_share: float = 0.25


_LIMITS = PlausibleLimits()

_DAY_S = 86_400.0

#: Scales of time that count from elsewhere: how one goes from a time to Unix seconds.
_SCALES: tuple[tuple[str, Callable[[float], float]], ...] = (
    ("Unix seconds", lambda time: time),
    ("Unix milliseconds", lambda time: time * 1e-3),
    ("GPS seconds", lambda time: time + 315_964_800.0 - 18.0),
    ("seconds since J2000", lambda time: time + 946_728_000.0),
    ("days of a Julian date", lambda time: (time - 2_440_587.5) * _DAY_S),
    ("days of a modified Julian date", lambda time: (time - 40_587.0) * _DAY_S),
    ("seconds of the day", lambda time: time),
)


@frozen
class SceneTimes:
    """The epoch of a scene, µs of UTC since 1970, and its length, s."""

    epoch_us: int
    duration_s: float

    def text(self, time_s: float) -> str:
        """Return a scene time as a time in UTC."""
        return moment_text(self.epoch_us * 1e-6 + time_s)


@frozen
class Findings:
    """Reasons to refuse a table, warnings, and what a user should know of a table that is right."""

    refused: tuple[str, ...]
    warnings: tuple[str, ...]
    notes: tuple[str, ...] = ()


def findings_of(
    table: StateTable,
    times: SceneTimes | None = None,
    start_s: float | None = None,
    *,
    as_given: bool = False,
) -> Findings:
    """Return the findings of a table in itself and, with the times of a scene, in that scene.

    `start_s` is the scene time of the table's time 0, None where its times are dates. With
    `as_given` a table that contradicts gravity is not refused.
    """
    refused = [] if times is None else [*_no_overlap(table, times, start_s)]
    coarse = [*_coarse_steps(table), *_two_places(table)]
    warnings = list[str]()
    # States that cannot be interpolated say nothing of gravity.
    misread = [] if coarse else _misread(table)
    (warnings if as_given else refused).extend(misread)
    # Steps are too long only if times are right.
    coarse = coarse or ([] if misread else _long_steps(table))
    refused += coarse
    # Differences of positions that are far apart say nothing of velocities.
    is_sparse = coarse or np.diff(table.time_s).max() > _LIMITS.long_step_s
    slip = None if is_sparse else velocity_slip(table)
    if slip is not None:
        is_refused = slip.is_systematic and slip.difference_m_s >= _LIMITS.refused_m_s
        (refused if is_refused else warnings).append(_slip_text(slip))
    warnings += [*_doubts_of_motion(table), *_doubts_of_heights(table)]
    return Findings(tuple(refused), tuple(warnings), table.notes)


def _misread(table: StateTable) -> list[str]:
    """Return the reason to refuse a table that falls freely only if read otherwise."""
    # Telemetry has no axes, and its speeds are looked at when it is read.
    misreading = None if table.frame == TELEMETRY else misreading_of(table)
    if misreading is None:
        return []
    words = (
        f"line {table.line_of(0)}: read {misreading.slip}, {misreading.evidence};"
        f" {misreading.remedy}, or set as_given: true"
    )
    return [words]


def _two_places(table: StateTable) -> list[str]:
    """Return the reason to refuse states that repeat others, or times with two places each."""
    rows = np.flatnonzero(np.diff(table.time_s) == 0.0)
    apart_m = lengths(table.position_m[rows + 1] - table.position_m[rows])
    repeated = rows[apart_m <= _LIMITS.jump_m]
    if len(repeated) >= max(_LIMITS.jumps, _LIMITS.repeated_share * len(table.time_s)):
        return [_repeats_text(table, int(repeated[0]), len(repeated))]
    jumps = np.flatnonzero(apart_m > _LIMITS.jump_m)
    if len(jumps) < max(_LIMITS.jumps, _LIMITS.jump_share * len(table.time_s)):
        return []
    row = int(rows[jumps[0]])
    words = (
        f"line {table.line_of(row + 1)}: the same time as line {table.line_of(row)}, and a place"
        f" {apart_m[jumps[0]]:.3g} m away; so at {len(jumps)} times: give times with more decimals,"
        " or one state for each"
    )
    return [words]


def _repeats_text(table: StateTable, row: int, count: int) -> str:
    return (
        f"line {table.line_of(row + 1)}: repeats line {table.line_of(row)}; so do {count} of"
        f" {len(table.time_s)} states: leave them out"
    )


def _coarse_steps(table: StateTable) -> list[str]:
    """Return the reason to refuse steps that are too long to interpolate."""
    has_velocity = table.velocity_m_s is not None
    widest_rad = _LIMITS.step_rad if has_velocity else _LIMITS.step_without_velocities_rad
    direction = table.position_m / lengths(table.position_m)[:, None]
    swept_rad = np.arccos(np.clip(dot(direction[:-1], direction[1:]), -1.0, 1.0))
    swept_rad[np.diff(table.run) != 0] = 0.0
    row = int(swept_rad.argmax())
    if swept_rad[row] <= widest_rad:
        return []
    step_s = float(table.time_s[row + 1] - table.time_s[row])
    swept_deg = float(np.degrees(swept_rad[row]))
    words = (
        f"line {table.line_of(row + 1)}: {swept_deg:.3g}° around the Earth from the state before"
        f" it, in a step of {step_s:g} s; that cannot be interpolated: take states at most"
        f" {np.degrees(widest_rad):.0f}° apart"
    )
    return [words]


def _long_steps(table: StateTable) -> list[str]:
    """Return the reason to refuse steps in which the Earth turns too far.

    Geostationary satellites may have them. The angle of a step is that of a circular orbit over
    the turning Earth, or that of the velocity.
    """
    step_s = np.diff(table.time_s)
    step_s[np.diff(table.run) != 0] = 0.0
    radius_m = lengths(table.position_m[:-1])
    rate_rad_s = np.abs(np.sqrt(EARTH_MU_M3_S2 / radius_m**3) - EARTH_ROTATION_RAD_S)
    if table.velocity_m_s is not None:
        rate_rad_s = np.maximum(rate_rad_s, lengths(table.velocity_m_s[:-1]) / radius_m)
    is_unseen = (step_s > _LIMITS.long_step_s) & (rate_rad_s * step_s > _LIMITS.long_step_rad)
    if not is_unseen.any():
        return []
    row = int(is_unseen.argmax())
    turned_deg = float(np.degrees(EARTH_ROTATION_RAD_S * step_s[row]))
    words = (
        f"line {table.line_of(row + 1)}: a step of {step_s[row]:g} s, in which the Earth turns by"
        f" {turned_deg:.0f}°; the path over the turning Earth cannot be interpolated: take states"
        " at most an hour apart"
    )
    return [words]


def _no_overlap(table: StateTable, times: SceneTimes, start_s: float | None) -> Iterator[str]:
    """Yield the reason to refuse a table that has no time in common with its scene."""
    start = float(table.time_s[0])
    end = float(table.time_s[-1])
    if start < times.duration_s and end > 0.0:
        return
    line = f"line {table.line_of(0)}"
    if start_s is None:
        yield (
            f"{line}: its states, {times.text(start)} to {times.text(end)}, and the scene,"
            f" {times.text(0.0)} to {times.text(times.duration_s)}, have no time in common;"
            " set the scene's epoch, or take the ephemeris of that day"
        )
    else:
        yield (
            f"{line}: its times, {start:.12g} to {end:.12g} s of the scene, and the scene, 0 to"
            f" {times.duration_s:g} s, have nothing in common{scale_text(start - start_s, times)}"
        )


def scale_text(time: float, times: SceneTimes) -> str:
    """Return the scale that a time may be of, for a message."""
    for scale, unix_s in _SCALES:
        after_s = unix_s(time) - times.epoch_us * 1e-6
        earliest_s = -_DAY_S
        latest_s = max(_DAY_S, times.duration_s)
        if scale == "seconds of the day":
            after_s = time - times.epoch_us * 1e-6 % _DAY_S
            earliest_s = -1.0
            latest_s = times.duration_s
        if earliest_s < after_s < latest_s:
            way = f"subtract {time:.12g} from them"
            if "days" not in scale and "milli" not in scale:
                way += f", or set start_s: {after_s - time:.12g}"
            return (
                f"; they look like {scale}: the first is {times.text(after_s)}, {after_s:g} s after"
                f" the scene's start; {way}"
            )
    hint = f" ({moment_text(time)} if they are Unix seconds)" if 1e8 < time < 4e9 else ""
    return f"; times count from start_s of the scene{hint}: set start_s, or a longer duration_s"


def moment_text(unix_s: float) -> str:
    """Return Unix seconds as a time in UTC, `2026-04-01T12:00:00Z`; the number where no calendar
    has it.
    """
    if not abs(unix_s) < 1e11:
        return f"{unix_s:g} s"
    return f"{np.datetime64(round(unix_s), 's')}Z"


def _slip_text(slip: VelocitySlip) -> str:
    difference = (
        f"line {slip.line}: its velocity is {slip.difference_m_s:.3g} m/s off the change of the"
        " positions around it"
    )
    if not slip.is_systematic:
        return f"{difference}; is it a slip of the pen?"
    out = "or leave the velocities out: positions are enough"
    if not slip.cause:
        return (
            f"{difference}, and others are too, for none of the usual causes; mend the velocities,"
            f" {out}"
        )
    residual = max(slip.residual_m_s, 0.01)
    way = slip.remedy or "mend the velocities"
    return (
        f"{difference}; all look {slip.cause}: so read, they agree to {residual:.2g} m/s; {way},"
        f" {out}"
    )


def _doubts_of_motion(table: StateTable) -> Iterator[str]:
    row, speed = _fastest(table)
    rotation_m_s = EARTH_ROTATION_RAD_S * float(np.hypot(*table.position_m[row, :2]))
    is_descent = row > 0 and lengths(table.position_m[row - 1 : row + 1]).argmin() == 1
    fastest_m_s = _LIMITS.fastest_entry_m_s if is_descent else _LIMITS.fastest_m_s
    if speed > fastest_m_s + rotation_m_s:
        does = "comes in" if is_descent else "leaves the Earth"
        yield (
            f"line {table.line_of(row)}: reached at {speed:.6g} m/s, faster than what {does}; are"
            " times or lengths in other units?"
        )
    if speed < _LIMITS.slowest_m_s and lengths(table.position_m).min() < _LIMITS.still_above_m:
        yield (
            f"line {table.line_of(row)}: nothing moves faster than {speed:.3g} m/s; are its times"
            " in other units?"
        )
    row, acceleration = _hardest(table)
    if acceleration > _LIMITS.acceleration_m_s2:
        yield (
            f"line {table.line_of(row)}: the path turns with {acceleration:.4g} m/s² there,"
            f" {acceleration / 9.80665:.0f} g; a wrong state, or positions coarser than their"
            " steps: leave the state out, smooth them, or take fewer"
        )


def _fastest(table: StateTable) -> tuple[int, float]:
    """Return the row that is reached fastest, and at which mean speed, m/s."""
    reached = [(0.0, 0)]
    for rows in runs(table):
        if len(rows) > 1:
            chord = np.diff(table.position_m[rows], axis=0) / np.diff(table.time_s[rows])[:, None]
            speeds = lengths(chord)
            reached.append((float(speeds.max()), int(rows[1:][speeds.argmax()])))
    speed, row = max(reached)
    return row, speed


def _hardest(table: StateTable) -> tuple[int, float]:
    """Return the row after which the path turns hardest, and how hard, as of `_hardest_bend`: of a
    long table, about its hardest plain bend.
    """
    start = 0
    if len(table.time_s) > 2 * _LIMITS.bent_states:
        chord = np.diff(table.position_m, axis=0)
        bend_m = lengths(np.diff(chord, axis=0))
        start = max(int(bend_m.argmax()) - _LIMITS.bent_states, 0)
        rows = slice(start, start + 2 * _LIMITS.bent_states)
        velocity = None if table.velocity_m_s is None else table.velocity_m_s[rows]
        columns = {name: getattr(table, name)[rows] for name in ("time_s", "position_m", "run")}
        table = evolve(table, velocity_m_s=velocity, **columns)
    row, acceleration = _hardest_bend(table)
    return start + row, acceleration


def _hardest_bend(table: StateTable) -> tuple[int, float]:
    """Return the row after which the path as it is flown turns hardest, and its mean acceleration
    over a quarter of the interval, m/s²; bends of a few metres, of rounded positions, and of
    noise do not count.
    """
    steps_s = np.diff(table.time_s)
    rows = np.flatnonzero(steps_s > 0.0)
    length_s = steps_s[rows]
    # Times at whole states belong to the interval that follows them: these stay within their own.
    share = np.linspace(0.02, 0.98, 5)
    time_s = table.time_s[rows, None] + length_s[:, None] * share
    _, velocity = interpolant([table]).at(time_s.ravel())
    spans_s = np.diff(time_s, axis=1)[..., None]
    turn = np.diff(velocity.reshape(*time_s.shape, 3), axis=1) / spans_s
    hardest = lengths(turn).max(axis=1)
    bends_m = hardest * length_s**2
    is_told = hardest > _LIMITS.isolated * np.median(hardest)
    is_told |= np.median(bends_m) > _LIMITS.noisy_bend_m
    hardest[~is_told | (bends_m < _LIMITS.least_bend_m)] = 0.0
    row = hardest.argmax()
    return int(rows[row]), float(hardest[row])


def _radial_heights_m(position_m: FloatArray) -> FloatArray:
    """Return distances (n,) of positions (n, 3) from the ellipsoid along the radius: near it,
    heights.
    """
    radius_m = lengths(position_m)
    cosine = np.hypot(position_m[:, 0], position_m[:, 1]) / radius_m
    flattening = 1.0 - EARTH_ECCENTRICITY_SQUARED * cosine * cosine
    share = np.sqrt((1.0 - EARTH_ECCENTRICITY_SQUARED) / flattening)
    heights_m: FloatArray = radius_m - EARTH_EQUATORIAL_RADIUS_M * share
    return heights_m


def _doubts_of_heights(table: StateTable) -> Iterator[str]:
    above_m = _radial_heights_m(table.position_m)
    rows = np.flatnonzero(above_m < 0.99 * _LIMITS.least_height_m)
    if not len(rows):
        return
    height_m = ecef_to_geodetic(table.position_m[rows]).height_m
    lowest = int(height_m.argmin())
    row = int(rows[lowest])
    if height_m[lowest] < _LIMITS.least_height_m:
        yield (
            f"line {table.line_of(row)}: {-height_m[lowest]:.6g} m below the WGS 84 ellipsoid; are"
            " latitudes geocentric, or heights above something else?"
        )
