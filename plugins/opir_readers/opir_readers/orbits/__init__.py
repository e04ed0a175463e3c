"""Orbits of satellites from files: mean elements for SGP4 (OMM, TLE) and ephemerides; fleets of
sensors of them.
"""
