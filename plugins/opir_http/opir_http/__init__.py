"""A live opir simulation behind HTTP."""
