"""Interfaces between parts: contracts, contexts, and records of columns."""
