"""How work-precision benchmarks take times: of one core, medians, beside a plain multiplication for
scale.
"""

import statistics
import time
from collections.abc import Callable

import numpy as np


def median_s(action: Callable[[], object], repeat: int) -> float:
    """Return the median processor time of an action, after one call that is not counted."""
    times = []
    for _ in range(repeat + 1):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return statistics.median(times[1:])


def multiply_ns() -> float:
    """Return the time a plain numpy multiplication takes an element, as a measure of how busy the
    machine is.
    """
    a = np.ones(32768)

    def many() -> None:
        for _ in range(1000):
            np.multiply(a, a, out=a)

    return 1e9 * median_s(many, 7) / (1000 * len(a))
