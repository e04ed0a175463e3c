"""How far a curve through five knots may be from a line with one bend, over what is judged of its error.

    python docs/design/knots_judged.py

`opir_core.weaving` judges a piece by how far its second and fourth knots are off the parabola through the others. A
bend that no model told of may stand anywhere between the knots. Printed is the largest ratio of the true error,
anywhere on the piece, to what is judged, over all places of the bend: `_JUDGED_SHARE` leaves room for it.
"""

import numpy as np

from opir_core.curves import Curves
from opir_core.weaving import judged_error

LENGTH = 4000


def main() -> None:
    """Print the largest ratio, and where the bend then is."""
    scan = np.array([[0], [1], [2], [3], [4]]) * (LENGTH // 4)
    every = np.arange(LENGTH + 1)
    worst, place = 0.0, 0
    for bend in range(10, LENGTH, 10):
        values = np.abs(scan - bend).astype(np.float64)
        found = Curves.through(scan, values).at(np.zeros(1, dtype=np.int64), np.array([len(every)]), every)
        error = float(np.abs(found - np.abs(every - bend)).max())
        ratio = error / float(judged_error(scan.astype(np.float64), values)[0])
        if ratio > worst:
            worst, place = ratio, bend
    print(f"at most {worst:.2f} times what is judged, with the bend {place / LENGTH:.4f} of the piece from its start")


if __name__ == "__main__":
    main()
