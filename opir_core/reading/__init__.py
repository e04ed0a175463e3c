"""Reading scenes: YAML or a mapping to a checked `Scene`, strictly, with every problem and its
place in one error.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
