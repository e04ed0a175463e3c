"""Outputs of opir for other displays."""
