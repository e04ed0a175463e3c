"""The plots of a run, each in two parts: its data as columns, and the drawing of these into
axes.
"""
