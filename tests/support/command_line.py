"""The command `opir`, in this process."""

from opir_core.cli.main import main

__all__ = ["main"]
