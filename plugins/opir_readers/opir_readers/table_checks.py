"""The plausibility of a table in its scene: times, speeds, accelerations, heights, and velocities
against positions.

What cannot be meant is refused; what may be meant gives a warning. Each finding has its line, its
figure, the likely cause and the way out.
"""

from collections.abc import Callable, Iterator

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.geometry import ecef_to_geodetic
from opir_core.plugin import StateTable
from opir_readers.free_fall import misreading_of
from opir_readers.interpolation import interpolant, runs
from opir_readers.velocity_checks import VelocitySlip, velocity_slip

#: Velocities that differ systematically from positions by this, m/s, are refused; by less,
#: reported.
_REFUSED_M_S = 5.0

#: No launch leaves the Earth faster than it takes to leave it for good, m/s.
_FASTEST_M_S = 11_200.0

#: What never moves faster than this over the ground, m/s, and comes below this height, m, was not
#: launched; a geosynchronous satellite stands as still.
_SLOWEST_M_S = 5.0
_STILL_ABOVE_M = 3e7

#: Accelerations above this, m/s², are more than twice those of any launch vehicle at burnout; bends
#: of a path below this, m, are the rounding of positions.
_MOST_ACCELERATION_M_S2 = 250.0
_LEAST_BEND_M = 20.0

#: Parts of an interval over which accelerations are averaged.
_PARTS = 4

#: A step that goes farther around the Earth than this, rad, cannot be interpolated: at these, the
#: polynomials of states with velocities are some 60 m off a low orbit, those of positions alone
#: some 500 m, and ten times more at 1.3 times.
_WIDEST_STEP_RAD = 1.0
_WIDEST_WITHOUT_VELOCITIES_RAD = 0.5

#: Two places of one time are nearer than this, m, where motion is not smooth there; farther at so
#: many times, times are rounded.
_LEAST_JUMP_M = 1.0
_FEWEST_JUMPS = 3

#: Heights below this, m, are below the ground everywhere: the Dead Sea's shore is at -430 m.
_LEAST_HEIGHT_M = -1000.0

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


@frozen
class Findings:
    """What of a table cannot be meant, and what may be an error."""

    refused: tuple[str, ...]
    warnings: tuple[str, ...]


def findings_of(
    table: StateTable,
    times: SceneTimes | None = None,
    start_s: float | None = None,
    *,
    as_given: bool = False,
) -> Findings:
    """Return what of a table is wrong in itself and, with the times of a scene, in that scene.

    `start_s` is the scene time of the table's time 0, None where its times are dates. With
    `as_given` a table that contradicts gravity is not refused.
    """
    refused = [] if times is None else [*_no_overlap(table, times, start_s)]
    coarse = [*_coarse_steps(table), *_two_places(table)]
    # States that cannot be interpolated say nothing of gravity.
    misread = [] if coarse else _misread(table)
    # Differences of positions that are far apart say nothing of velocities.
    slip = None if coarse else velocity_slip(table)
    is_refused = slip is not None and slip.is_systematic and slip.difference_m_s >= _REFUSED_M_S
    slips = [] if slip is None else [_slip_text(slip)]
    warnings = [
        *table.notes,
        *([] if is_refused else slips),
        *_doubts_of_motion(table),
        *_doubts_of_heights(table),
    ]
    if as_given:
        warnings = [*misread, *warnings]
        misread = []
    return Findings((*refused, *coarse, *misread, *(slips if is_refused else ())), tuple(warnings))


def _misread(table: StateTable) -> list[str]:
    """Return that the table is right only if read otherwise, if so."""
    found = misreading_of(table)
    if found is None:
        return []
    return [
        (
            f"line {table.line_of(0)}: its states seem to be {found.slip}: {found.evidence}; {found.remedy},"
            " or set as_given: true"
        )
    ]


def _two_places(table: StateTable) -> list[str]:
    """Return that several times have two places each, if so: no motion goes through them."""
    rows = np.flatnonzero(np.diff(table.time_s) == 0.0)
    apart_m = _length(table.position_m[rows + 1] - table.position_m[rows])
    rows = rows[apart_m > _LEAST_JUMP_M]
    if len(rows) < _FEWEST_JUMPS:
        return []
    row = int(rows[0])
    return [
        (
            f"line {table.line_of(row + 1)}: the same time as line {table.line_of(row)}, and a place"
            f" {apart_m[apart_m > _LEAST_JUMP_M][0]:.3g} m away; so at {len(rows)} times: give times"
            " with more decimals, or one state for each"
        )
    ]


def _coarse_steps(table: StateTable) -> list[str]:
    """Return that steps are too long to interpolate, if one is."""
    widest_rad = _WIDEST_WITHOUT_VELOCITIES_RAD if table.velocity_m_s is None else _WIDEST_STEP_RAD
    direction = table.position_m / _length(table.position_m)[:, None]
    swept_rad = np.arccos(np.clip((direction[:-1] * direction[1:]).sum(axis=-1), -1.0, 1.0))
    swept_rad[np.diff(table.run) != 0] = 0.0
    row = int(swept_rad.argmax())
    if swept_rad[row] <= widest_rad:
        return []
    step_s = float(table.time_s[row + 1] - table.time_s[row])
    swept_deg = float(np.degrees(swept_rad[row]))
    words = (
        f"line {table.line_of(row + 1)}: {swept_deg:.3g}° around the Earth from the state before"
        f" it, in a step of"
        f" {step_s:g} s; that cannot be interpolated: take states at most"
        f" {np.degrees(widest_rad):.0f}° apart"
    )
    return [words]


def _no_overlap(table: StateTable, times: SceneTimes, start_s: float | None) -> Iterator[str]:
    """Yield that a table has no time in common with its scene, if so."""
    first = float(table.time_s[0])
    last = float(table.time_s[-1])
    if first < times.duration_s and last > 0.0:
        return
    begin, end = (moment_text(times.epoch_us * 1e-6 + time_s) for time_s in (0.0, times.duration_s))
    if start_s is None:
        own = " to ".join(moment_text(times.epoch_us * 1e-6 + time_s) for time_s in (first, last))
        yield (
            f"line {table.line_of(0)}: its states, {own}, and the scene, {begin} to {end}, have no"
            f" time in common;"
            f" set the scene's epoch, or take the ephemeris of that day"
        )
    else:
        yield (
            f"line {table.line_of(0)}: its times, {first:.12g} to {last:.12g} s of the scene, and"
            f" the scene, 0 to"
            f" {times.duration_s:g} s, have nothing in common{scale_text(first - start_s, times)}"
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
            way = f"subtract {time:.12g} from them" + (
                f", or set start_s: {after_s - time:.12g}"
                if "days" not in scale and "milli" not in scale
                else ""
            )
            moment = moment_text(times.epoch_us * 1e-6 + after_s)
            return (
                f"; they look like {scale}: the first is {moment}, {after_s:g} s after the scene's"
                f" start; {way}"
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
    seen = (
        f"line {slip.line}: its velocity is {slip.difference_m_s:.3g} m/s off the change of the"
        f" positions around it"
    )
    if not slip.is_systematic:
        return f"{seen}; is it a slip of the pen?"
    out = "or leave the velocities out: positions are enough"
    if not slip.cause:
        return (
            f"{seen}, and others are too, for none of the usual causes; mend the velocities, {out}"
        )
    left = max(slip.residual_m_s, 0.01)
    way = slip.remedy or "mend the velocities"
    return f"{seen}; all look {slip.cause}: so read, they agree to {left:.2g} m/s; {way}, {out}"


def _doubts_of_motion(table: StateTable) -> Iterator[str]:
    row, speed = _fastest(table)
    if speed > _FASTEST_M_S + EARTH_ROTATION_RAD_S * float(
        _length(table.position_m[row : row + 1, :2])[0]
    ):
        yield (
            f"line {table.line_of(row)}: reached at {speed:.6g} m/s, faster than what leaves the"
            f" Earth; are times or"
            " lengths in other units?"
        )
    if speed < _SLOWEST_M_S and _length(table.position_m).min() < _STILL_ABOVE_M:
        yield f"line {table.line_of(row)}: nothing moves faster than {speed:.3g} m/s; are its times in other units?"
    row, acceleration = _hardest(table)
    if acceleration > _MOST_ACCELERATION_M_S2:
        yield (
            f"line {table.line_of(row)}: the path turns with {acceleration:.4g} m/s² there,"
            f" {acceleration / 9.80665:.0f} g; a wrong state, or positions coarser than their"
            f" steps: leave the state"
            " out, smooth them, or take fewer"
        )


def _fastest(table: StateTable) -> tuple[int, float]:
    """Return the row that is reached fastest, and at which mean speed, m/s."""
    found = [(0.0, 0)]
    for rows in runs(table):
        if len(rows) > 1:
            chord = np.diff(table.position_m[rows], axis=0) / np.diff(table.time_s[rows])[:, None]
            speeds = _length(chord)
            found.append((float(speeds.max()), int(rows[1:][speeds.argmax()])))
    speed, row = max(found)
    return row, speed


def _hardest(table: StateTable) -> tuple[int, float]:
    """Return the row after which the path as it is flown turns hardest, and its mean acceleration
    over a quarter of the interval, m/s²; bends of a few metres, of rounded positions, do not
    count."""
    start_s = table.time_s[:-1]
    length_s = np.diff(table.time_s)
    rows = np.flatnonzero(length_s > 0.0)
    # Times at whole states belong to the interval that follows them: these stay within their own.
    share = np.linspace(0.02, 0.98, _PARTS + 1)
    time_s = start_s[rows, None] + length_s[rows, None] * share
    _, velocity = interpolant([table]).state(np.zeros(time_s.size, np.intp), time_s.ravel())
    turn = np.diff(velocity.reshape(*time_s.shape, 3), axis=1) / np.diff(time_s, axis=1)[..., None]
    hardest = np.sqrt((turn * turn).sum(axis=2)).max(axis=1)
    hardest[hardest * length_s[rows] ** 2 < _LEAST_BEND_M] = 0.0
    row = int(hardest.argmax())
    return int(rows[row]), float(hardest[row])


def _doubts_of_heights(table: StateTable) -> Iterator[str]:
    height_m = ecef_to_geodetic(table.position_m).height_m
    row = int(height_m.argmin())
    if height_m[row] < _LEAST_HEIGHT_M:
        yield (
            f"line {table.line_of(row)}: {-height_m[row]:.6g} m below the WGS 84 ellipsoid; are"
            f" latitudes geocentric,"
            " or heights above something else?"
        )


def _length(vectors: FloatArray) -> FloatArray:
    return np.sqrt((vectors * vectors).sum(axis=1))
