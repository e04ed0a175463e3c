"""Readers of other programs' files: trajectories as CSV tables of states and CCSDS OEM."""
