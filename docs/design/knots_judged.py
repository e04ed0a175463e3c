"""How far a curve through five knots may be from a line with one bend that its knots do not show,
of the tolerance.

    python docs/design/knots_judged.py

`opir_core.simulation.refinement` judges a piece by how far its second and fourth knots are off the
parabola through the others, and the half of a piece by how far they are off the curve through the
whole one's knots. A bend that is in no model may stand anywhere between the knots; it may be one of
the slope, or of the curvature, or a jump. Printed is the largest true error, anywhere on the piece
and over all places of the bend, as a share of the tolerance, of pieces that both terms just let
pass (`THIRD_SHARE`, `FOURTH_SHARE`), and of halves whose new knots were just predicted
(`MISSED_SHARE`).
"""

from collections.abc import Callable

import numpy as np

from opir_core.simulation.refinement import (
    FOURTH_SHARE,
    MISSED_SHARE,
    THIRD_SHARE,
    Curves,
    error_terms,
)

LENGTH = 4000
BENDS: dict[str, Callable[[np.ndarray, int], np.ndarray]] = {
    "slope": lambda scan, bend: np.abs(scan - bend).astype(np.float64),
    "curvature": lambda scan, bend: np.square(np.maximum(scan - bend, 0) / LENGTH),
    "jump": lambda scan, bend: (scan > bend).astype(np.float64),
}


def main() -> None:
    """Print the largest ratios."""
    whole = np.arange(5)[:, None] * (LENGTH // 2)
    half = whole // 2
    new = np.array([LENGTH // 4, 3 * LENGTH // 4])
    every = np.arange(LENGTH + 1)
    for name, bent in BENDS.items():
        judged = []
        missed = []
        for bend in range(5, 2 * LENGTH, 10):
            values = bent(half, bend)
            error = np.abs(_through(half, values, every) - bent(every, bend)).max()
            if error < 1e-9:
                continue
            third, fourth = error_terms(half.astype(np.float64), values)
            judged.append(error / max(third[0] / THIRD_SHARE, fourth[0] / FOURTH_SHARE))
            missed.append(
                error
                / np.abs(_through(whole, bent(whole, bend), new) - bent(new, bend)).max()
                * MISSED_SHARE
            )
        print(
            f"a bend of {name}: at most {max(judged):.2f} of the tolerance by its terms,"
            f" {max(missed):.2f} predicted"
        )


def _through(knots: np.ndarray, values: np.ndarray, scan: np.ndarray) -> np.ndarray:
    return Curves.through(knots, values).at(
        np.zeros(1, dtype=np.int64), np.array([len(scan)]), scan
    )


if __name__ == "__main__":
    main()
