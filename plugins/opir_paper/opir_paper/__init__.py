"""The paper "OPIR Sensor Simulation for Missile Warning" (opir-simulator v0.1.0, April 2026), checked by figure."""

from opir_paper.errata import errata_page, figures_page
from opir_paper.figure_checks import Check, checks

__all__ = ["Check", "checks", "errata_page", "figures_page"]
