"""The paper "OPIR Sensor Simulation for Missile Warning" (opir-simulator v0.1.0, April 2026),
checked by figure.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
