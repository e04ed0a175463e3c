"""Shooting: launch azimuth and burnout speed are corrected until the free flight comes down at the aim point.

Newton's method, with the derivatives of two-body arcs whatever the forces (they only have to point the way), starts
from a guess good to a few percent of the range.
"""

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.shot import Shot
from opir_core.geometry import ecef_to_eci, ecef_to_eci_state
from opir_core.geometry.vectors import components, length

_ITERATIONS = 60

#: Steps of the finite differences: rad, and a share of the speed.
_STEP = 1e-5

#: The largest correction at once: rad, and a share of the speed.
_LARGEST_STEP = 0.2


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def solved(shot: Shot, tolerance_m: float) -> tuple[FloatArray, FloatArray]:
    """Return azimuths (rad) and burnout speeds (m/s) whose flights hit the aim points to within the tolerance.

    Where none does, what came nearest. Trials that lead nowhere are nan, and are not followed.
    """
    two_body = shot.in_two_body_motion()
    azimuth_rad, speed_m_s = _corrected(two_body, *_guess(two_body), tolerance_m)
    if two_body is shot:
        return azimuth_rad, speed_m_s
    return _corrected(shot, azimuth_rad, speed_m_s, tolerance_m)


def _guess(shot: Shot) -> tuple[FloatArray, FloatArray]:
    """Return azimuths and burnout speeds that come down near the aim points."""
    azimuth_rad, speed_m_s = _guess_at_rest(shot)
    landing = shot.landing(azimuth_rad, speed_m_s)
    distance_m, duration_s = landing.distance_m(), landing.duration_s
    for _ in range(2):
        azimuth, speed = _guess_in_rotation(shot, azimuth_rad, speed_m_s, duration_s)
        landing = shot.landing(azimuth, speed)
        nearer = (landing.distance_m() < distance_m) | np.isnan(distance_m)
        azimuth_rad, speed_m_s = np.where(nearer, azimuth, azimuth_rad), np.where(nearer, speed, speed_m_s)
        distance_m = np.where(nearer, landing.distance_m(), distance_m)
        duration_s = np.where(nearer, landing.duration_s, duration_s)
    return azimuth_rad, speed_m_s


def _guess_at_rest(shot: Shot) -> tuple[FloatArray, FloatArray]:
    """Return azimuths and burnout speeds that hit on a sphere at rest, flown from the ground."""
    psi, azimuth_rad = shot.polar_rad(shot.aim_ecef_m)
    radius_m = length(*components(shot.site.launch_m))
    return azimuth_rad, hitting_speed_m_s(radius_m, radius_m, 0.5 * np.pi - shot.course.turn_rad, psi)


def _guess_in_rotation(
    shot: Shot, azimuth_rad: FloatArray, speed_m_s: FloatArray, duration_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return azimuths and burnout speeds nearer to those that hit, from a guess and its time of free flight.

    The aim point is turned on by that time, and hit in the inertial frame from the guess's burnout point at its
    inertial flight path angle; what the Earth's rotation brings is then taken off again.
    """
    position, relative = shot.burnout(azimuth_rad, speed_m_s)
    _, inertial = ecef_to_eci_state(position, relative, 0.0)
    aim = ecef_to_eci(shot.aim_ecef_m, np.where(np.isfinite(duration_s), duration_s, 0.0))
    up, radius_m = _direction(position)
    ahead, _ = _direction(_level(aim, up))
    level_m_s = length(*components(_level(inertial, up)))
    gamma = np.arctan2(_dot(inertial, up), level_m_s)
    psi = np.arctan2(_dot(aim, ahead), _dot(aim, up))
    speed = hitting_speed_m_s(radius_m, length(*components(aim)), gamma, psi)[:, None]
    wanted = speed * (np.sin(gamma)[:, None] * up + np.cos(gamma)[:, None] * ahead) - (inertial - relative)
    turn = np.arctan2(_dot(np.cross(wanted, relative), up), _dot(_level(wanted, up), relative))
    return azimuth_rad + turn, length(*components(wanted))


def hitting_speed_m_s(start_m: FloatArray, end_m: FloatArray, gamma_rad: FloatArray, psi_rad: FloatArray) -> FloatArray:
    """Return the speed that takes a two-body arc from one radius at a flight path angle to another radius.

    With the range angle psi, v² = (mu/r1) (1 - cos psi) / (cos gamma ((r1/r2) cos gamma - cos(gamma + psi))), written
    without cancellation (Bate, Mueller and White, Fundamentals of Astrodynamics, 1971, section 6.2, for r1 = r2).
    """
    half_sine = np.sin(0.5 * psi_rad)
    drop = (start_m - end_m) / end_m * np.cos(gamma_rad) + 2.0 * np.sin(gamma_rad + 0.5 * psi_rad) * half_sine
    speed: FloatArray = half_sine * np.sqrt(2.0 * EARTH_MU_M3_S2 / start_m / (np.cos(gamma_rad) * drop))
    return speed


def _corrected(
    shot: Shot, azimuth_rad: FloatArray, speed_m_s: FloatArray, tolerance_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return the unknowns after Newton's method, target by target; a step that brings none nearer is halved."""
    start = shot.landing(azimuth_rad, speed_m_s)
    # Rows: azimuth, speed, along, across, miss, share of Newton's step to take.
    now = np.stack([azimuth_rad, speed_m_s, start.along_m, start.across_m, start.miss_m, np.ones_like(azimuth_rad)])
    for _ in range(_ITERATIONS):
        rows = np.flatnonzero(now[4] > tolerance_m)
        if not rows.size:
            break
        part, (azimuth, speed, along, across, _, share) = shot.take(rows), now[:, rows]
        turn, gain = _newton_step(part.in_two_body_motion(), azimuth, speed, along, across)
        azimuth, speed = azimuth + share * turn, speed * (1.0 + share * gain)
        trial = part.landing(azimuth, speed)
        nearer = trial.distance_m() < np.hypot(along, across)
        now[5, rows] = np.where(nearer, np.minimum(2.0 * share, 1.0), 0.5 * share)
        better = np.stack([azimuth, speed, trial.along_m, trial.across_m, trial.miss_m])
        now[:5, rows[nearer]] = better[:, nearer]
    return now[0], now[1]


def _newton_step(
    shot: Shot, azimuth_rad: FloatArray, speed_m_s: FloatArray, along_m: FloatArray, across_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the corrections of azimuth, rad, and of speed, as a share of it, of bounded size."""
    count = len(azimuth_rad)
    azimuths = np.concatenate([azimuth_rad, azimuth_rad + _STEP, azimuth_rad])
    speeds = np.concatenate([speed_m_s, speed_m_s, speed_m_s * (1.0 + _STEP)])
    landings = shot.take(np.tile(np.arange(count), 3)).landing(azimuths, speeds)
    (along_by_turn, along_by_gain), (across_by_turn, across_by_gain) = (
        column.reshape(3, count)[1:] - column[:count] for column in (landings.along_m, landings.across_m)
    )
    determinant = along_by_gain * across_by_turn - along_by_turn * across_by_gain
    turn = _STEP * (across_by_gain * along_m - along_by_gain * across_m) / determinant
    gain = _STEP * (along_by_turn * across_m - across_by_turn * along_m) / determinant
    shrink = _LARGEST_STEP / np.maximum(np.hypot(turn, gain), _LARGEST_STEP)
    return turn * shrink, gain * shrink


def _direction(vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors and lengths."""
    size = length(*components(vectors))
    return vectors / size[:, None], size


def _level(vectors: FloatArray, up: FloatArray) -> FloatArray:
    """Return the part of vectors that is at right angles to unit vectors."""
    return vectors - _dot(vectors, up)[:, None] * up


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    (ax, ay, az), (bx, by, bz) = components(a), components(b)
    return ax * bx + ay * by + az * bz
