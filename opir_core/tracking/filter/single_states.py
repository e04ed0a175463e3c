"""What `motion` works out for columns of states, for one state's numbers: the same operations in the same order.

So the bits are the same, and for a few states, where numpy's calls cost more than its arithmetic, they come far sooner.
"""

from collections.abc import Callable, Sequence
from math import sqrt

#: The acceleration of gravity at x, y and z, and a fourth number that is not asked for.
Pull = Callable[[float, float, float], tuple[float, float, float, float]]


def gradient(place: Sequence[float], mu_m3_s2: float) -> list[float]:
    """Return the gradient of a point mass's gravity, three rows of three one after the other."""
    x, y, z = place
    square = x * x + y * y + z * z
    scale = mu_m3_s2 / (square * sqrt(square))
    factor = 3.0 * scale / square
    wx, wy, wz = x * factor, y * factor, z * factor
    return [wx * x - scale, wx * y, wx * z, wy * x, wy * y - scale, wy * z, wz * x, wz * y, wz * z - scale]


def transition(place: Sequence[float], step: float, mu_m3_s2: float) -> list[float]:
    """Return the transition matrix of a fall, six rows of six one after the other."""
    bent = gradient(place, mu_m3_s2)
    rows, columns = (bent[:3], bent[3:6], bent[6:]), (bent[::3], bent[1::3], bent[2::3])
    second = step * (step / 2.0)
    third = second * (step / 3.0)
    fourth = third * (step / 4.0)
    above: list[float] = []
    below: list[float] = []
    for k, (x, y, z) in enumerate(rows):
        place_row, speed_row = [second * x, second * y, second * z], [third * x, third * y, third * z]
        place_row[k] += 1.0
        speed_row[k] += step
        below += (step * x, step * y, step * z, *place_row)
        above += [near + fourth * (x * p + y * q + z * r) for near, (p, q, r) in zip(place_row, columns, strict=True)]
        above += speed_row
    return above + below


def stepped(state: Sequence[float], step: float, pull: Pull, gravity: Sequence[float]) -> list[float]:
    """Return a state of 6, or of 12 with a specific force and its rate, after one step of Nyström's method.

    `gravity` is what `pull` is where the step starts.
    """
    half = 0.5 * step
    x, y, z, u, v, w = state[:6]
    mx, my, mz, ex, ey, ez = x + half * u, y + half * v, z + half * w, x + step * u, y + step * v, z + step * w
    rest = list(state[6:])
    if rest:
        fx, fy, fz, jx, jy, jz = rest
        sixth, near, far = half / 6.0, half * half, step * step
        mx, my, mz = (
            mx + near * (0.5 * fx + sixth * jx),
            my + near * (0.5 * fy + sixth * jy),
            mz + near * (0.5 * fz + sixth * jz),
        )
        sixth = step / 6.0
        ex, ey, ez = (
            ex + far * (0.5 * fx + sixth * jx),
            ey + far * (0.5 * fy + sixth * jy),
            ez + far * (0.5 * fz + sixth * jz),
        )
        u, v, w = u + step * (fx + half * jx), v + step * (fy + half * jy), w + step * (fz + half * jz)
        rest[:3] = fx + step * jx, fy + step * jy, fz + step * jz
    ax, ay, az, _ = gravity
    bent = 0.5 * half * half
    bx, by, bz, _ = pull(mx + bent * ax, my + bent * ay, mz + bent * az)
    fall = half * step
    cx, cy, cz, _ = pull(ex + fall * bx, ey + fall * by, ez + fall * bz)
    sixth, share = step * step / 6.0, step / 6.0
    place = [ex + sixth * (ax + 2.0 * bx), ey + sixth * (ay + 2.0 * by), ez + sixth * (az + 2.0 * bz)]
    speed = [u + share * (ax + 4.0 * bx + cx), v + share * (ay + 4.0 * by + cy), w + share * (az + 4.0 * bz + cz)]
    return [*place, *speed, *rest]


def taylor(state: Sequence[float], gravity: Sequence[float], mu_m3_s2: float) -> list[float]:
    """Return the derivatives of the position, from the zeroth to the fourth, of a state of 6 or of 12: 15 numbers.

    `gravity` is that at the state's position, as `Pull` says it.
    """
    x, y, z, u, v, w = state[:6]
    square = x * x + y * y + z * z
    scale = mu_m3_s2 / (square * sqrt(square))
    a, b, c, _ = gravity
    climb = x * u + y * v + z * w
    share = climb / square
    third = 3.0 * share
    rate = scale * (third * x - u), scale * (third * y - v), scale * (third * z - w)
    if len(state) > 6:
        a, b, c = a + state[6], b + state[7], c + state[8]
        rate = rate[0] + state[9], rate[1] + state[10], rate[2] + state[11]
    inward = (x * a + y * b + z * c + (u * u + v * v + w * w) - 5.0 * climb * share) / square
    near, along = 3.0 * inward, 6.0 * share
    bend = (
        scale * (near * x + along * u - a),
        scale * (near * y + along * v - b),
        scale * (near * z + along * w - c),
    )
    return [x, y, z, u, v, w, a, b, c, *rate, *bend]
