"""Probabilities of detection interpolated along each pair's looks, to a stated tolerance."""
