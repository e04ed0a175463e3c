"""What components and engine owe one another: columns, records, contexts, contracts."""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
