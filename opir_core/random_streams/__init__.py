"""Counter-based random streams: one seed, one stream for each named purpose."""
