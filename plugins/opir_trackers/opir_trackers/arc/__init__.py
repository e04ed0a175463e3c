"""The tracker `kepler-arc`: a Keplerian arc, as the paper has it."""
