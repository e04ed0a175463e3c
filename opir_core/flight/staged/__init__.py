"""Staged boosts: gravity turns of one to several burns with dark gaps, aimed on the rotating
Earth.
"""
