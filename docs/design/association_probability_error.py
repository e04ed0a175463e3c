"""Approximate against exact association probabilities, by the number of rows and the strength of
the evidence.

    python docs/design/association_probability_error.py [--graphs 200]

Square graphs with log likelihoods of a given standard deviation. Printed: mean and largest absolute
error of a probability where every row has a column, of squared likelihoods scaled to rows and
columns of 1 (`swap_probabilities`) and of loopy belief propagation with likelihoods times e⁶⁰. What
it settled: belief propagation does not converge where two rows may have swapped their columns;
scaling is exact there, and errs by some 0.03 for more rows.
"""

import argparse
from itertools import permutations

import numpy as np
from opir_estimation import belief_propagation, swap_probabilities


def exact(log: np.ndarray) -> np.ndarray:
    """Return the probabilities (n, n) over all permutations."""
    count = len(log)
    orders = np.array(list(permutations(range(count))))
    chance = np.exp(log[np.arange(count), orders].sum(axis=1))
    total = np.zeros_like(log)
    np.add.at(
        total, (np.arange(count), orders), np.repeat(chance[:, None] / chance.sum(), count, axis=1)
    )
    return total


def main() -> None:
    """Print errors by size and strength."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--graphs", type=int, default=200)
    graphs = parser.parse_args().graphs
    for count in (2, 3, 5, 7):
        for sigma in (0.5, 2.0, 5.0):
            rng = np.random.default_rng(1)
            errors = []
            row, column = np.indices((count, count)).reshape(2, -1)
            for _ in range(graphs):
                log = sigma * rng.normal(size=(count, count))
                truth = exact(log).ravel()
                forced = np.exp(log - log.max(axis=1)[:, None] + 60.0).ravel()
                near = (
                    swap_probabilities(row, column, log.ravel()),
                    belief_propagation(row, column, forced),
                )
                errors.append(np.abs(np.array(near) - truth))
            mean = np.mean(errors, axis=(0, 2))
            most = np.max(errors, axis=(0, 2))
            print(
                f"{count} rows, {sigma}: scaled {mean[0]:.3f} ({most[0]:.2f}), BP {mean[1]:.3f}"
                f" ({most[1]:.2f})"
            )


if __name__ == "__main__":
    main()
