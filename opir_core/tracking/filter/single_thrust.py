"""What `thrust` works out for columns of states, for one state's numbers, as `single_states` does for `motion`.

Where bits are said to be the same, the operations are the same in the same order.
"""

from collections.abc import Callable, Sequence
from math import sqrt
from typing import Any

from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.tracking.filter import single_states
from opir_core.tracking.filter.single_states import Pull

#: Where a target is slower than this the direction of its velocity says little of that of its thrust, m/s; at rest, for
#: whose sake all speeds are taken for larger by 1 m/s in squares, it says nothing.
SLOW_M_S = 100.0

_SPIN = EARTH_ROTATION_RAD_S


def jerk(numbers: Sequence[Any], tilt_s: float, root: Callable[[Any], Any]) -> tuple[Any, Any, Any]:
    """Return the rate of the specific force from a state and its gravity, as 13 numbers or columns (n,): the same bits.

    ḟ = κ f + (f·u) u̇ - w/τ (f - (f·u) u), with u̇ the turn of the velocity and w what a slow velocity counts for.
    """
    x, y, _, vx, vy, vz, fx, fy, fz, growth, gx, gy, gz = numbers
    ax, ay, az = gx + fx + _SPIN * vy, gy + fy - _SPIN * vx, gz + fz
    vx, vy = vx + _SPIN * y, vy - _SPIN * x
    square = vx * vx + vy * vy + vz * vz
    speed = root(square + 1.0)
    ux, uy, uz = vx / speed, vy / speed, vz / speed
    soft = 1.0 / (square + SLOW_M_S * SLOW_M_S)
    lift, ahead = fx * ux + fy * uy + fz * uz, ax * ux + ay * uy + az * uz
    turn, pull = lift * speed * soft, square * soft / tilt_s
    own, back = growth - pull, pull * lift - turn * ahead
    return own * fx + turn * ax + back * ux, own * fy + turn * ay + back * uy, own * fz + turn * az + back * uz


def stepped(state: Sequence[float], step: float, tilt_s: float, pull: Pull) -> list[float]:
    """Return a state of 10 after one step, the same bits as `Thrust`'s."""
    gravity = pull(*state[:3])
    early = jerk((*state, *gravity[:3]), tilt_s, sqrt)
    after = single_states.stepped([*state[:9], *early], step, pull, gravity)[:9]
    late = jerk((*after, state[9], *pull(*after[:3])[:3]), tilt_s, sqrt)
    x, y, z, vx, vy, vz, fx, fy, fz = after
    bx, by, bz = late[0] - early[0], late[1] - early[1], late[2] - early[2]
    far, fast, more = step**3 / 24.0, step**2 / 6.0, step / 2.0
    place, speed = (x + bx * far, y + by * far, z + bz * far), (vx + bx * fast, vy + by * fast, vz + bz * fast)
    return [*place, *speed, fx + bx * more, fy + by * more, fz + bz * more, state[9]]


def taylor(state: Sequence[float], tilt_s: float, pull: Pull, mu_m3_s2: float) -> list[float]:
    """Return the derivatives of the position, from the zeroth to the fourth, of a state of 10; the same bits."""
    gravity = pull(*state[:3])
    rate = jerk((*state, *gravity[:3]), tilt_s, sqrt)
    return single_states.taylor([*state[:9], *rate], gravity, mu_m3_s2)


def slopes(state: Sequence[float], tilt_s: float, gravity: Sequence[float]) -> list[float]:
    """Return how the rate of the force changes with velocity, force and growth of a state: three rows of seven.

    As `Thrust.force_slopes` says it, but for rounding.
    """
    x, y, _, wx, wy, vz, fx, fy, fz, growth = state
    vx, vy, pull = wx + _SPIN * y, wy - _SPIN * x, 1.0 / tilt_s
    square = vx * vx + vy * vy + vz * vz
    speed = sqrt(square + 1.0)
    soft = 1.0 / (square + SLOW_M_S * SLOW_M_S)
    turn, fast = speed * soft, square * soft
    unit = ux, uy, uz = vx / speed, vy / speed, vz / speed
    px, py, pz = gravity[0] + fx + _SPIN * wy, gravity[1] + fy - _SPIN * wx, gravity[2] + fz
    ahead, lift = ux * px + uy * py + uz * pz, ux * fx + uy * fy + uz * fz
    bend = bx, by, bz = px - ux * ahead, py - uy * ahead, pz - uz * ahead
    across = cx, cy, cz = fx - ux * lift, fy - uy * lift, fz - uz * lift
    same, other = lift * (turn * pull - soft * ahead), lift * turn - fast * pull
    first, second, third = lift * soft, turn * pull, lift * soft * (1.0 - 2.0 * fast)
    fourth, own = -2.0 * pull * turn * (1.0 - fast), growth + other
    rows: list[float] = []
    for k, (u, b, c, f) in enumerate(zip(unit, bend, across, (fx, fy, fz), strict=True)):
        p, q, r, s = third * b + fourth * c - same * u, -first * u, second * u + soft * b, turn * b - other * u
        row = [p * ux + q * bx + r * cx, p * uy + q * by + r * cy, p * uz + q * bz + r * cz, s * ux, s * uy, s * uz, f]
        row[k] += same
        row[3 + k] += own
        rows += row
    return rows


def side(state: Sequence[float], across_share: float, along_noise: float) -> list[float]:
    """Return a root of the force's noise a second, three rows of three one after the other.

    Across the velocity it is `across_share` of the force, along it `along_noise`, m/s²/√s.
    """
    x, y, _, wx, wy, vz, fx, fy, fz, _ = state
    velocity = wx + _SPIN * y, wy - _SPIN * x, vz
    across = across_share * sqrt(fx * fx + fy * fy + fz * fz)
    share = (along_noise - across) / (velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2 + 1.0)
    u, v, w = velocity
    xy, xz, yz = share * u * v, share * u * w, share * v * w
    return [share * u * u + across, xy, xz, xy, share * v * v + across, yz, xz, yz, share * w * w + across]
