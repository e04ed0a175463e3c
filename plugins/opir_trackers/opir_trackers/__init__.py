"""Trackers for opir: `kepler-arc` and `imm`."""
