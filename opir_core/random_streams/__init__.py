"""Counter-based random streams: one seed, one stream per named purpose."""
