"""Associators of `imm`, one a file."""
