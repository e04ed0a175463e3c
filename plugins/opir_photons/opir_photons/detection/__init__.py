"""Detection: thresholds in Gaussian noise, cumulative probability, latency, and rules over several
bands.

Each name is imported when it is first used. Signals and thresholds are in standard deviations of
the noise.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
