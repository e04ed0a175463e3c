"""Sinks whose events are acknowledged later, and the spool that keeps events on disk until then.

`TransportSink` makes a sink of a `Transport`: batches wait in a `Backlog`, in memory or, if the
output has `spool: {...}`, in a SQLite file that survives the process.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
