"""A sensor on the bench: budgets, curves, operating characteristics, false alarms, air, best bands
and frames.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
