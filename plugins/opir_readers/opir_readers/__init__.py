"""Readers of other programs' files: trajectories as CSV tables of states and CCSDS OEM."""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
