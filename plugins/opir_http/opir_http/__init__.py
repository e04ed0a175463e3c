"""A live opir simulation with an HTTP interface."""
