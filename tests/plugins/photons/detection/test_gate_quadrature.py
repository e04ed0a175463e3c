"""The quick way to the chance of a rule of ratio gates: as near as it says, however steep gates
are, with few nodes.
"""

from typing import Any

import numpy as np
import pytest
from opir_photons.detection import RatioGates, gate_integrals
from opir_photons.detection.gate_integrals import (
    NODES,
    WIDTHS,
    fast_probability,
    looks_of,
    panels_of,
)

from opir_core.arrays import FloatArray

PAPER = RatioGates(5.0, 2.0, np.array([0.0, 0.8, 0.01]), np.array([np.inf, 4.0, 0.5]))


def on_edges(
    rng: np.random.Generator, rule: RatioGates, rows: int
) -> tuple[FloatArray, FloatArray]:
    """Return signals within a few standard deviations of an edge of their gates, and noise of all
    sizes.
    """
    reference = np.maximum(rule.threshold + rng.normal(2.0, 4.0, rows), 0.0)
    noise = 10.0 ** rng.uniform(-0.5, 0.5, (rows, len(rule.lower)))
    snr = np.repeat(reference[:, None], len(rule.lower), axis=1)
    for band in rule.others:
        steep = noise[:, 0] / noise[:, band]
        ratio = np.where(rng.random(rows) < 0.5, rule.lower[band], min(rule.upper[band], 1e3))
        snr[:, band] = np.maximum(steep * ratio * reference + rng.normal(0.0, 3.0, rows), 0.0)
    return snr, noise


@pytest.mark.slow
@pytest.mark.parametrize("others", [1, 2, 3])
def test_steep_or_flat_it_is_within_what_it_says(others: int) -> None:
    rng = np.random.default_rng(others)
    for _ in range(12):
        lower = 10.0 ** rng.uniform(-2.0, 1.0, others) * (rng.random(others) < 0.8)
        upper = np.where(
            rng.random(others) < 0.8, 1.5 * lower + 10.0 ** rng.uniform(-0.5, 1.5, others), np.inf
        )
        rule = RatioGates(
            rng.uniform(3.0, 7.0),
            2.5,
            np.array([0.0, *lower]),
            np.array([np.inf, *upper]),
            float(rng.integers(0, 4)),
        )
        snr, noise = on_edges(rng, rule, 150)
        quick = fast_probability(
            rule, snr, rule.slopes(noise), rule.margins(snr, rule.slopes(noise))
        )
        assert np.abs(quick - np.exp(rule.log_chances(snr, rule.slopes(noise))[0])).max() <= 1e-10


def test_the_same_look_has_the_same_chance_in_any_company() -> None:
    snr, noise = on_edges(np.random.default_rng(5), PAPER, 600)
    margins = PAPER.margins(snr, PAPER.slopes(noise))
    together = fast_probability(PAPER, snr, PAPER.slopes(noise), margins)
    for rows in (slice(0, 1), slice(7, 8), slice(100, 350)):
        assert np.array_equal(
            fast_probability(PAPER, snr[rows], PAPER.slopes(noise[rows]), margins[rows]),
            together[rows],
        )


def test_a_look_costs_few_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int]] = []
    density = gate_integrals._density

    def counted(rule: RatioGates, nodes: FloatArray, *rest: Any) -> FloatArray:
        asked.append((len(nodes), nodes.size))
        return density(rule, nodes, *rest)

    monkeypatch.setattr(gate_integrals, "_density", counted)
    snr, noise = on_edges(np.random.default_rng(6), PAPER, 4000)
    fast_probability(PAPER, snr, PAPER.slopes(noise), PAPER.margins(snr, PAPER.slopes(noise)))
    assert sum(size for _, size in asked) <= 40 * len(snr)
    assert max(nodes for nodes, _ in asked) <= 64
    assert len(asked) <= 60


def test_what_no_gate_touches_costs_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate_integrals, "_density", None)
    snr = np.array([[6.0, 12.0, 2.5], [40.0, 70.0, 3.1]])
    noise = np.ones((2, 3))
    margins = np.full((2, 7), 9.0)
    margins[:, 0] = snr[:, 0] - 5.0
    margins[:, 4] = snr[:, 2] - 2.0
    chance = fast_probability(PAPER, snr, PAPER.slopes(noise), margins)
    from scipy.special import ndtr

    assert chance == pytest.approx(ndtr(snr[:, 0] - 5.0) * ndtr(snr[:, 2] - 2.0), abs=1e-11)


def test_no_panel_is_wider_than_what_nodes_are_known_for() -> None:
    rng = np.random.default_rng(7)
    snr, noise = on_edges(rng, PAPER, 3000)
    panels = panels_of(
        looks_of(
            PAPER, snr, PAPER.slopes(noise), PAPER.margins(snr, PAPER.slopes(noise))[:, 1:] < 6.8
        )
    )
    assert panels.width.max() < 24.0
    assert len(NODES) == len(WIDTHS) + 1
