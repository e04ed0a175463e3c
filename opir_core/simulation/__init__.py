"""Runs: a plan computed window by window, and the finished run."""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
