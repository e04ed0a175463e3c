"""The host: hooks, components, discovery, resolution, and the boundary around what plugins
raise.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
