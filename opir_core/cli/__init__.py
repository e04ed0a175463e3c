"""The command line: what commands of plugins share with the core's: scenes, components, tables,
progress.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
