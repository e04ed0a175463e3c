"""Interfaces between parts: protocols, contexts, and records of columns."""
