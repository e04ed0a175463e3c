"""The tracker `stereo-filter`: data association, IMM filter, track management and reports."""
