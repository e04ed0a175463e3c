"""Trackers for opir: `kepler-arc` and `stereo-filter`."""
