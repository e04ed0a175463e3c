"""What `motion` works out for columns of states, for one state's numbers: the same operations in the same order.

So the bits are the same, and for a few states, where numpy's calls cost more than its arithmetic, they come far sooner.
"""

from collections.abc import Callable, Sequence
from math import sqrt

#: The acceleration of gravity at x, y and z, and a fourth number that is not asked for.
Pull = Callable[[float, float, float], tuple[float, float, float, float]]


def gradient(place: Sequence[float], mu_m3_s2: float) -> list[list[float]]:
    """Return the gradient of a point mass's gravity, three rows of three."""
    x, y, z = place
    square = x * x + y * y + z * z
    scale = mu_m3_s2 / (square * sqrt(square))
    factor = 3.0 * scale / square
    wx, wy, wz = x * factor, y * factor, z * factor
    return [[wx * x - scale, wx * y, wx * z], [wy * x, wy * y - scale, wy * z], [wz * x, wz * y, wz * z - scale]]


def stepped(state: Sequence[float], step: float, pull: Pull) -> list[float]:
    """Return a state of 6, or of 12 with a specific force and its rate, after one step of Nyström's method."""
    half = 0.5 * step
    place, speed, rest = state[:3], state[3:6], list(state[6:])
    middle = [p + half * v for p, v in zip(place, speed, strict=True)]
    end = [p + step * v for p, v in zip(place, speed, strict=True)]
    if rest:
        force, jerk = rest[:3], rest[3:]
        pairs = list(zip(force, jerk, strict=True))
        middle = [m + half * half * (0.5 * f + half / 6.0 * j) for m, (f, j) in zip(middle, pairs, strict=True)]
        end = [e + step * step * (0.5 * f + step / 6.0 * j) for e, (f, j) in zip(end, pairs, strict=True)]
        speed = [v + step * (f + half * j) for v, (f, j) in zip(speed, pairs, strict=True)]
        rest[:3] = [f + step * j for f, j in pairs]
    start = pull(*place)[:3]
    bent = 0.5 * half * half
    midway = pull(*(m + bent * g for m, g in zip(middle, start, strict=True)))[:3]
    fall = half * step
    last = pull(*(e + fall * g for e, g in zip(end, midway, strict=True)))[:3]
    sixth, share = step * step / 6.0, step / 6.0
    after = [e + sixth * (a + 2.0 * b) for e, a, b in zip(end, start, midway, strict=True)]
    faster = [v + share * (a + 4.0 * b + c) for v, a, b, c in zip(speed, start, midway, last, strict=True)]
    return [*after, *faster, *rest]


def taylor(state: Sequence[float], pull: Pull, mu_m3_s2: float) -> list[list[float]]:
    """Return the derivatives of the position, from the zeroth to the fourth, of a state of 6 or of 12."""
    x, y, z, u, v, w = state[:6]
    square = x * x + y * y + z * z
    scale = mu_m3_s2 / (square * sqrt(square))
    a, b, c, _ = pull(x, y, z)
    climb = x * u + y * v + z * w
    share = climb / square
    third = 3.0 * share
    rate = [scale * (third * x - u), scale * (third * y - v), scale * (third * z - w)]
    if len(state) > 6:
        a, b, c = a + state[6], b + state[7], c + state[8]
        rate = [rate[0] + state[9], rate[1] + state[10], rate[2] + state[11]]
    inward = (x * a + y * b + z * c + (u * u + v * v + w * w) - 5.0 * climb * share) / square
    near, along = 3.0 * inward, 6.0 * share
    bend = [
        scale * (near * x + along * u - a),
        scale * (near * y + along * v - b),
        scale * (near * z + along * w - c),
    ]
    return [[x, y, z], [u, v, w], [a, b, c], rate, bend]
