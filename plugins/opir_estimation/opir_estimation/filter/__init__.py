"""The IMM filter of boost and coast in square-root information form: motion models, mixing and
updates.
"""
