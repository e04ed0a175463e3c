"""opir's trackers: `kepler-arc`, `stereo-filter` and `boost-profile`."""
