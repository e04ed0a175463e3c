"""Outputs that acknowledge later, and the spool that keeps events on disk until they do.

A sink either takes windows and is done with them (`opir_core.interfaces.protocols.Sink`), or carries encoded events
away and says later which arrived (`opir_core.interfaces.protocols.Transport`). `Dispatch` makes a sink of a carrier:
events wait in a `Backlog`, which is memory or, where the output's block has `spool: {...}`, a SQLite file that survives
the process.
"""
