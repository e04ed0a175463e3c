"""Two-body propagation: nanoseconds a state and worst error by class of arc, beside the libraries that are installed.

    python benchmarks/work_precision/kepler.py [--states 100000] [--checked 60] [--repeat 9] [--write]

Every library gets the same states, in a process of its own, one thread; medians of the CPU time of interleaved runs.
The error is taken against mpmath with 50 digits; the floor is what rounding each input to the nearest double does by
itself (condition number × 1.1e-16 × distance). Peers are optional: heyoka, pykep, boinor with numba. `--write` puts the
tables into docs/benchmarks/kepler.md.
"""

import argparse
import multiprocessing
import os
import platform
import statistics
import sys
import time
import types
import warnings
from collections.abc import Callable
from importlib.metadata import version
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import mpmath
import numpy as np

from opir_core.constants import EARTH_MU_M3_S2 as MU
from opir_core.flight.kepler import propagate_kepler

PAGE = Path(__file__).parents[2] / "docs" / "benchmarks" / "kepler.md"

States = tuple[np.ndarray, ...]
Propagator = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def frames(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of unit vectors at right angles."""
    first, second = rng.normal(size=(2, count, 3))
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(first, second)
    return first, second / np.linalg.norm(second, axis=1)[:, None]


def flights(rng: np.random.Generator, count: int, elevation: np.ndarray, speed: np.ndarray) -> States:
    """Return burnouts at 100 to 300 km, with times anywhere up to the way back to that height."""
    up, along = frames(rng, count)
    radius = 6378e3 + rng.uniform(100e3, 300e3, count)
    climb, across = speed * np.sin(elevation), speed * np.cos(elevation)
    velocity = climb[:, None] * up + across[:, None] * along
    sinking = MU / radius**2 - across**2 / radius
    return radius[:, None] * up, velocity, rng.uniform(0.0, 1.0, count) * np.minimum(2.0 * climb / sinking, 3600.0)


def conics(rng: np.random.Generator, e: np.ndarray, q: np.ndarray, nu: np.ndarray, duration: np.ndarray) -> States:
    """Return states on conics of these eccentricities, pericentre distances and true anomalies."""
    ahead, along = frames(rng, e.size)
    p = q * (1.0 + e)
    r, scale = p / (1.0 + e * np.cos(nu)), np.sqrt(MU / p)
    position = r[:, None] * (np.cos(nu)[:, None] * ahead + np.sin(nu)[:, None] * along)
    velocity = scale[:, None] * (-np.sin(nu)[:, None] * ahead + (e + np.cos(nu))[:, None] * along)
    return position, velocity, duration


def ballistic(rng: np.random.Generator, count: int) -> States:
    return flights(rng, count, np.radians(rng.uniform(15.0, 80.0, count)), rng.uniform(2e3, 7.2e3, count))


def near_circular(rng: np.random.Generator, count: int) -> States:
    e, q = 10.0 ** rng.uniform(-16.0, -3.0, count), rng.uniform(6.6e6, 4.2e7, count)
    return conics(rng, e, q, rng.uniform(-np.pi, np.pi, count), rng.uniform(-1.0, 1.0, count) * 86400.0)


def near_parabolic(rng: np.random.Generator, count: int) -> States:
    e = 1.0 + 10.0 ** rng.uniform(-15.0, -3.0, count) * rng.choice([-1.0, 1.0], count)
    return conics(
        rng, e, rng.uniform(6.5e6, 2e7, count), rng.uniform(-2.5, 2.5, count), rng.uniform(-1.0, 1.0, count) * 86400.0
    )


def near_rectilinear(rng: np.random.Generator, count: int) -> States:
    off = 10.0 ** rng.uniform(-12.0, -7.0, count)
    return flights(rng, count, 0.5 * np.pi - off, rng.uniform(1e3, 7e3, count))


def vertical(rng: np.random.Generator, count: int) -> States:
    position, velocity, duration = flights(rng, count, np.full(count, 0.5 * np.pi), rng.uniform(1e3, 7e3, count))
    climb = np.linalg.norm(velocity, axis=1) / np.linalg.norm(position, axis=1)
    return position, climb[:, None] * position, duration


def hyperbolic(rng: np.random.Generator, count: int) -> States:
    e = rng.uniform(1.01, 10.0, count)
    nu = 0.98 * np.arccos(-1.0 / e) * rng.uniform(-1.0, 1.0, count)
    return conics(rng, e, rng.uniform(6.5e6, 5e7, count), nu, rng.uniform(-1.0, 1.0, count) * 86400.0)


CLASSES = (ballistic, near_circular, near_parabolic, near_rectilinear, vertical, hyperbolic)


def by_heyoka() -> Propagator:
    """Return heyoka's compiled function: Kepler's equation of the difference of eccentric anomalies, ellipses only."""
    import heyoka as hy

    x, y, z, u, v, w, t = hy.make_vars("x", "y", "z", "u", "v", "w", "t")
    r = hy.sqrt(x * x + y * y + z * z)
    a = 1.0 / (2.0 / r - (u * u + v * v + w * w) / MU)
    eta = (x * u + y * v + z * w) / np.sqrt(MU)
    s0, c0 = eta / hy.sqrt(a), 1.0 - r / a
    step = hy.kepDE(s0, c0, t * hy.sqrt(MU / (a * a * a)))
    c, s = hy.cos(step), hy.sin(step)
    end = a + (r - a) * c + eta * hy.sqrt(a) * s
    f, g = 1.0 - a / r * (1.0 - c), a * eta / MU**0.5 * (1.0 - c) + r * hy.sqrt(a / MU) * s
    df, dg = -hy.sqrt(MU * a) / (end * r) * s, 1.0 - a / end * (1.0 - c)
    pairs = ((x, u), (y, v), (z, w))
    outputs = [f * p + g * q for p, q in pairs] + [df * p + dg * q for p, q in pairs]
    compiled = hy.cfunc(outputs, [x, y, z, u, v, w, t])

    def propagate(position: np.ndarray, velocity: np.ndarray, duration: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        columns = np.ascontiguousarray(np.column_stack([position, velocity, duration]).T)
        end = compiled(columns)
        return end[:3].T, end[3:].T

    return propagate


def by_pykep() -> Propagator:
    """Return pykep's Lagrangian propagation, one call a state."""
    # pykep 3.0.1's wheel lacks the data files of its trajectory gym, without which it does not import.
    sys.modules.setdefault("pykep.trajopt.gym", types.ModuleType("pykep.trajopt.gym"))
    import pykep

    def propagate(position: np.ndarray, velocity: np.ndarray, duration: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        states = np.stack([position, velocity], axis=1)
        ends = [
            pykep.propagate_lagrangian(rv, tof, MU, False) for rv, tof in zip(states, duration.tolist(), strict=True)
        ]
        end = np.array(ends)
        return end[:, 0], end[:, 1]

    return propagate


def by_boinor_farnocchia() -> Propagator:
    return by_boinor("farnocchia")


def by_boinor_vallado() -> Propagator:
    return by_boinor("vallado")


def by_boinor(kernel_name: str) -> Propagator:
    """Return one of boinor's kernels, looped over in numba, in its own unit, the kilometre."""
    import boinor.core.propagation as kernels
    import numba

    kernel = getattr(kernels, kernel_name)
    mu = MU / 1e9

    def by_coefficients(r, v, t):  # type: ignore[no-untyped-def]
        f, g, f_rate, g_rate = kernel(mu, r, v, t, 100)
        return f * r + g * v, f_rate * r + g_rate * v

    def by_elements(r, v, t):  # type: ignore[no-untyped-def]
        return kernel(mu, r, v, t)

    single = numba.njit(by_coefficients if kernel_name == "vallado" else by_elements)

    @numba.njit  # type: ignore[untyped-decorator]
    def loop(position, velocity, duration, end):  # type: ignore[no-untyped-def]
        for i in range(duration.size):
            end[0, i], end[1, i] = single(position[i], velocity[i], duration[i])

    def propagate(position: np.ndarray, velocity: np.ndarray, duration: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        end = np.full((2, duration.size, 3), np.nan)
        loop(position / 1e3, velocity / 1e3, duration, end)
        return end[0] * 1e3, end[1] * 1e3

    return propagate


def by_opir() -> Propagator:
    return propagate_kepler


LIBRARIES: dict[str, tuple[str, Callable[[], Propagator]]] = {
    "opir, numpy": ("numpy", by_opir),
    "heyoka, compiled function": ("heyoka", by_heyoka),
    "pykep, call a state": ("pykep", by_pykep),
    "boinor farnocchia, in numba": ("boinor", by_boinor_farnocchia),
    "boinor vallado, in numba": ("boinor", by_boinor_vallado),
}


def serve(label: str, pipe: Connection) -> None:
    """Answer states with end positions and the time taken, in a process of its own: heyoka and pykep bear no other."""
    warnings.simplefilter("ignore")
    distribution, make = LIBRARIES[label]
    try:
        propagate = make()
    except Exception as reason:
        pipe.send(f"{type(reason).__name__}: {reason}")
        return
    pipe.send((version(distribution),))
    while (states := pipe.recv()) is not None:
        before = time.process_time()
        try:
            end = propagate(*states)[0]
        except Exception:
            end = None
        pipe.send((end, time.process_time() - before))
    pipe.send("done")
    os._exit(0)  # pykep aborts a process that ends by itself


class Library:
    """A propagator in its own process; calling it returns end positions (none if it raised) and seconds."""

    def __init__(self, label: str) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=serve, args=(label, theirs), daemon=True)
        self.process.start()
        theirs.close()
        answer = self.answer()
        self.problem = answer if isinstance(answer, str) else ""
        self.version = "" if self.problem else answer[0]

    def answer(self) -> Any:
        try:
            return self.pipe.recv()
        except EOFError:
            return "the process died"

    def __call__(self, states: States) -> tuple[np.ndarray | None, float]:
        self.pipe.send(states)
        answer: tuple[np.ndarray | None, float] = self.answer()
        return answer

    def close(self) -> None:
        self.pipe.send(None)
        self.answer()


def installed_libraries() -> dict[str, Library]:
    """Return opir's propagator and those of the peers that can be imported, by name and version."""
    found = {}
    for label in LIBRARIES:
        library = Library(label)
        if library.problem:
            print(f"{label}: left out ({library.problem})", file=sys.stderr)
        else:
            found[f"{label} {library.version}"] = library
    return found


def exact_position(state: list[mpmath.mpf]) -> list[mpmath.mpf]:
    """Return the end position of (x, y, z, vx, vy, vz, duration, mu) to 50 digits, by universal variables."""
    position, velocity, duration, mu = state[:3], state[3:6], state[6], state[7]
    r, eta = mpmath.sqrt(mpmath.fdot(position, position)), mpmath.fdot(position, velocity)
    beta = 2 * mu / r - mpmath.fdot(velocity, velocity)
    if beta > 0:
        period = 2 * mpmath.pi * mu / beta ** (mpmath.mpf(3) / 2)
        duration -= period * mpmath.nint(duration / period)

    def functions(s: mpmath.mpf) -> tuple[mpmath.mpf, ...]:
        z = beta * s * s
        if abs(z) < 1e-12:
            return (
                1 - z / 2,
                s * (1 - z / 6),
                s * s * (0.5 - z / 24 + z * z / 720),
                s**3 * (1 - z / 20 + z * z / 840) / 6,
            )
        k = mpmath.sqrt(abs(beta))
        c, d = (mpmath.cos(k * s), mpmath.sin(k * s)) if beta > 0 else (mpmath.cosh(k * s), mpmath.sinh(k * s))
        return c, d / k, (1 - c) / beta, (s - d / k) / beta

    def late(s: mpmath.mpf) -> tuple[mpmath.mpf, mpmath.mpf]:
        g = functions(s)
        return r * g[1] + eta * g[2] + mu * g[3] - duration, r * g[0] + eta * g[1] + mu * g[2]

    sense = 1 if duration >= 0 else -1
    low, high = mpmath.mpf(0), sense * mpmath.cbrt(abs(duration) / mu)
    while sense * late(high)[0] < 0:
        low, high = high, 2 * high
    s, before = (low + high) / 2, mpmath.inf
    for _ in range(2000):
        excess, slope = late(s)
        low, high = (s, high) if sense * excess < 0 else (low, s)
        good = slope > 0 and min(low, high) < s - excess / slope < max(low, high) and abs(excess) < before / 2
        moved = s - excess / slope if good else (low + high) / 2
        before = abs(excess) if good else mpmath.inf
        if abs(moved - s) <= abs(s) * mpmath.mpf(10) ** -50:
            break
        s = moved
    g = functions(moved)
    f, lag = 1 - mu * g[2] / r, r * g[1] + eta * g[2]
    return [f * p + lag * v for p, v in zip(position, velocity, strict=True)]


def references(states: States) -> tuple[list[list[mpmath.mpf]], np.ndarray]:
    """Return the exact end positions, and the errors, m, that rounding the inputs alone makes."""
    ends, floors = [], []
    nudge = mpmath.mpf(10) ** -20
    for position, velocity, duration in zip(*states, strict=True):
        state = [mpmath.mpf(float(value)) for value in (*position, *velocity, duration, MU)]
        end, floor = exact_position(state), 0.0
        for index, value in enumerate(state):
            nudged = [*state[:index], value * (1 + nudge), *state[index + 1 :]]
            floor += float(distance(exact_position(nudged), end) / nudge) * 1.1e-16
        ends.append(end)
        floors.append(floor)
    return ends, np.array(floors)


def distance(one: list[mpmath.mpf], other: list[mpmath.mpf]) -> mpmath.mpf:
    return mpmath.sqrt(mpmath.fsum((a - b) ** 2 for a, b in zip(one, other, strict=True)))


def worst_error(library: Library, states: States, ends: list[list[mpmath.mpf]]) -> str:
    """Return the worst error, m, one state at a time, and how many gave none."""
    worst, lost = 0.0, 0
    for index, end in enumerate(ends):
        found, _ = library(tuple(column[index : index + 1] for column in states))
        if found is None or not np.isfinite(found).all():
            lost += 1
        else:
            worst = max(worst, float(distance([mpmath.mpf(float(x)) for x in found[0]], end)))
    figure = f"{worst:.0e}" if lost < len(ends) else "–"
    return f"{figure} ({lost} of {len(ends)} fail)" if lost else figure


def nanoseconds(libraries: dict[str, Library], states: States, repeat: int) -> dict[str, float]:
    """Return the median time a state of each, in rounds so that all meet the same weather."""
    taken: dict[str, list[float]] = {name: [] for name in libraries}
    for turn in range(repeat + 1):
        for name, library in libraries.items():
            end, seconds = library(states)
            if turn or end is None:
                taken[name].append(np.nan if end is None else seconds / states[2].size * 1e9)
    return {name: statistics.median(values) for name, values in taken.items()}


def table(rows: list[list[str]]) -> str:
    """Return rows as a Markdown table, the first its head."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|" + " --- |" * len(rows[0]), *lines[1:]])


def measured(states: int, checked: int, repeat: int) -> str:
    """Return the page."""
    libraries = installed_libraries()
    names = [kind.__name__.replace("_", " ") for kind in CLASSES]
    speed, error = [["ns a state", *names]], [["worst error, m", *names]]
    times, errors, floors = {}, {}, []
    for kind in CLASSES:
        times[kind] = nanoseconds(libraries, kind(np.random.default_rng(1), states), repeat)
        few = kind(np.random.default_rng(2), checked)
        ends, floor = references(few)
        floors.append(f"{floor.max():.0e}")
        errors[kind] = {name: worst_error(library, few, ends) for name, library in libraries.items()}
    error.append(["*floor: rounding the inputs*", *floors])
    for name in libraries:
        speed.append([name, *("–" if np.isnan(times[kind][name]) else f"{times[kind][name]:.0f}" for kind in CLASSES)])
        error.append([name, *(errors[kind][name] for kind in CLASSES)])
    for library in libraries.values():
        library.close()
    return PAGE_TEXT.format(
        speed=table(speed),
        error=table(error),
        states=states,
        checked=checked,
        repeat=repeat,
        machine=f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}",
    )


PAGE_TEXT = """# Two-body propagation: speed and error

Made by `python benchmarks/work_precision/kepler.py --write`; what is not installed is left out.

{states} states, each with its own duration, in one call (a loop where a library has no call for many); median CPU
time of {repeat} interleaved runs, one thread each; {machine}. "–" is a library that raised on the batch.

{speed}

The worst of {checked} states against mpmath with 50 digits, one state at a time. The floor is what rounding each input
to the nearest double does by itself, over the same states: no method can promise less.

{error}

Classes: *ballistic*, *near rectilinear* (1e-7 to 1e-12 rad off the vertical) and *vertical* are free flights from
100–300 km, anywhere between burnout and the way back; *near circular* has e from 1e-16 to 1e-3, *near parabolic*
|e − 1| from 1e-15 to 1e-3, *hyperbolic* e from 1.01 to 10, each up to a day forward or back.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=int, default=100_000)
    parser.add_argument("--checked", type=int, default=60)
    parser.add_argument("--repeat", type=int, default=9)
    parser.add_argument("--write", action="store_true", help=f"write {PAGE.name} into the documentation")
    given = parser.parse_args()
    mpmath.mp.dps = 60
    page = measured(given.states, given.checked, given.repeat)
    print(page)
    if given.write:
        PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
