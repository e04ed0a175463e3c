"""How far a curve through five knots may be from a line with one bend, over what is judged of its error.

    python docs/design/knots_judged.py

`opir_core.weaving` judges a piece by how far its second and fourth knots are off the parabola through the others, and
the half of a piece by how far they are off the curve through the whole one's knots. A bend that no model told of may
stand anywhere between the knots; it may be one of the slope, or of the curvature, or a jump. Printed is the largest
ratio of the true error, anywhere on the piece, to what is judged and to what is missed, over all places of the bend:
`_JUDGED_SHARE` and `_MISSED_SHARE` leave room for it.
"""

from collections.abc import Callable

import numpy as np

from opir_core.curves import Curves
from opir_core.weaving import judged_error

LENGTH = 4000
BENDS: dict[str, Callable[[np.ndarray, int], np.ndarray]] = {
    "slope": lambda scan, bend: np.abs(scan - bend).astype(np.float64),
    "curvature": lambda scan, bend: np.square(np.maximum(scan - bend, 0) / LENGTH),
    "jump": lambda scan, bend: (scan > bend).astype(np.float64),
}


def main() -> None:
    """Print the largest ratios."""
    whole = np.arange(5)[:, None] * (LENGTH // 2)
    half, new, every = whole // 2, np.array([LENGTH // 4, 3 * LENGTH // 4]), np.arange(LENGTH + 1)
    for name, bent in BENDS.items():
        judged, missed = [], []
        for bend in range(5, 2 * LENGTH, 10):
            values = bent(half, bend)
            error = np.abs(_through(half, values, every) - bent(every, bend)).max()
            if error < 1e-9:
                continue
            judged.append(error / judged_error(half.astype(np.float64), values)[0])
            missed.append(error / np.abs(_through(whole, bent(whole, bend), new) - bent(new, bend)).max())
        print(f"a bend of {name}: at most {max(judged):.2f} times what is judged, {max(missed):.2f} what is missed")


def _through(knots: np.ndarray, values: np.ndarray, scan: np.ndarray) -> np.ndarray:
    return Curves.through(knots, values).at(np.zeros(1, dtype=np.int64), np.array([len(scan)]), scan)


if __name__ == "__main__":
    main()
