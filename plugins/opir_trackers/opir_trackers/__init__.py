"""Trackers for opir: `kepler-arc`, `stereo-filter` and `boost-profile`."""
