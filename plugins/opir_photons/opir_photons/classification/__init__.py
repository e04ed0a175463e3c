"""Target types from measured band intensities: synthetic looks, their densities, and the
posterior.
"""
