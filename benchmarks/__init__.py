"""The benchmarks of opir: each a script of its own, and one suite of all, `python -m
benchmarks`.
"""
