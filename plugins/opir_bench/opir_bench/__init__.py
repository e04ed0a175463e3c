"""The bench: one sensor's budgets, curves, operating characteristics, false alarms, air and
frames.
"""
