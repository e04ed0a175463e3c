"""The API for plugin authors: hook marker, component classes, configuration fields, sensor kit,
contracts and records.

Contracts, contexts and records are imported on first use, so that discovering a plugin imports no
numpy.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
