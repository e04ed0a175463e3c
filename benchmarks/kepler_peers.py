"""Two-body propagators of the libraries that are installed, each in a process of its own."""

import multiprocessing
import os
import re
import sys
import time
import types
import warnings
from collections.abc import Callable
from functools import partial
from importlib.metadata import version

import numpy as np

from opir_core.constants import EARTH_MU_M3_S2 as MU
from opir_core.flight.kepler import propagate_kepler

Propagator = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def by_heyoka():
    """Return heyoka's compiled function: Kepler's equation of the difference of eccentric
    anomalies, ellipses only.
    """
    import heyoka as hy

    x, y, z, u, v, w, t = hy.make_vars("x", "y", "z", "u", "v", "w", "t")
    r = hy.sqrt(x * x + y * y + z * z)
    a = 1.0 / (2.0 / r - (u * u + v * v + w * w) / MU)
    eta = (x * u + y * v + z * w) / np.sqrt(MU)
    s0 = eta / hy.sqrt(a)
    c0 = 1.0 - r / a
    step = hy.kepDE(s0, c0, t * hy.sqrt(MU / (a * a * a)))
    c = hy.cos(step)
    s = hy.sin(step)
    end = a + (r - a) * c + eta * hy.sqrt(a) * s
    f = 1.0 - a / r * (1.0 - c)
    g = a * eta / MU**0.5 * (1.0 - c) + r * hy.sqrt(a / MU) * s
    df = -hy.sqrt(MU * a) / (end * r) * s
    dg = 1.0 - a / end * (1.0 - c)
    pairs = ((x, u), (y, v), (z, w))
    outputs = [f * p + g * q for p, q in pairs] + [df * p + dg * q for p, q in pairs]
    compiled = hy.cfunc(outputs, [x, y, z, u, v, w, t])

    def propagate(position, velocity, duration):
        columns = np.ascontiguousarray(np.column_stack([position, velocity, duration]).T)
        end = compiled(columns)
        return end[:3].T, end[3:].T

    return propagate


def by_pykep():
    """Return pykep's Lagrangian propagation, one call a state."""
    # pykep 3.0.1's wheel lacks the data files of its trajectory gym, without which it does not
    # import.
    sys.modules.setdefault("pykep.trajopt.gym", types.ModuleType("pykep.trajopt.gym"))
    import pykep

    def propagate(position, velocity, duration):
        states = np.stack([position, velocity], axis=1)
        ends = [
            pykep.propagate_lagrangian(rv, tof, MU, False)
            for rv, tof in zip(states, duration.tolist(), strict=True)
        ]
        end = np.array(ends)
        return end[:, 0], end[:, 1]

    return propagate


def by_boinor(kernel_name):
    """Return one of boinor's kernels, looped over in numba, in its own unit, the kilometre."""
    import boinor.core.propagation as kernels
    import numba

    kernel = getattr(kernels, kernel_name)
    mu = MU / 1e9

    def by_coefficients(r, v, t):
        f, g, f_rate, g_rate = kernel(mu, r, v, t, 100)
        return f * r + g * v, f_rate * r + g_rate * v

    def by_elements(r, v, t):
        return kernel(mu, r, v, t)

    single = numba.njit(by_coefficients if kernel_name == "vallado" else by_elements)

    @numba.njit
    def loop(position, velocity, duration, end):
        for i in range(duration.size):
            end[0, i], end[1, i] = single(position[i], velocity[i], duration[i])

    def propagate(position, velocity, duration):
        end = np.full((2, duration.size, 3), np.nan)
        loop(position / 1e3, velocity / 1e3, duration, end)
        return end[0] * 1e3, end[1] * 1e3

    return propagate


LIBRARIES: dict[str, tuple[str, Callable[[], Propagator]]] = {
    "opir, numpy": ("numpy", lambda: propagate_kepler),
    "heyoka, compiled function": ("heyoka", by_heyoka),
    "pykep, call a state": ("pykep", by_pykep),
    "boinor farnocchia, in numba": ("boinor", partial(by_boinor, "farnocchia")),
    "boinor vallado, in numba": ("boinor", partial(by_boinor, "vallado")),
}


def name_of(label):
    """Return the name of a library, without what is called in it."""
    return re.split("[ ,]", label)[0]


NAMES = tuple(dict.fromkeys(name_of(label) for label in LIBRARIES))


def serve(label, pipe):
    """Answer states with end positions and the time taken, in a process of its own: heyoka and
    pykep bear no other.
    """
    warnings.simplefilter("ignore")
    distribution, make = LIBRARIES[label]
    try:
        propagate = make()
    except Exception as reason:
        pipe.send(f"{type(reason).__name__}: {reason}")
        return
    pipe.send((version(distribution),))
    while (states := pipe.recv()) is not None:
        start = time.process_time()
        try:
            end = propagate(*states)[0]
        except Exception:
            end = None
        pipe.send((end, time.process_time() - start))
    pipe.send("done")
    os._exit(0)  # pykep aborts a process that ends by itself


class Library:
    """A propagator in its own process; calling it returns end positions (none if it raised) and
    seconds.
    """

    def __init__(self, label):
        context = multiprocessing.get_context("spawn")
        self.pipe, child_pipe = context.Pipe()
        self.process = context.Process(target=serve, args=(label, child_pipe), daemon=True)
        self.process.start()
        child_pipe.close()
        answer = self.answer()
        self.problem = answer if isinstance(answer, str) else ""
        self.version = "" if self.problem else answer[0]

    def answer(self):
        try:
            return self.pipe.recv()
        except EOFError:
            return "the process died"

    def __call__(self, states):
        self.pipe.send(states)
        return self.answer()

    def close(self):
        self.pipe.send(None)
        self.answer()


def installed_libraries(names):
    """Return the named propagators that can be imported, by name and version."""
    libraries = {}
    for label in LIBRARIES:
        if name_of(label) in names:
            library = Library(label)
            libraries[f"{label} {library.version}"] = library
            if library.problem:
                print(f"{label}: left out ({library.problem})", file=sys.stderr)
    return {name: library for name, library in libraries.items() if not library.problem}
