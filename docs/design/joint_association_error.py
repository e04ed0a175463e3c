"""Loopy belief propagation against exact association probabilities, on clusters of every density.

    python docs/design/joint_association_error.py [--clusters 300]

Clusters of 8 tracks and 8 rays, likelihood ratios log-normal about 1, 10 and 1000, each track linked to a share of the
rays. Printed: the largest and the mean absolute error of a probability, and the time of both. What it settled: exact as
long as 12 rays are open at once (a cluster takes milliseconds); belief propagation beyond, whose error is largest where
many rays are about equally likely.
"""

import argparse
import time

import numpy as np

from opir_core.tracking.joint_association import cluster_marginals, propagated_marginals


def main() -> None:
    """Print errors and times by density and by strength."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clusters", type=int, default=300)
    clusters = parser.parse_args().clusters
    for share in (0.3, 0.6, 1.0):
        for strength in (1.0, 10.0, 1000.0):
            rng, worst, total, times = np.random.default_rng(1), 0.0, 0.0, [0.0, 0.0]
            for _ in range(clusters):
                weight = strength * np.exp(rng.normal(size=(8, 8))) * (rng.random((8, 8)) < share)
                start = time.process_time()
                exact = cluster_marginals(weight)
                middle = time.process_time()
                near = propagated_marginals(weight)
                times = [times[0] + middle - start, times[1] + time.process_time() - middle]
                worst = max(worst, float(np.abs(near - exact).max()))
                total += float(np.abs(near - exact).mean())
            figures = f"largest {worst:.3f}, mean {total / clusters:.4f}"
            micro = [1e6 * taken / clusters for taken in times]
            print(f"linked {share:.1f}, ratio {strength:6g}: {figures}; {micro[0]:.0f} and {micro[1]:.0f} µs")


if __name__ == "__main__":
    main()
