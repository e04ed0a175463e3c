"""Loopy belief propagation against exact association probabilities, on clusters of every density.

    python docs/design/association_probability_error.py [--clusters 300]

Clusters of 8 tracks and 8 rays, likelihood ratios log-normal about 1, 10 and 1000, each track linked to a share of the
rays. Printed: the largest and the mean absolute error of a probability, and the time of both, all clusters
together. What it settled: exact as long as a cluster has 8 tracks or 8 rays at most; beyond, belief propagation says
which pairs do not matter, and clusters that are narrow without them are summed exactly all the same.
"""

import argparse
import time

import numpy as np
from opir_trackers.assignment import belief_propagation, exact_marginals


def main() -> None:
    """Print errors and times by density and by strength."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clusters", type=int, default=300)
    clusters = parser.parse_args().clusters
    for share in (0.3, 0.6, 1.0):
        for strength in (1.0, 10.0, 1000.0):
            rng = np.random.default_rng(1)
            linked = rng.random((clusters, 8, 8)) < share
            weight = strength * np.exp(rng.normal(size=(clusters, 8, 8))) * linked
            cluster, row, column = np.nonzero(linked)
            start = time.process_time()
            exact = exact_marginals(weight)[linked]
            middle = time.process_time()
            near = belief_propagation(8 * cluster + row, 8 * cluster + column, weight[linked])
            times = [middle - start, time.process_time() - middle]
            error = np.abs(near - exact)
            figures = f"largest {error.max():.3f}, mean {error.mean():.4f}"
            micro = [1e6 * taken / clusters for taken in times]
            print(f"linked {share:.1f}, ratio {strength:6g}: {figures}; {micro[0]:.0f} and {micro[1]:.0f} µs")


if __name__ == "__main__":
    main()
