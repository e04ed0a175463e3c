"""How many Gauss-Legendre nodes the panels of `opir_photons.detection.gate_integrals` need.

    python docs/design/gate_nodes.py

Random rules of one and two gates, thresholds, slopes and signals, those on which the rules' edges
lie foremost. A panel's width is its length over the scale on which its integrand bends, 1 / sqrt(1
+ sum of squared slopes). Printed is, for each number of nodes, the width up to which no panel's
integral is further than 1e-11 from that of 96 nodes: `WIDTHS` stays below.
"""

import numpy as np
from opir_photons.detection import gate_integrals
from opir_photons.detection.band_rules import RatioGates

TRIES = 300
LOOKS = 400
ERROR = 1e-11


def random_rule(rng: np.random.Generator, others: int) -> RatioGates:
    """Return a rule of thresholds and ratios from mild to steep; some gates have one side."""
    lower = np.exp(rng.uniform(np.log(0.01), np.log(10.0), others)) * (rng.random(others) < 0.8)
    upper = np.exp(rng.uniform(np.log(0.3), np.log(30.0), others)) + 1.5 * lower
    upper[rng.random(others) < 0.2] = np.inf
    threshold = rng.uniform(3.0, 7.0)
    coincidence = rng.uniform(2.0, 4.0)
    return RatioGates(threshold, coincidence, np.array([0.0, *lower]), np.array([np.inf, *upper]))


def random_looks(rng: np.random.Generator, rule: RatioGates) -> tuple[np.ndarray, np.ndarray]:
    """Return signals and noise of looks, most of them on an edge of a gate."""
    reference = (
        rule.threshold + np.exp(rng.uniform(-2.0, 4.0, LOOKS)) - rng.uniform(0.0, 7.0, LOOKS)
    )
    noise = np.exp(rng.uniform(-1.0, 1.0, (LOOKS, len(rule.lower))))
    snr = np.tile(np.maximum(reference, 0.0)[:, None], len(rule.lower))
    for band in rule.others:
        steep = noise[:, 0] / noise[:, band]
        edges = [np.full(LOOKS, rule.coincidence), rule.lower[band] * steep * reference]
        edges.append(
            rule.upper[band] * steep * reference if np.isfinite(rule.upper[band]) else edges[1]
        )
        chosen = np.array(edges)[rng.integers(0, 3, LOOKS), np.arange(LOOKS)]
        snr[:, band] = np.maximum(chosen + rng.normal(0.0, 3.0, LOOKS), 0.0)
    return snr, noise


def integrals(rule: RatioGates, panels: gate_integrals.GatePanels, count: int) -> np.ndarray:
    """Return the integrals (p,) over panels, with the same number of nodes."""
    part = np.empty(len(panels.row))
    for moves in np.unique(panels.moves, axis=1).T:
        these = np.flatnonzero(np.all(panels.moves == moves[:, None], axis=0))
        part[these] = gate_integrals._integral(rule, panels.take(these), count)
    return part


def main() -> None:
    """Print the widths."""
    rng = np.random.default_rng(1)
    widths = list[np.ndarray]()
    errors = list[np.ndarray]()
    for attempt in range(TRIES):
        rule = random_rule(rng, 1 + attempt % 2)
        snr, noise = random_looks(rng, rule)
        near = rule.margins(snr, rule.slopes(noise))[:, 1:] < gate_integrals._FAR
        panels = gate_integrals.panels_of(gate_integrals.looks_of(rule, snr, noise, near))
        exact = integrals(rule, panels, 96)
        widths.append(panels.width)
        errors.append(
            [np.abs(integrals(rule, panels, count) - exact) for count in gate_integrals.NODES]
        )
    width = np.concatenate(widths)
    error = np.concatenate(errors, axis=1)
    print(f"{len(width)} panels, the widest {width.max():.1f}")
    for count, own in zip(gate_integrals.NODES, error, strict=True):
        far = width[own > ERROR].min(initial=np.inf)
        print(f"{count:3} nodes: within {ERROR:g} up to a width of {far:.2f}")


if __name__ == "__main__":
    main()
