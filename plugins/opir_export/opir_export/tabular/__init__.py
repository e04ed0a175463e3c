"""The tables of a run, as Arrow."""
