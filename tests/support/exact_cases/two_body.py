"""Two-body motion to as many digits as mpmath is set to, by universal functions in closed form."""

import mpmath


def exact_functions(alpha, s):
    """Return G0..G3 to 50 digits, by their closed forms with digits to spare for what cancels."""
    z = alpha * s * s
    lost = 0 if z == 0 else max(0, int(-2.0 * mpmath.log10(abs(z))))
    with mpmath.workdps(56 + lost):
        if z == 0:
            return mpmath.mpf(1), s, s * s / 2, s**3 / 6
        k = mpmath.sqrt(abs(alpha))
        cosine, sine = (mpmath.cos, mpmath.sin) if z > 0 else (mpmath.cosh, mpmath.sinh)
        c = cosine(k * s)
        d = sine(k * s)
        return c, d / k, (1 - c) / alpha, (s - d / k) / alpha


def exact_anomaly(r, eta, beta, mu, time):
    """Return the anomaly at a time, by Newton's method in a bracket; time rises with it."""

    def late(s):
        g = exact_functions(beta, s)
        return r * g[1] + eta * g[2] + mu * g[3] - time, r * g[0] + eta * g[1] + mu * g[2]

    low = mpmath.mpf(0)
    high = mpmath.cbrt(time / mu)
    while late(high)[0] < 0:
        low = high
        high = 2 * high
    s = (low + high) / 2
    previous = mpmath.inf
    for _ in range(2000):
        excess, slope = late(s)
        low, high = (s, high) if excess < 0 else (low, s)
        step = excess / slope if slope > 0 else mpmath.inf
        is_newton = low < s - step < high and abs(excess) < previous / 2
        moved = s - step if is_newton else (low + high) / 2
        previous = abs(excess) if is_newton else mpmath.inf
        if abs(moved - s) <= abs(s) * mpmath.mpf(10) ** -54 or low == high:
            return moved
        s = moved
    raise AssertionError("the reference did not converge")


def exact_end(state):
    """Return the end position and velocity of (x, y, z, vx, vy, vz, duration, mu), all mpmath
    numbers.
    """
    position = state[:3]
    velocity = state[3:6]
    duration = state[6]
    mu = state[7]
    if duration == 0:
        return position, velocity
    sense = 1 if duration > 0 else -1
    r = mpmath.sqrt(mpmath.fdot(position, position))
    eta = sense * mpmath.fdot(position, velocity)
    beta = 2 * mu / r - mpmath.fdot(velocity, velocity)
    time = abs(duration)
    if beta > 0:
        period = 2 * mpmath.pi * mu / beta ** (mpmath.mpf(3) / 2)
        time -= period * mpmath.floor(time / period)
    g0, g1, g2, _ = (
        exact_functions(beta, exact_anomaly(r, eta, beta, mu, time)) if time else (1, 0, 0, 0)
    )
    end = r * g0 + eta * g1 + mu * g2
    f = 1 - mu * g2 / r
    g = sense * (r * g1 + eta * g2)
    f_rate = -sense * mu * g1 / (r * end)
    g_rate = 1 - mu * g2 / end
    pairs = list(zip(position, velocity, strict=True))
    return [f * x + g * v for x, v in pairs], [f_rate * x + g_rate * v for x, v in pairs]
